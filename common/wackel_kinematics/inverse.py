"""Inverse kinematics: steering and wheel rates for a twist, with steering that never jumps.

A wheel at β rolling forward and one at β + π rolling backward are the same constraint. Of the two,
the one nearer to where the wheel stands is taken, so a steering command moves by at most π/2 and
follows a path of twists without jumps, even where the centre of rotation passes a contact.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wackel_kinematics.array import Bools, Floats, dot, last_axis
from wackel_kinematics.drive import Drive
from wackel_kinematics.planar import velocity_at

STANDSTILL_M_S = 1e-3
"""Contact speed below which its direction is no reason to steer. At this speed a robot needs 10 s
for a centimetre, and a controller's rounding at rest stays below it."""


class WheelMotion(NamedTuple):
    """What the wheels shall do; shapes (..., n).

    Attributes:
        steering: β in rad, not wrapped, as near as allowed to where each wheel stood.
        wheel_rate: φ̇ in rad/s at that β (eq. 3); 0 for wheels without a roll row.
        slip: c · ξ in m/s (eq. 4): sideways slip that the twist forces on each wheel at that β. Not
            0 if the drive cannot do the twist, or its wheels are not turned yet.
    """

    steering: Floats
    wheel_rate: Floats
    slip: Floats


def inverse(
    drive: Drive, twist: Floats, steering: Floats, max_step_rad: float = math.inf
) -> WheelMotion:
    """Wheel motion for a twist, from where the wheels stand.

    Wheels whose contact stands still (:data:`STANDSTILL_M_S`) keep their angle. Wheels that cannot
    turn far enough in this step roll at the projection of the wanted velocity, which brakes them
    least while they turn.

    Args:
        drive: The wheels.
        twist: Shape (..., 3).
        steering: β now, the last command or the measured one, rad, shape (..., n).
        max_step_rad: How far a wheel may turn in this step: greatest steering rate times period.

    Raises:
        ValueError: A shape does not fit, or the greatest step is negative.
    """
    if not max_step_rad >= 0:
        raise ValueError(f"max_step_rad is {max_step_rad}, expected 0 or more")
    twist = last_axis(twist, 3, "twist")
    now = drive.beta(steering)
    heading = drive.heading(now)
    velocity, moving = _contacts(drive, twist)
    step = np.arctan2(velocity[..., 1], velocity[..., 0]) - heading
    step -= math.pi * np.rint(step / math.pi)
    if max_step_rad < math.pi / 2:
        step = np.clip(step, -max_step_rad, max_step_rad)
    step = np.where(moving & drive.steers, step, 0.0)
    beta = now + step

    seen = dot(drive.rows_along(heading + step), twist[..., None, :])
    wheel_rate, slip = np.zeros_like(beta), np.zeros_like(beta)
    slip[..., drive.slide_wheels] = seen[..., : drive.slide_count]
    wheel_rate[..., drive.roll_wheels] = seen[..., drive.slide_count :] / drive.roll_radius
    return WheelMotion(beta, wheel_rate, slip)


def wheel_goals(
    drive: Drive, twist: tuple[float, float, float], heading: Sequence[float]
) -> tuple[list[float], list[float]]:
    """As :func:`inverse` of one twist, up to rounding and in a quarter of the time.

    Args:
        drive: The wheels.
        twist: m/s, m/s, rad/s.
        heading: Rolling directions now, of all wheels, fixed or not; rad.

    Returns:
        Heading and wheel rate of each wheel.
    """
    # For some wheels, Python is faster with single numbers than numpy.
    vx, vy, omega = twist
    goal = list(heading)
    for i, ((x, y), steers) in enumerate(
        zip(drive.xy.tolist(), drive.steers.tolist(), strict=True)
    ):
        along, left = vx - omega * y, vy + omega * x
        if steers and math.hypot(along, left) >= STANDSTILL_M_S:
            step = math.atan2(left, along) - goal[i]
            goal[i] += step - math.pi * round(step / math.pi)
    seen = drive.known_rows(goal)[0].dot(twist).tolist()
    rate = [0.0] * drive.n
    for wheel, radius, speed in zip(
        drive.roll_wheels.tolist(),
        drive.roll_radius.tolist(),
        seen[drive.slide_count :],
        strict=True,
    ):
        rate[wheel] = speed / radius
    return goal, rate


def steering_rate(drive: Drive, twist: Floats, twist_rate: Floats) -> Floats:
    """Feed-forward dβ/dt that keeps wheels aligned with a twist that changes.

    From d/dt (c · ξ) = 0 with dc/dβ = −j follows β̇ = (c · ξ̇) / (j · ξ), here written with contact
    velocity v and its rate a as (v × a) / v², which needs no β.

    Args:
        drive: The wheels.
        twist: Shape (..., 3).
        twist_rate: Its derivative in the robot frame, per s, shape (..., 3).

    Returns:
        rad/s, shape (..., n); 0 for wheels that stand still or do not steer.
    """
    v, moving = _contacts(drive, last_axis(twist, 3, "twist"))
    a = velocity_at(last_axis(twist_rate, 3, "twist rate")[..., None, :], drive.xy)
    turning = v[..., 0] * a[..., 1] - v[..., 1] * a[..., 0]
    return np.divide(turning, dot(v, v), out=np.zeros_like(turning), where=moving & drive.steers)


def _contacts(drive: Drive, twist: Floats) -> tuple[Floats, Bools]:
    """Velocity of each contact, m/s, (..., n, 2), and whether it moves, (..., n)."""
    velocity = velocity_at(twist[..., None, :], drive.xy)
    return velocity, np.hypot(velocity[..., 0], velocity[..., 1]) >= STANDSTILL_M_S
