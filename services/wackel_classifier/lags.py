"""Lags that cost control a cycle: single ones are ordinary, several within seconds are a fault."""

from collections import deque

from wackel_classifier.findings import Finding

LATE_NS = 5_000_000
"""A whole cycle at 200 Hz."""
TIMES = 3
MOST = 50
"""Five a second are as bad as more; bounds memory where stamps stand still."""
WINDOW_NS = 10_000_000_000
"""A computer that does much else is late now and then, once in minutes; so often control suffers.
"""


class Lags:
    """The latest of one kind.

    Args:
        code: Of the fault that several of them are.
        component: Path of what is late.
        confidence: That it is to blame.
        what: It did, to be followed by how long: ``the host overslept by``.
    """

    def __init__(self, code: str, component: str, confidence: float, what: str) -> None:
        self._code = code
        self._component = component
        self._confidence = confidence
        self._what = what
        self._latest: deque[tuple[int, int, int]] = deque(maxlen=MOST)  # time, lag, stamp

    def __len__(self) -> int:
        """How many there were of late, as last concluded from."""
        return len(self._latest)

    def add(self, lag_ns: int, now_ns: int, stamp: int) -> None:
        """Something was late by ``lag_ns``; what costs no cycle does not count.

        Args:
            lag_ns: By how much.
            now_ns: Classifier's time.
            stamp: Of the transaction, UTC ns.
        """
        if lag_ns >= LATE_NS:
            self._latest.append((now_ns, lag_ns, stamp))

    def findings(self, now_ns: int) -> list[Finding]:
        """Whether there were so many of late that control suffers."""
        latest = self._latest
        while latest and now_ns - latest[0][0] > WINDOW_NS:
            latest.popleft()
        if len(latest) < TIMES:
            return []
        longest_ms = max(lag for _, lag, _ in latest) / 1e6
        return [
            Finding(
                self._code,
                self._component,
                self._confidence,
                latest[0][2],
                f"{self._what} up to {longest_ms:.1f} ms, {len(latest)} times within "
                f"{WINDOW_NS / 1e9:.0f} s",
                {"longest_ms": round(longest_ms, 2)},
            )
        ]
