"""A late host: how much of what is late is its doing, and when it is a fault of its own."""

from wackel_classifier.findings import Finding
from wackel_classifier.lags import Lags
from wackel_classifier.latency_timer import HELD_MOST_NS, LATENESSES
from wackel_schemas import component

WAITS = 100
WAITS_START = 10
BUSY_START = 0.05
"""How often the host makes an answer late is told by the share of the reads of many in which it
overslept by so much, and by the share of the single answers that come later than any adapter holds
them: both over so many, from a cautious start."""
SPOILS_NS = 200_000
"""Response times measured by a host that was late by so much say nothing about the servo."""


class _Share:
    """How often something happens, of late."""

    def __init__(self) -> None:
        self.value = BUSY_START
        self._memory = WAITS_START

    def happened(self) -> None:
        """Once."""
        self.value += 1.0 / self._memory

    def had_chances(self, count: int) -> None:
        """It could have happened so often."""
        self.value *= (1.0 - 1.0 / self._memory) ** count
        self._memory = min(self._memory + count, WAITS)


class HostLag:
    """Follows it on one bus.

    Args:
        bus: Its name.

    Attributes:
        waits: Reads of many servos, in which the host's own lateness shows, since the last of one;
            counted by the owner.
    """

    def __init__(self, bus: str) -> None:
        self.waits = 0
        self._overslept = [_Share() for _ in LATENESSES]
        self._beyond = _Share()
        self._lags = Lags("host_lag", component.bus(bus), 0.95, "the host overslept by")

    def overslept(self, lag_ns: int, now_ns: int, stamp: int, *, many: bool) -> None:
        """The host was late by so much, at least :data:`SPOILS_NS`, in a read of many or not."""
        if many:
            for lateness, share in zip(LATENESSES, self._overslept, strict=True):
                if lag_ns >= lateness.host_ns:
                    share.happened()
        self._lags.add(lag_ns, now_ns, stamp)

    def busy(self, delay_ns: int) -> list[float]:
        """A single answer came after so long; the share of them that the host makes late, for each
        of :data:`LATENESSES`.
        """
        self._beyond.had_chances(1)
        if delay_ns > HELD_MOST_NS:
            self._beyond.happened()
        for share in self._overslept:
            share.had_chances(self.waits)
        self.waits = 0
        return [max(share.value, self._beyond.value) for share in self._overslept]

    def findings(self, now_ns: int) -> list[Finding]:
        """Whether it is late so often that control suffers."""
        return self._lags.findings(now_ns)
