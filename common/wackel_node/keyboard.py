"""Single keys from the terminal, without waiting for them."""

import os
import select
import sys
import termios
import tty
from contextlib import suppress
from types import TracebackType
from typing import Any, Self


class Keyboard:
    """Use with ``with``: the terminal is as it was afterwards.

    No key comes without a terminal, nor in its background: there the system would suspend who
    reads keys or changes how they come.
    """

    def __init__(self) -> None:
        self._fd = sys.stdin.fileno() if sys.stdin is not None and sys.stdin.isatty() else -1
        if self._in_background():
            self._fd = -1
        self._before: list[Any] = []

    def __enter__(self) -> Self:
        if self._fd >= 0:
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd, termios.TCSANOW)  # the usual way drops keys typed before
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._before and not self._in_background():
            with suppress(termios.error):  # it is closed
                termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)

    def typed(self) -> str:
        """What was typed since the last call."""
        if self._fd < 0 or self._in_background() or not select.select([self._fd], [], [], 0)[0]:
            return ""
        try:
            return os.read(self._fd, 64).decode(errors="replace")
        except OSError:  # it is closed
            return ""

    def _in_background(self) -> bool:
        try:
            return self._fd >= 0 and os.tcgetpgrp(self._fd) != os.getpgrp()
        except OSError:  # a terminal that suspends nobody: another's, or closed
            return False
