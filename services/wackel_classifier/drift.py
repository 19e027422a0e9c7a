"""Answers of a servo that slowly come later than they used to, against those of its peers."""

from dataclasses import dataclass, field
from math import log
from statistics import median

DRIFT_NS = 30_000
"""A slow change that is told: half of what is late at once. Page's test (CUSUM) for a shift by this
adds up what exceeds half of it."""
LEAST_ANSWERS = 16
"""So many at least, some five seconds, whatever the scatter: what comes and goes is no drift."""
BASELINE = 64
"""Answers of a servo that tell how it differs from its peers when it is sound."""
LEAST_SCATTER_NS = 5_000
"""Firmware loops (thesis, figure 2.7)."""
BOUND_NS = 2 * DRIFT_NS
"""Of one answer's difference: what is later is late at once, which another test tells."""
BY_CHANCE = 1e-9
"""How improbable a verdict must be by chance: some 10^5 single requests an hour are made, so this
is one false alarm in ten thousand hours."""


@dataclass(slots=True)
class Drift:
    """How a servo's answers move against its peers'.

    Attributes:
        first: Differences from the peers, ns.
        usual_ns: Their median, once they are complete.
        excess_ns: The test's sum.
        since: Stamp from which on it is above zero.
        moved_ns: Sum of the differences since then.
        count: And how many there are.
    """

    first: list[float] = field(default_factory=list)
    usual_ns: float = 0.0
    excess_ns: float = 0.0
    since: int = 0
    moved_ns: float = 0.0
    count: int = 0

    def add(self, difference_ns: float, limit_ns: float, stamp: int) -> None:
        """Takes in a difference from the peers."""
        if len(self.first) < BASELINE:
            self.first.append(difference_ns)
            if len(self.first) == BASELINE:
                self.usual_ns = median(self.first)
            return
        moved_ns = max(-BOUND_NS, min(difference_ns - self.usual_ns, BOUND_NS))
        if not self.excess_ns:
            self.since, self.moved_ns, self.count = stamp, 0.0, 0
        self.moved_ns += moved_ns
        self.count += 1
        excess_ns = self.excess_ns + min(moved_ns, DRIFT_NS) - DRIFT_NS / 2
        # What exceeds the limit is not saved up: a repair shall show.
        self.excess_ns = max(0.0, min(excess_ns, limit_ns + BOUND_NS))


def drift_limit_ns(scatter_ns: float) -> float:
    """Where chance alone gets once in 1 / :data:`BY_CHANCE` answers (Wald's approximation).

    Args:
        scatter_ns: Median deviation of answers from what is typical.
    """
    deviation_ns = max(LEAST_SCATTER_NS, 1.5 * scatter_ns)  # of a normal distribution
    by_chance_ns = -log(BY_CHANCE) * deviation_ns**2 / DRIFT_NS
    return max(by_chance_ns, LEAST_ANSWERS * DRIFT_NS / 2)
