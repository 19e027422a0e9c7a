"""Rigid motion in the plane: velocity of points, centre of rotation, poses.

A pose is [x, y, θ] in m, m, rad. Exponential: Lynch, Park, "Modern Robotics", section 3.3.3,
restricted to the plane.
"""

import numpy as np

from wackel_kinematics.array import Floats

_LEFT_OF = np.array([-1.0, 1.0])
"""By which (y, x) becomes the point a quarter turn to the left."""


def velocity_at(twist: Floats, point: Floats) -> Floats:
    """Velocity of a point that moves with the robot: v + ω × p.

    Args:
        twist: Shape (..., 3).
        point: Robot frame, m, shape (..., 2).

    Returns:
        m/s, shape (..., 2).
    """
    return np.asarray(twist[..., :2] + twist[..., 2:] * (point[..., ::-1] * _LEFT_OF))


def instantaneous_centre(twist: Floats) -> Floats:
    """Instantaneous centre of rotation (eq. 2): the point of the robot frame that stands still.

    Args:
        twist: Shape (..., 3).

    Returns:
        [−vy/ω, vx/ω] in m, shape (..., 2); NaN where ω is 0, infinite where it is next to it.
    """
    vx, vy, omega = twist[..., 0], twist[..., 1], twist[..., 2:]
    centre = np.full((*twist.shape[:-1], 2), np.nan)
    with np.errstate(over="ignore"):
        np.divide(np.stack([-vy, vx], axis=-1), omega, out=centre, where=omega != 0)
    return centre


def exponential(displacement: Floats) -> Floats:
    """Pose reached from the origin by a constant twist.

    Args:
        displacement: Twist times duration, [m, m, rad], shape (..., 3).

    Returns:
        Pose, shape (..., 3).
    """
    dx, dy, theta = displacement[..., 0], displacement[..., 1], displacement[..., 2]
    # sin θ / θ and (1 − cos θ) / θ in the forms that stay exact as θ vanishes.
    along = np.sinc(theta / np.pi)
    across = np.sin(theta / 2) * np.sinc(theta / (2 * np.pi))
    return np.stack([along * dx - across * dy, across * dx + along * dy, theta], axis=-1)


def compose(pose: Floats, step: Floats) -> Floats:
    """The pose reached by a step stated in the pose's own frame; shapes (..., 3)."""
    x, y, theta = pose[..., 0], pose[..., 1], pose[..., 2]
    cos, sin = np.cos(theta), np.sin(theta)
    return np.stack(
        [
            x + cos * step[..., 0] - sin * step[..., 1],
            y + sin * step[..., 0] + cos * step[..., 1],
            theta + step[..., 2],
        ],
        axis=-1,
    )
