"""What each gyro shows when nothing turns, learnt from wheels and gyros together."""

from collections.abc import Sequence

import numpy as np

from wackel_kinematics.array import Bools, Floats
from wackel_node.config_drive import GyroConfig

SYSTEMATIC = 30.0
"""Yaw rates of wheels that move are off by the same for seconds: so many steps count as one."""
WANDERING_S = 100.0
"""The time that ``bias_stability`` is about."""


class GyroBias:
    """A Kalman filter of one number for each gyro.

    Attributes:
        value: rad/s, shape (g,).
        variance: Of that.
    """

    def __init__(self, gyros: Sequence[GyroConfig]) -> None:
        self.value: Floats = np.zeros(len(gyros))
        # A data sheet's limit is taken for three standard deviations.
        self.variance: Floats = np.array([(gyro.bias_limit / 3) ** 2 for gyro in gyros])
        self._wander = [gyro.bias_stability**2 / WANDERING_S for gyro in gyros]

    def learn(
        self,
        off: Floats,
        variance: Floats,
        left: Floats,
        seen: Bools,
        *,
        seconds: float,
        moving: bool,
    ) -> None:
        """Takes in a step.

        Args:
            off: By how much each gyro is off the estimate, in which it is itself, rad/s.
            variance: Of what each shows, (rad/s)².
            left: What of that is left of ``off``, (rad/s)².
            seen: Which of them say anything.
            seconds: For how long they stand.
            moving: Whether the robot does.
        """
        alike = SYSTEMATIC if moving else 1.0
        values, variances = self.value.tolist(), self.variance.tolist()
        # Single numbers: for a gyro or two, Python is faster with them than numpy.
        each = zip(off.tolist(), variance.tolist(), left.tolist(), seen.tolist(), strict=True)
        for i, (miss, whole, part, known) in enumerate(each):
            variances[i] += self._wander[i] * seconds
            if known:
                # By how much it is off what all others say, and the variance of that.
                others = whole / part
                noise = max(others * whole - variances[i], 1e-12) * alike
                gain = variances[i] / (variances[i] + noise)
                values[i] += gain * others * miss
                variances[i] *= 1.0 - gain
        self.value, self.variance = np.array(values), np.array(variances)
