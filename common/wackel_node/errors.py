"""Errors whose text is all that a person needs, and the exit codes that scripts can rely on."""

from typing import ClassVar

OK = 0
FAILED = 1
USAGE = 2
NOT_REACHED = 3


class Explained(Exception):
    """An expected failure: a command prints its one line, without traceback, and exits.

    Attributes:
        exit_code: With what.
    """

    exit_code: ClassVar[int] = FAILED


class AlreadyRunning(Explained):
    """The services of this robot are running already."""


class NotWritable(Explained, OSError):
    """A file cannot be written where it should go, or would be written over another one."""
