"""What driving costs, and what is left over: the power that wheels rub away on the floor.

A wheel that stands askew slips, and whatever else tyres and floor are like, its friction times its
slip is power that the rolling motors deliver, most of it those of other wheels. Stiff tyres that
hide from the gyro and the encoders that a wheel is dragged cannot hide that. Taken off before is
what driving itself costs, learnt while nothing is wrong: friction of the drives by the square of
speed and by speed, and kinetic energy of the robot as it moves and as it turns.
"""

import math

import numpy as np

from wackel_kinematics.array import Floats

LONG_S = 40.0
"""Of driving, in which that is learnt: as long as :mod:`wackel_diagnoser.scaling` takes."""
LEARNT_S = 8.0
"""From which on it may be known."""
KNOWN = 100.0
"""Square of what acceleration costs by its uncertainty: the unit of all forces, so 10 %."""
NEW_HZ = 3.0
"""Moments a second that tell something new."""
REGULAR = 1e-3 * np.eye(4)
"""What has not been seen costs nothing."""


class SlipPower:
    """Learns what driving costs.

    Power is in A m/s, the sum of current times speed; divided by what acceleration costs, it
    becomes power by mass.
    """

    def __init__(self) -> None:
        self._normal: Floats = np.zeros((4, 4))
        self._right = np.zeros(4)
        self._square = 0.0
        self._seconds = 0.0
        self._needs: Floats = np.zeros(4)
        self._known = False

    @property
    def mass(self) -> float:
        """What each motor needs by acceleration, A s²/m; 0 until it is known."""
        return max(float(self._needs[1]), 0.0)

    def left(self, power: float, causes: Floats, rolling: int) -> float:
        """What slip takes, by the mass of the robot, m²/s³; NaN if unknown.

        Args:
            power: Of the rolling motors, A m/s.
            causes: Sum of the wheels' squares of speed, change of half of that by time, the same of
                the robot's yaw rate, and sum of speeds.
            rolling: How many motors share the mass.
        """
        if not self._known:
            return math.nan
        by_mass = self.mass * rolling
        return (power - float(self._needs.dot(causes))) / by_mass

    def learn(self, power: float, causes: Floats, seconds: float) -> None:
        """Takes in a moment in which nothing is wrong."""
        if not math.isfinite(power + sum(causes.tolist())):
            return
        fade = 1.0 - seconds / LONG_S
        self._seconds = fade * self._seconds + seconds
        told = seconds * causes
        self._normal *= fade
        self._normal += told[:, None] * causes
        self._right *= fade
        self._right += power * told
        self._square = fade * self._square + seconds * power * power
        needs = self._needs = np.asarray(np.linalg.solve(self._normal + REGULAR, self._right))
        left = max(self._square - float(needs.dot(self._right)), 0.0) / self._seconds
        accelerated = NEW_HZ * float(self._normal[1, 1]) * max(float(needs[1]), 0.0) ** 2
        self._known = self._seconds > LEARNT_S and accelerated > KNOWN * left
