"""Sensor or actuator: Step IV as numbers, and what the motors need.

Without the suspected rows the others say how the robot would move if only a sensor were wrong; with
them, how it moves if the part really does what it shows. The gyro shows some share of the
difference: none for a sensor, some for an actuator. And an actuator that fights the floor costs
current: its own, or that of the others.
"""

import math

import numpy as np

from wackel_diagnoser.hypotheses import Class
from wackel_diagnoser.rows import Measured
from wackel_kinematics.array import Bools, Floats

SHARE = 0.15
"""Share of the expected yaw change from which on an actuator is meant: blocked wheels show 0.08 to
0.3, steerings that stand off 0.4 to 1, sensors 0.00 ± 0.03."""
STRAINED = 2.0
"""A motor's current by what is usual, from which on it fights something."""
OTHERS_STRAINED = 1.5
"""The same of the other wheels' motors together, which share the load."""
WINDOW_S = 1.5
"""How long after the onset a kind is still reconsidered."""


class KindTest:
    """Gathers evidence on one component since it was suspected.

    Args:
        spoilt: Rows that the component spoils, without the gyro's.
        gyros: Where the gyros stand among the rows.
        wheels: Which efforts are its own motor's.
        rolling: Which efforts are rolling motors'.
    """

    def __init__(self, spoilt: Bools, gyros: slice, own: int, rolling: int) -> None:
        self._spoilt = spoilt
        self._gyros = gyros
        self._own = own
        self._others = np.arange(rolling) != own
        self.seconds = 0.0
        self._xx = self._xe = self._noise = 0.0
        self._weight = 0.0
        self._strain = self._others_strain = math.nan

    def step(
        self, measured: Measured, variance: Floats, ratio: Floats | None, seconds: float
    ) -> None:
        """Takes in a step; ``ratio``: efforts by what is usual, if that is known."""
        self.seconds += seconds
        weight = np.where(measured.present, 1.0 / variance, 0.0)
        weight[self._gyros] = 0.0
        yaw_all = _yaw(measured, weight)
        weight[self._spoilt] = 0.0
        yaw = _yaw(measured, weight)
        heard = measured.present[self._gyros]
        if yaw_all is not None and yaw is not None and heard.any():
            expected = yaw_all[0] - yaw[0]
            shown = float(measured.z[self._gyros][heard].mean()) - yaw[0]
            noise = float(variance[self._gyros][heard].mean()) + yaw[1]
            self._xx += expected * expected / noise
            self._xe += expected * shown / noise
        if ratio is not None:
            own = float(ratio[self._own])
            others = ratio[: len(self._others)][self._others]
            self._strain = own if not self._strain >= own else self._strain
            together = float(np.sqrt(np.mean(others * others))) if len(others) else math.nan
            strain = self._others_strain
            self._others_strain = together if not strain >= together else strain

    @property
    def share(self) -> float:
        """Of the expected yaw change that the gyro shows; NaN while it cannot tell."""
        # The residuals correlate; a tenth of the steps is new.
        return self._xe / self._xx if self._xx * 0.1 > (2 / SHARE) ** 2 else math.nan

    @property
    def strains(self) -> tuple[float, float]:
        """Greatest effort by what is usual: its own motor's, and the other wheels'."""
        return self._strain, self._others_strain

    def kind(self) -> Class:
        """What it is, as far as the evidence goes; a sensor where nothing says otherwise."""
        strain, others = self.strains
        if strain > STRAINED or others > OTHERS_STRAINED or self.share > SHARE:
            return "actuator"
        return "sensor"


def _yaw(measured: Measured, weight: Floats) -> tuple[float, float] | None:
    """Yaw rate that rows say, and its variance; ``None`` if they do not determine it."""
    weighted = measured.h * weight[:, None]
    normal = weighted.T @ measured.h
    normal.flat[::4] += 1e-4
    covariance = np.linalg.inv(normal)
    if not covariance[2, 2] < 1.0:
        return None
    return float(covariance[2] @ (weighted.T @ measured.z)), float(covariance[2, 2])
