"""How long this thread has waited for a processor: by so much it noticed bytes late.

A process cannot see that it was woken late by bytes, as it can when it oversleeps. The kernel can:
the second number of ``schedstat`` is the time on a run queue (Linux,
Documentation/scheduler/sched-stats.rst). How busy the whole computer is (pressure stall
information) would not do: what waits there may be background work that takes nothing from us.
"""

import os
from pathlib import Path

OF_THREAD = Path("/proc/thread-self/schedstat")


class ProcessorWait:
    """Of the thread that makes it; none where the kernel does not tell.

    Args:
        path: Of the kernel's file.
    """

    def __init__(self, path: Path = OF_THREAD) -> None:
        self._file = -1
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            return

    def total_ns(self) -> int:
        """Since the thread was started."""
        if self._file < 0:
            return 0
        try:
            return int(os.pread(self._file, 100, 0).split()[1])
        except (OSError, ValueError, IndexError):  # a kernel that tells it in other words
            return 0
