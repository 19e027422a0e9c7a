"""How large residuals are when nothing is wrong: learnt while driving.

Calibration that is three times worse than assumed, a rough floor, play in the steering: all of it
shows in fault-free driving, row by row, and would be taken for faults. So variances are scaled by
what a row's own normalised residual has been. Its fourth moment decides, not its second: residuals
come in bursts, and it is the bursts that raise alarms; of normal noise both say the same
(E x⁴ = 3 σ⁴).
"""

import numpy as np

from wackel_kinematics.array import Bools, Floats

TRUST_S = 0.1
"""For how much driving the first factors count."""
MEMORY_S = 40.0
"""Longer than any manoeuvre, shorter than a floor stays the same."""
MOST = 200.0
"""14 times worse than assumed is no calibration any more."""
OUTLIER = 100.0
"""Fourth power, by what it is on average, beyond which one residual teaches no more."""

# Of numpy's own kind: it takes longer for a number of Python's.
_MEMORY_S, _OUTLIER, _MOST, _NORMAL = map(np.array, (MEMORY_S, OUTLIER, MOST, 3.0))


class Scaling:
    """Scales of the variances.

    Args:
        first: Factor of each variance before driving has shown anything, of any shape.
        least: Smallest factor of each, or of all; half a minute of luck shall not make it smaller.

    Attributes:
        factors: Of the variances, shape as of the first.
    """

    def __init__(self, first: Floats, least: Floats | float) -> None:
        self._least = np.full(first.shape, least)
        self._seconds = np.full(first.shape, TRUST_S)
        self._fourth = 3.0 * first**2
        self.factors = first

    def learn(self, squares: Floats, weight: Bools, seconds: float) -> None:
        """Takes in normalised squares of residuals.

        Args:
            squares: Each by its unscaled variance, so 1 on average if that is right.
            weight: Which of them say anything.
            seconds: For how long they stand.
        """
        heard = weight * np.array(seconds)
        self._seconds += heard
        np.minimum(self._seconds, _MEMORY_S, out=self._seconds)
        bounded = squares * squares
        np.minimum(bounded, _OUTLIER * self._fourth, out=bounded)
        bounded -= self._fourth
        heard /= self._seconds
        bounded *= heard
        self._fourth += bounded
        factors = self.factors = np.sqrt(self._fourth / _NORMAL)
        np.maximum(factors, self._least, out=factors)
        np.minimum(factors, _MOST, out=factors)
