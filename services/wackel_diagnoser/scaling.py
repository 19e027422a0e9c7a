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
        count: Rows.
        first: Factor of the variance before driving has shown anything.
        least: Smallest factor; half a minute of luck shall not make it smaller.

    Attributes:
        factors: Of the variances, shape (M,).
    """

    def __init__(self, count: int, first: float, least: float) -> None:
        self._least = np.array(least)
        self._seconds = np.full(count, TRUST_S)
        self._fourth = np.full(count, 3.0 * first**2)
        self.factors: Floats = np.full(count, first)

    def learn(self, squares: Floats, weight: Bools, seconds: float) -> None:
        """Takes in normalised squares of residuals.

        Args:
            squares: Each by its unscaled variance, so 1 on average if that is right.
            weight: Which of them say anything.
            seconds: For how long they stand.
        """
        heard = weight * seconds
        self._seconds += heard
        np.minimum(self._seconds, _MEMORY_S, out=self._seconds)
        bounded = np.minimum(squares * squares, _OUTLIER * self._fourth)
        bounded -= self._fourth
        bounded *= heard / self._seconds
        self._fourth += bounded
        self.factors = np.minimum(np.maximum(np.sqrt(self._fourth / _NORMAL), self._least), _MOST)
