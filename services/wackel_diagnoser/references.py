"""Steering whose zero is wrong: the one fault that no reading shows.

A wheel that points elsewhere than it says drags the whole robot aside: least squares over all rows
gives δω = (a · c_i) (j_i · ξ) δ_i for an error δ_i of the steering of wheel i, where a is the last
row of (Σ cᵀc + jᵀj)⁻¹, a constant. Errors of radii act alike. Only the gyro shows it, so all errors
are estimated together from the yaw rates of gyro and wheels, with the errors of calibration as
prior; an error far beyond its prior is a fault if no other explains the yaw rates as well.
"""

import math
from dataclasses import dataclass

import numpy as np

from wackel_diagnoser.rows import Measured, Rows
from wackel_drive.layout import Layout
from wackel_node.config_drive import DriveConfig

BLOCK_S = 0.1
"""Yaw rates are compared as means over this: encoder steps and misaligned stamps cancel."""
MEMORY_S = 30.0
"""Some turns in both directions."""
LOOK_S = 0.5
AT_FIRST_S = 15.0
"""Before so much driving the gyro's bias and a wrong zero are not told apart."""
LEAST_RAD = math.radians(3.0)
"""Smaller errors are calibration."""
WIDE_RAD = 0.3
"""By how much a zero may be wrong."""
SURE = 14.0
"""Logarithm of how much better it explains the yaw rates than calibration does: once in 100 h by
chance, if the memory is new every 30 s and there are 8 wheels."""
CLEAR = 6.0
"""And by how much it must be better than for any other wheel."""
NOISE = 0.01
"""rad/s by which the yaw rates of gyro and wheels differ in a block in fault-free driving."""
INDEPENDENT = 0.25
"""Share of a block that is new: they differ by the same for some tenths of a second."""


@dataclass(frozen=True)
class WrongZero:
    """A zero that is wrong.

    Attributes:
        wheel: Number.
        angle: rad to the left.
        sigma: Standard deviation.
        sure: Logarithm of the likelihood ratio.
    """

    wheel: int
    angle: float
    sigma: float
    sure: float


class ReferenceErrors:
    """Estimates them.

    Args:
        layout: The drive.
        config: The same, as configured.
        rows: How its measurements are numbered.

    Attributes:
        found: The zero that is known to be wrong.
    """

    def __init__(self, layout: Layout, config: DriveConfig, rows: Rows) -> None:
        drive = layout.drive
        slides, rolls = drive.slide_wheels, drive.roll_wheels
        self._rows = rows
        self._possible = len(slides) == len(rolls) == drive.n and bool(drive.steers.all())
        self._n = n = drive.n
        constraints = drive.rows(drive.steering(np.zeros(n)))
        normal = constraints.T @ constraints
        self._yaw = np.linalg.inv(normal + 1e-9 * np.eye(3))[2]
        sigma = np.concatenate(
            [np.full(n, config.steering_error), np.full(n, config.radius_error), [0.02]]
        )
        self._prior = 1.0 / sigma**2
        self._information = np.zeros((2 * n + 1, 2 * n + 1))
        self._right = np.zeros(2 * n + 1)
        self._open = np.zeros(2 * n + 2)
        self._open_s = 0.0
        self._since_look = 0.0
        self._driven_s = 0.0
        self.found: WrongZero | None = None

    def step(self, measured: Measured, seconds: float) -> None:
        """Takes in rows in which nothing else is suspected, and for how long they stand."""
        gyros = measured.z[self._rows.gyros]
        # While wheels turn they slip, which looks like any of them standing off.
        where = self._rows.gyros
        calm = bool((measured.loose[where] < measured.base[where]).all())
        if not (self._possible and len(gyros) and calm and bool(measured.present.all())):
            self._open[:] = 0.0
            self._open_s = 0.0
            return
        n = self._n
        seen = measured.h[: 2 * n] @ self._yaw
        rolled = measured.z[self._rows.rolls]
        block = self._open
        block[:n] += seconds * seen[:n] * rolled
        block[n : 2 * n] += seconds * seen[n:] * rolled
        block[2 * n] += seconds * float(seen[n:] @ rolled)
        block[2 * n + 1] += seconds * (float(gyros.mean()) - float(seen[n:] @ rolled))
        self._open_s += seconds
        self._since_look += seconds
        self._driven_s += seconds
        if self._open_s >= BLOCK_S:
            mean = block / self._open_s
            row, off = mean[:-1], float(mean[-1])
            fade = math.exp(-self._open_s / MEMORY_S)
            share = INDEPENDENT * self._open_s / BLOCK_S / NOISE**2
            self._information = fade * self._information + share * np.outer(row, row)
            self._right = fade * self._right + share * off * row
            block[:] = 0.0
            self._open_s = 0.0
        if self._since_look >= LOOK_S and self._driven_s >= AT_FIRST_S:
            self._since_look = 0.0
            self.found = self._look()

    def _look(self) -> WrongZero | None:
        """The error that explains most beyond calibration, if it is sure and clear."""
        n = self._n
        covariance = np.linalg.inv(self._information + np.diag(self._prior))
        estimate = covariance @ self._right
        less = self._prior[:n] - 1 / WIDE_RAD**2
        own = covariance.diagonal()[:n]
        # A wide prior for one of them: a rank-one change.
        left = 1.0 - less * own
        sure = 0.5 * (less * estimate[:n] ** 2 / left + np.log(1 / WIDE_RAD**2 / self._prior[:n]))
        sure -= 0.5 * np.log(left)
        best = int(sure.argmax())
        angle = float(estimate[best] / left[best])
        sigma = math.sqrt(float(own[best] / left[best]))
        others = np.delete(sure, best).max()
        known = self.found is not None and self.found.wheel == best
        enough = SURE / 2 if known else SURE
        clear = CLEAR / 2 if known else CLEAR
        if abs(angle) < LEAST_RAD or sure[best] < enough or sure[best] - others < clear:
            return None
        return WrongZero(best, angle, sigma, float(sure[best]))
