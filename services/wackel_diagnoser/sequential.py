"""When to speak up, and of what: sequential detection, and isolation with memory.

Detection is a cumulative sum (Page 1954) for each hypothesis against the present verdict. Its
increments are bounded, so that no single outlier raises an alarm, and weakened, since residuals of
neighbouring steps are alike. A cumulative sum of log-likelihood ratios exceeds b by chance about
once in e^b steps (Lorden 1971); with K of them, the threshold for a mean time T between false
alarms at f steps a second is ln(K f T ρ).
"""

import math

import numpy as np

from wackel_kinematics.array import Floats

INDEPENDENT = 0.25
"""ρ: share of a step's evidence that is new; residuals correlate over some four steps."""
BOUND = 6.0
"""Of one step's evidence; an alarm then needs four steps at least, from two wheels to eight."""
FALSE_ALARM_S = 100 * 3600.0
"""Designed mean time between false alarms."""
WORST = 8.0
"""By how much a step may count against a hypothesis beside the best of that step."""
DEEPEST = 20.0
"""And by how much all steps together: an hour without a fault is no evidence against one now. More
than the smallest prior, or nothing could be overcome; with that of a single fault, less than the
four steps that an alarm takes can say."""
MEMORY_S = 0.35
"""Of isolation: what a fault looks like changes with the motion, which changes within a second."""
LEAD = 3.0
"""By how much the best explanation must lead the next to be named at once (e³ = 20 to 1)."""
PATIENCE_S = 0.15
"""After an alarm the best is named after this time even so."""
RISING = 0.25
"""Share of the limit from which evidence may become an alarm; chance is seldom above it."""


# Of numpy's own kind: it takes longer for a number of Python's.
_BOUND, _NOTHING = map(np.array, (BOUND, 0.0))


def threshold(hypotheses: int, rate: float) -> float:
    """At which a cumulative sum raises an alarm."""
    return math.log(hypotheses * rate * FALSE_ALARM_S * INDEPENDENT)


class Sequential:
    """Follows log-likelihoods and decides.

    Hypotheses that name the same components, as sensor or as actuator, are one explanation here.

    Args:
        prior: Logarithms of the hypotheses' prior probabilities, shape (K,).
        same: Which hypotheses name the same components: a number for each, shape (K,), 0 for none.
        limit: Of the cumulative sums.

    Attributes:
        verdict: Number of the explanation that is taken to be true.
        sums: The cumulative sums, shape (K,).
        memory: Fading log-likelihoods, shape (K,), up to a constant.
        alarm_s: For how long there has been an alarm.
        rising_s: For how long there has been evidence that may become one.
        lead: Logarithm of how much likelier what was proposed last is than any other.
    """

    def __init__(self, prior: Floats, same: list[int], limit: float) -> None:
        self._prior = prior
        self._same = np.array(same)
        self._members = [np.flatnonzero(self._same == i).tolist() for i in range(max(same) + 1)]
        self._limit = limit
        self._highest = 0.0
        self.alarm_s = 0.0
        self.rising_s = 0.0
        self.lead = 0.0
        self.verdict = 0
        self.sums = np.zeros(len(prior))
        self.memory = np.zeros(len(prior))

    @property
    def alarm(self) -> float:
        """The largest cumulative sum as a share of its limit."""
        return self._highest / self._limit

    @property
    def at_rest(self) -> bool:
        """Whether nothing is taken to be wrong, and no evidence has begun to sum up."""
        return not (self.verdict or self._highest)

    def step(self, likelihood: Floats, seconds: float, steps: int = 1) -> None:
        """Takes in the log-likelihoods of a step.

        Args:
            likelihood: Shape (K,).
            seconds: Since the last one.
            steps: So many it stands for: itself, and those that were not looked at.
        """
        memory = self.memory
        told = INDEPENDENT * steps * likelihood
        best = _greatest(told)
        usual = max([told.item(i) for i in self._members[self.verdict]])
        # Mostly the verdict explains a step best, and all sums stay 0.
        if self._highest or best > usual:
            self._sum(told - usual, seconds)
        np.maximum(told, best - WORST, out=told)
        memory *= math.exp(-seconds / MEMORY_S)
        memory += told
        np.maximum(memory, _greatest(memory) - DEEPEST, out=memory)

    def _sum(self, evidence: Floats, seconds: float) -> None:
        """Adds the evidence of a step against the verdict, shape (K,), to the sums."""
        sums = self.sums
        sums += np.minimum(evidence, _BOUND)
        np.maximum(sums, _NOTHING, out=sums)
        self._highest = _greatest(sums)
        self.alarm_s = self.alarm_s + seconds if self._highest > self._limit else 0.0
        rises = self._highest > RISING * self._limit
        self.rising_s = self.rising_s + seconds if rises else 0.0

    def posterior(self) -> Floats:
        """Probabilities of the hypotheses, as the last fractions of a second tell, shape (K,)."""
        logarithm = self.memory + self._prior
        probability: Floats = np.exp(logarithm - _greatest(logarithm))
        probability /= sum(probability.tolist())
        return probability

    def proposal(self) -> int | None:
        """Another explanation that should be the verdict, if there is an alarm and one is clear."""
        if not self.alarm_s:
            return None
        logarithm = self.memory + self._prior
        best = int(logarithm.argmax())
        explanation = int(self._same[best])
        if explanation == self.verdict or not self._convinces(best):
            return None
        self.lead = float(logarithm[best] - logarithm[self._same != explanation].max())
        if self.lead < LEAD and self.alarm_s < PATIENCE_S:
            return None
        return explanation

    def speaks_for(self, explanation: int) -> bool:
        """Whether what speaks against the verdict also speaks for an explanation."""
        return any(map(self._convinces, self._members[explanation]))

    def _convinces(self, hypothesis: int) -> bool:
        return bool(self.sums[hypothesis] >= self._limit / 2)

    def accept(self, explanation: int) -> None:
        """Takes an explanation to be true from now on."""
        self.verdict = explanation
        self.sums[:] = 0.0
        self._highest = self.alarm_s = self.rising_s = 0.0

    def discredit(self, explanation: int) -> None:
        """What has spoken for an explanation did not: it must convince anew."""
        self.memory[self._members[explanation]] = _greatest(self.memory) - DEEPEST

    def forget(self) -> None:
        """Time was started anew; the verdict stays."""
        self.sums[:] = 0.0
        self.memory[:] = 0.0
        self._highest = self.alarm_s = self.rising_s = 0.0


def _greatest(values: Floats) -> float:
    """As ``max``, in half the time."""
    return values.item(values.argmax())
