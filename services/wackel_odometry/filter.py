"""The Kalman filter: a planar robot whose twist is measured by rows, and whose gyros have a bias.

State: pose [x, y, θ], twist [vx, vy, ω] in the robot's own frame, bias of each gyro. The twist is
the mean of the latest step, and the pose moves by its exponential (:mod:`wackel_kinematics.planar`)
within the same prediction; what a measurement then corrects of the twist, it corrects of the pose
too, so the estimate does not lag behind the measurements.
"""

import math
import struct
from collections.abc import Callable

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from msgspec import Struct
from scipy.linalg.lapack import dpotrf, dtrtri

from wackel_kinematics.array import Bools, Floats

POSE = slice(0, 3)
TWIST = slice(3, 6)
OMEGA = 5
FIRST_BIAS = 6

AGILITY = np.array([0.4, 0.4, 10.0])
"""Density of the twist's random walk, (m/s²)² s and (rad/s²)² s: 2 m/s² and 10 rad/s² kept up for
0.1 s, a servo robot that starts or stops. The measurements of one step outweigh it by far, so it
only says how much of the earlier twist is left to judge them by."""
START = np.diag(AGILITY * 0.1)
"""Of that random walk for 0.1 s, by which a robot at rest may drive in the next step."""
UNKNOWN_TWIST = (1.0, 1.0, 4.0)
"""Squares of m/s, m/s and rad/s, that a robot may drive with of which nothing is known."""
BIAS_TIME_S = 100.0
"""Time in which a gyro's bias wanders by its stability."""
FASTEST = 1e3
"""m/s or rad/s; a twist beyond is a failure of the arithmetic."""


class Expected(Struct, frozen=True, gc=False):
    """Measurements beside what the state says of them.

    Attributes:
        innovation: How far they are off it, shape (m,).
        seen: Covariance of them and the state, H P, shape (m, 6 + g).
        spread: Of them, without their own errors, H P Hᵀ, shape (m, m).
    """

    innovation: Floats
    seen: Floats
    spread: Floats

    def only(self, kept: Bools) -> "Expected":
        """Some of them."""
        return Expected(self.innovation[kept], self.seen[kept], self.spread[np.ix_(kept, kept)])


class Estimate(Struct, frozen=True, gc=False):
    """A state in single numbers: for so few, Python is faster with them than numpy.

    Attributes:
        x: The state, as :class:`PlanarFilter` orders it: 6 + g numbers in m, rad and their rates.
        covariance: Of it, row by row: (6 + g)² numbers.
        variances: Of each number of the state.
    """

    x: list[float]
    covariance: list[float]
    variances: list[float]

    @property
    def sound(self) -> bool:
        """Whether the state is one: finite, of this world, with variances that are not negative."""
        return (
            math.isfinite(sum(self.x) + sum(self.covariance))  # not so if any of them is not
            and min(self.variances) >= 0.0
            and max(map(abs, self.x[TWIST])) < FASTEST
        )


def whitening(s: Floats) -> Floats:
    """L⁻¹ of S = L Lᵀ, which makes errors with this covariance independent, of variance 1.

    Args:
        s: Positive definite, shape (m, m).

    Returns:
        Lower triangular, shape (m, m). It is NaN where S has a NaN, and nonsense where S is not
        positive definite; neither raises: :attr:`Estimate.sound` finds it in the state.
    """
    # LAPACK without the checks of numpy and scipy, which take longer than a matrix of this size. To
    # invert or solve, potri and trtrs take longer than this and the products that it needs.
    white: Floats = dtrtri(dpotrf(s, 1)[0], 1)[0]
    return white


class PlanarFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """The state and its covariance; shapes (6 + g,) and (6 + g, 6 + g).

    Args:
        bias_sigma: Standard deviation of each gyro's bias at the start, rad/s, shape (g,).
        bias_stability: Of each, rad/s, shape (g,).
    """

    def __init__(self, bias_sigma: Floats, bias_stability: Floats) -> None:
        size = FIRST_BIAS + len(bias_sigma)
        super().__init__(dim_x=size, dim_z=1)
        self._bias_variance = np.square(bias_sigma)
        self._walk = np.diag(
            np.concatenate([np.zeros(3), AGILITY, np.square(bias_stability) / BIAS_TIME_S])
        )
        # Much faster than to set single numbers of an array.
        rows = "=" + f"6d{8 * len(bias_sigma)}x" * 3
        self._pack_pose: Callable[..., None] = struct.Struct("=3d").pack_into
        self._pack_pose_rows: Callable[..., None] = struct.Struct(rows).pack_into
        self.seconds = 0.0
        self.restart()

    def restart(self) -> None:
        """Forgets everything: at the origin, at rest, biases unknown."""
        self.x = np.zeros(self.dim_x)
        self.P = np.diag(np.concatenate([np.zeros(6), self._bias_variance]))

    def forget_bias(self, number: int, off: float) -> None:
        """The bias of a gyro is as unknown as at the start, or as it seems to be ``off``, rad/s.

        Else one far beyond its data sheet would never be believed, nor told.
        """
        at = FIRST_BIAS + number
        self.P[at, :] = self.P[:, at] = 0.0
        self.P[at, at] = max(self._bias_variance[number], off**2)

    def widen_pose(self, position_sigma: float, heading_sigma: float) -> None:
        """The robot may have moved unseen; the twist of before says nothing any more."""
        self.P[POSE, POSE] += np.diag([position_sigma**2, position_sigma**2, heading_sigma**2])
        self.x[TWIST] = 0.0
        self.P[TWIST, :] = self.P[:, TWIST] = 0.0
        self.P[TWIST, TWIST] = np.diag(UNKNOWN_TWIST)

    def may_start(self) -> None:
        """The robot has stood, and may do so no more; nothing changes at once as much as then."""
        self.P[TWIST, TWIST] += START

    def turn_back(self, turned_rad: float) -> None:
        """It has turned by so much less than was thought, and does not turn as was thought."""
        self.x[2] -= turned_rad
        self.may_start()

    def set_pose(self, pose: Floats, position_sigma: float, heading_sigma: float) -> None:
        """The robot is here, known so well; all that was correlated with the old pose is not."""
        self.x[POSE] = pose
        self.P[POSE, :] = self.P[:, POSE] = 0.0
        self.P[POSE, POSE] = np.diag([position_sigma**2, position_sigma**2, heading_sigma**2])

    def predict(self, u: float = 0.0) -> None:
        """As filterpy's, without its copies."""
        self.predict_x(u)
        self.P = self.F.dot(self.P).dot(self.F.T)

    def predict_x(self, u: float = 0.0) -> None:  # noqa: ARG002 (filterpy's signature)
        """Moves the state on by ``seconds`` and sets F accordingly.

        What wanders meanwhile has done so before the pose moves by it.
        """
        dt = self.seconds
        x, y, theta, vx, vy, omega = self.x[:FIRST_BIAS].tolist()
        half = omega * dt / 2
        middle = theta + half
        chord = math.sin(half) / half * dt if half else dt
        cos, sin = math.cos(middle) * chord, math.sin(middle) * chord
        dx, dy = cos * vx - sin * vy, sin * vx + cos * vy
        self._pack_pose(self.x, 0, x + dx, y + dy, theta + omega * dt)
        # fmt: off
        self._pack_pose_rows(
            self.F, 0,
            1.0, 0.0, -dy, cos, -sin, -dy * dt / 2,
            0.0, 1.0, dx, sin, cos, dx * dt / 2,
            0.0, 0.0, 1.0, 0.0, 0.0, dt,
        )
        # fmt: on
        self.P += dt * self._walk

    def expect(self, z: Floats, h: Floats) -> Expected:
        """Holds measurements against the state.

        Args:
            z: Shape (m,).
            h: Their rows, H, shape (m, 6 + g).
        """
        seen = h.dot(self.P)
        return Expected(z - h.dot(self.x), seen, seen.dot(h.T))

    def correct(self, measured: Expected, noise: Floats, learn_bias: bool) -> None:
        """Takes in measurements.

        Where they may not change the biases, these are considered instead (Schmidt): their
        uncertainty counts, but errors of the wheels cannot leak into them. filterpy's ``update``
        knows no such thing; where they may, both give the same.

        Args:
            measured: As the present state expects them.
            noise: Covariance of their errors, R, shape (m, m).
            learn_bias: Whether they may change the biases.
        """
        seen = measured.seen
        white = whitening(measured.spread + noise)
        root = white.dot(seen)
        change = white.dot(measured.innovation).dot(root)
        # K S Kᵀ for the optimal gain; a matrix by itself is symmetric to the last digit, for ever.
        known = root.T.dot(root)
        if not learn_bias:
            # Without the gain's rows of the biases, their block stays as it is.
            change[FIRST_BIAS:] = 0.0
            known[FIRST_BIAS:, FIRST_BIAS:] = 0.0
        self.x += change
        self.P -= known

    def estimate(self) -> Estimate:
        """The state as it is now."""
        covariance: list[float] = self.P.ravel().tolist()
        return Estimate(self.x.tolist(), covariance, covariance[:: self.dim_x + 1])
