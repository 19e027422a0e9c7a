"""Forward kinematics: the twist that fits all rows best.

Unlike eq. 9, which solves three rows exactly, this uses all of them. For steered wheels it equals
the least squares fit to the wheels' velocity vectors, since c_i and j_i are square to each other.
"""

from typing import NamedTuple

import numpy as np

from wackel_kinematics.array import Floats, Ints, dot, require_finite
from wackel_kinematics.drive import Drive

UNDETERMINED = 1e-12
"""Eigenvalues of the scaled normal matrix below this share of the largest count as 0: with 16
digits, what they determine would have fewer than 4 left."""


class Estimate(NamedTuple):
    """A twist and what it rests on.

    Attributes:
        twist: Shape (..., 3); 0 along directions that no row sees.
        rank: How many directions of the twist the rows see, 3 if it is determined, shape (...).
    """

    twist: Floats
    rank: Ints


def least_squares(
    rows: Floats, values: Floats, length_m: float, weights: Floats | None = None
) -> Estimate:
    """The twist that minimises Σ weight · (row · ξ − value)².

    Args:
        rows: Shape (..., R, 3), any rows on the twist, such as :meth:`Drive.rows`.
        values: m/s, shape (..., R), such as :meth:`Drive.values`.
        length_m: L of the drive, which makes ω comparable with vx and vy.
        weights: One over variance, or 1 and 0 to keep and drop rows, shape (..., R); 1 if None.

    Raises:
        ValueError: A number is not finite, or a weight is negative.
    """
    scale = np.array([1.0, 1.0, 1.0 / length_m])
    scaled = rows * scale
    if weights is None:
        weighted = scaled
    else:
        if np.any(weights < 0):
            raise ValueError("weights must not be negative")
        weighted = scaled * weights[..., None]
    normal = weighted.mT @ scaled
    right = np.vecdot(weighted.mT, values[..., None, :])
    require_finite(normal, "rows and weights")
    require_finite(right, "values")
    eigenvalues, vectors = np.linalg.eigh(normal)
    seen = eigenvalues > UNDETERMINED * eigenvalues[..., 2:]
    along = np.vecdot(vectors.mT, right[..., None, :])
    along = np.divide(along, eigenvalues, out=np.zeros_like(along), where=seen)
    twist = np.vecdot(vectors, along[..., None, :]) * scale
    return Estimate(twist, np.broadcast_to(seen.sum(axis=-1), twist.shape[:-1]))


def forward(
    drive: Drive, steering: Floats, wheel_rate: Floats, weights: Floats | None = None
) -> Estimate:
    """The twist that measured wheels say.

    Args:
        drive: The wheels.
        steering: β in rad, shape (..., n).
        wheel_rate: φ̇ in rad/s, shape (..., n).
        weights: As in :func:`least_squares`, in the order of the drive's rows.

    Raises:
        ValueError: A shape does not fit, a number is not finite, or a weight is negative.
    """
    return least_squares(drive.rows(steering), drive.values(wheel_rate), drive.length_m, weights)


def residuals(rows: Floats, values: Floats, twist: Floats) -> Floats:
    """How far each row misses its value, value − row · ξ: m/s, shape (..., R)."""
    return values - dot(rows, twist[..., None, :])
