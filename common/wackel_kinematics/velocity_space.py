"""Velocity space (section 3.1): which twists a drive can do at given steering angles.

Each slide row is the normal of a plane through the origin of {vx, vy, ω}; the twists possible
without slip are where the planes meet: null(C₁) (eq. 6). Two planes meet in a line; real wheels are
never aligned exactly, so a tolerance decides what still counts as meeting.
"""

import math
from typing import NamedTuple

import numpy as np

from wackel_kinematics.array import Floats, Ints, require_finite
from wackel_kinematics.drive import Drive

ALIGNED = math.sin(math.radians(1.0))
"""Root sum of squares of the slide rows (scaled, length 1) along a unit twist below which the drive
counts as free to move that way: 1°, the misalignment of steering that nobody has calibrated."""


class VelocitySpace(NamedTuple):
    """How strongly the wheels resist motion, by direction.

    Attributes:
        directions: Three twists, the freest first, [vx, vy, ω] each of length 1 as [vx, vy, L ω]
            and square to each other in that scale, shape (..., 3, 3), a direction in each row.
        resistance: Root sum of squares of the unit slide rows along each, ascending, (..., 3).
        mobility: Number of directions that count as free: 3 − rank C₁, shape (...). At 1 the drive
            moves along the first direction and nowhere else; at 0 it is locked.
    """

    directions: Floats
    resistance: Floats
    mobility: Ints


def velocity_space(drive: Drive, steering: Floats, tolerance: float = ALIGNED) -> VelocitySpace:
    """The twists that steering angles allow.

    Args:
        drive: The wheels.
        steering: β in rad, shape (..., n).
        tolerance: Resistance below which a direction counts as free.

    Raises:
        ValueError: A shape does not fit, or a number is not finite.
    """
    normals = drive.scaled_unit(drive.rows(steering)[..., : drive.slide_count, :])
    require_finite(normals, "steering")
    eigenvalues, vectors = np.linalg.eigh(normals.mT @ normals)
    resistance = np.sqrt(np.maximum(eigenvalues, 0.0))
    directions = drive.scaled(np.ascontiguousarray(vectors.mT))
    return VelocitySpace(directions, resistance, (resistance < tolerance).sum(axis=-1))
