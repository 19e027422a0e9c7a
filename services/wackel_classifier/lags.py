"""Lags that cost control a cycle: single ones are ordinary, several within seconds are a fault."""

from collections import deque

LATE_NS = 5_000_000
"""A whole cycle at 200 Hz."""
LAGS_TIMES = 3
LAGS_WINDOW_NS = 10_000_000_000


class Lags:
    """The latest of them.

    Its length is how many there were within the window.
    """

    def __init__(self) -> None:
        self._latest: deque[tuple[int, int, int]] = deque(maxlen=LAGS_TIMES)  # time, lag, stamp

    def __len__(self) -> int:
        return len(self._latest)

    @property
    def longest_ns(self) -> int:
        """Of these."""
        return max((lag for _, lag, _ in self._latest), default=0)

    def add(self, lag_ns: int, now_ns: int, stamp: int) -> None:
        """Something was late by so much; what costs no cycle does not count."""
        if lag_ns >= LATE_NS:
            self._latest.append((now_ns, lag_ns, stamp))

    def since(self, now_ns: int) -> int | None:
        """Stamp of the first of several within the window; ``None`` if they are fewer."""
        latest = self._latest
        while latest and now_ns - latest[0][0] > LAGS_WINDOW_NS:
            latest.popleft()
        return latest[0][2] if len(latest) == LAGS_TIMES else None
