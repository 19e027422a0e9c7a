"""What a response time usually is, and when one departs from it."""

_LEAST_NS = 60_000
"""What can be told apart from the scatter of a quiet host; the classifier's limit for a servo that
is slow."""
_DEVIATIONS = 4.0
"""As for time-outs in RFC 6298."""
_ASKED_AGAIN = 8
"""So often in a row a departure is followed up: as many late answers convict a servo also beside a
host that makes one answer in thirteen late."""


class Usual:
    """Mean and mean deviation of one servo's answers to one kind of request, ns.

    A departure that does not come again is an outlier and leaves both as they are. One that does
    is learned at last: it is how the servo answers now.

    Attributes:
        outliers: Departures so far.
    """

    __slots__ = ("_departed", "_deviation_ns", "_mean_ns", "outliers")

    def __init__(self) -> None:
        self._mean_ns: float | None = None
        self._deviation_ns = 0.0
        self._departed: list[int] = []
        self.outliers = 0

    def departs(self, took_ns: int) -> bool:
        """Takes in a sample; whether another one is needed to tell whether something changed."""
        if self._mean_ns is None:
            self._mean_ns = took_ns
            return False
        if abs(took_ns - self._mean_ns) <= max(_LEAST_NS, _DEVIATIONS * self._deviation_ns):
            self._learn(took_ns)
            self._departed.clear()
            return False
        self.outliers += 1
        self._departed.append(took_ns)
        if len(self._departed) <= _ASKED_AGAIN:
            return True
        self.accept()
        return False

    def accept(self) -> None:
        """It is how the servo answers now."""
        for took_ns in self._departed:
            self._learn(took_ns)
        self._departed.clear()

    def _learn(self, took_ns: int) -> None:
        error = took_ns - (self._mean_ns or 0.0)
        self._mean_ns = (self._mean_ns or 0.0) + error / 8
        self._deviation_ns += (abs(error) - self._deviation_ns) / 4
