"""How busy this computer is: the share of the time in which a process waited for a processor.

A process cannot see that it was woken late by bytes, as it can when it oversleeps. The kernel can:
pressure stall information (Linux, Documentation/accounting/psi.rst), where it is compiled in.
"""

import os
from pathlib import Path

PRESSURE = Path("/proc/pressure/cpu")
BUSY = 0.3
"""Share from which an answer that comes late proves nothing: as often as not far below, it is the
computer. (A latency timer that is not set makes two of three answers late.)"""
_WINDOW_NS = 200_000_000
"""At least; the kernel adds up in lumps of some milliseconds."""


class Pressure:
    """The pressure on the processors of this computer; none where the kernel does not tell.

    Args:
        path: Of the kernel's file.
    """

    def __init__(self, path: Path = PRESSURE) -> None:
        self._file = -1
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            return
        self._before = self._latest = (0, self._stalled_ns())

    def look(self, now_ns: int) -> None:
        """Keeps the share young; call several times a second."""
        if self._file >= 0 and now_ns - self._latest[0] >= _WINDOW_NS:
            self._before, self._latest = self._latest, (now_ns, self._stalled_ns())

    def share(self, now_ns: int) -> float:
        """Share of the last few tenths of a second.

        Args:
            now_ns: Monotonic.
        """
        if self._file < 0:
            return 0.0
        since_ns, before_ns = self._before
        return min(1.0, (self._stalled_ns() - before_ns) / max(now_ns - since_ns, _WINDOW_NS))

    def _stalled_ns(self) -> int:
        """Since the computer was started."""
        try:
            words = os.pread(self._file, 200, 0).split(b"\n", 1)[0].split(b"total=")
            return 1000 * int(words[1])
        except (OSError, ValueError, IndexError):  # a kernel that tells it in other words
            return 0
