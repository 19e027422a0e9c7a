"""Stamps: UTC in ns, advanced by the monotonic clock so that they never run backwards.

Only the shells of services use it; cores get their time from messages.
"""

import time
from typing import NamedTuple

_STEP_NS = 100_000_000  # a wall clock that moved this far was set, not disciplined


class Instant(NamedTuple):
    """One moment on both clocks: durations come from the first, stamps from the second.

    Attributes:
        monotonic_ns: ns since an arbitrary start; never set, never jumps.
        utc_ns: UTC, ns since 1970.
    """

    monotonic_ns: int
    utc_ns: int


class Clock:
    """UTC that is monotonic within a process and follows a wall clock that was set.

    A robot computer without a battery clock starts years in the past and is set once the network
    is up. :meth:`follow` takes that over; until then durations stay right.
    """

    def __init__(self) -> None:
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """UTC, ns since 1970."""
        return time.monotonic_ns() + self._offset_ns

    def instant(self) -> Instant:
        """Now, on both clocks."""
        now_ns = time.monotonic_ns()
        return Instant(now_ns, now_ns + self._offset_ns)

    def stamp_ns(self, monotonic_ns: int) -> int:
        """UTC of a reading of ``time.monotonic_ns()``."""
        return monotonic_ns + self._offset_ns

    def follow(self) -> int:
        """Takes over a wall clock that was set; returns the step in ns, 0 if there was none."""
        step = time.time_ns() - self.now_ns()
        if abs(step) < _STEP_NS:
            return 0
        self._offset_ns += step
        return step
