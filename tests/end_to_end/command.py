"""The ``wackel`` command as it is installed, run as a user runs it."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.conftest import killed_after

WACKEL = str(Path(sys.executable).with_name("wackel"))
LIMIT_S = 60.0
"""For what takes a second or two on a computer that does nothing else."""


def wackel(
    *arguments: str | Path, cwd: Path | None = None, limit_s: float = LIMIT_S
) -> "subprocess.CompletedProcess[str]":
    """Runs a command to its end.

    Raises:
        subprocess.TimeoutExpired: It did not end within the limit.
    """
    return subprocess.run(
        [WACKEL, *map(str, arguments)],
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=limit_s,
    )


@contextmanager
def started(*arguments: str | Path, cwd: Path | None = None) -> Iterator["subprocess.Popen[str]"]:
    """A command that goes on; stdout is a pipe, stderr goes to stdout. Killed with the block."""
    command = [WACKEL, *map(str, arguments)]
    with subprocess.Popen(
        command,
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def read_until(process: "subprocess.Popen[str]", words: str) -> str:
    """What a command prints up to and with the line that contains the words.

    Raises:
        AssertionError: It ended without, or was killed as it took longer than ``LIMIT_S``.
    """
    assert process.stdout is not None
    lines = []
    with killed_after(process, LIMIT_S):
        for line in process.stdout:
            lines.append(line)
            if words in line:
                return "".join(lines)
    raise AssertionError(f"{words!r} was never printed: {lines}")
