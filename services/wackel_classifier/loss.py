"""Loss in numbers: a sequential test of a designed false-alarm rate, and confidence bounds.

Some loss is ordinary on TTL. Page's CUSUM of the log-likelihood ratio between ordinary and
noticeable loss decides when it is more than that (Page 1954; Lorden 1971: the mean time between
false alarms is at least e^h updates for threshold h).
"""

import math

NOTICEABLE_LOSS = 0.02
"""The rate that the test is made for: one answer in fifty, what control software begins to feel."""
FORGET = 5.0
"""The sum may rise so much above the threshold; bounds how long an alarm outlives its cause."""


def threshold(updates_per_hour: float, false_alarms_per_hour: float) -> float:
    """h for a designed rate of false alarms, by Lorden's bound."""
    return math.log(max(updates_per_hour / false_alarms_per_hour, math.e))


class LossTest:
    """Whether failures are more than ordinary.

    Args:
        ordinary: Share of failures that is ordinary.
        limit: Threshold h.

    Attributes:
        sum: Page's, from zero to a little more than the limit.
        alarmed: Whether they are; holds until the sum has fallen to zero.
    """

    def __init__(self, ordinary: float, limit: float) -> None:
        ordinary = min(max(ordinary, 1e-6), 0.5)
        noticeable = min(max(NOTICEABLE_LOSS, 10 * ordinary), 0.9)
        self._gain = math.log(noticeable / ordinary)
        self._drift = math.log((1 - noticeable) / (1 - ordinary))
        self._limit = limit
        self.sum = 0.0
        self.alarmed = False

    def add(self, failures: int, successes: int) -> None:
        """Takes in one period."""
        total = self.sum + failures * self._gain + successes * self._drift
        self.sum = min(max(total, 0.0), self._limit + FORGET)
        if self.sum >= self._limit:
            self.alarmed = True
        elif not self.sum:
            self.alarmed = False

    def reset(self) -> None:
        """Begins anew."""
        self.sum = 0.0
        self.alarmed = False


def wilson(failures: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Confidence bounds of a rate (Wilson 1927); ``z`` standard deviations, 1.96 for 95 %."""
    if not trials:
        return 0.0, 1.0
    rate = failures / trials
    square = z * z / trials
    centre = (rate + square / 2) / (1 + square)
    half = z * math.sqrt(rate * (1 - rate) / trials + square / trials / 4) / (1 + square)
    return max(0.0, centre - half), min(1.0, centre + half)
