"""The body of a robot on the floor: what its wheels are told, what the world does, what it does.

Two bodies keep this contract: :mod:`wackel_virtual.fast_body` without contact physics, and
:mod:`wackel_virtual.mujoco_body`. Both are built alike (:class:`~wackel_virtual.build.Build`), so
that they differ only in how a wheel touches the floor, and in that wheels and rotors of the latter
have inertia.

Lists of single numbers: for some wheels, Python is faster with them than numpy.
"""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

GRAVITY = 9.81
MOST_EFFORT = 1.5
"""Greatest torque of a motor, by that at which its tyre slips on a dry floor."""

InPlane: TypeAlias = tuple[float, float, float]
"""Along x, along y, and about the vertical."""


@dataclass(slots=True)
class WheelStates:
    """What holds the wheels now; lists of n.

    Attributes:
        rate: At which a driven wheel is held, rad/s.
        driven: Whether the motor holds it; else it rolls as the floor moves it.
        blocked: Whether it is jammed.
        heading: Direction in which it truly rolls forward, rad from the robot's x axis.
    """

    rate: list[float]
    driven: list[bool]
    blocked: list[bool]
    heading: list[float]


@dataclass(slots=True)
class World:
    """What acts on the robot from outside.

    Attributes:
        friction: Coefficient under each wheel.
        push: Force in the robot frame, and moment, per mass of the robot: m/s², m/s², m²/s².
    """

    friction: list[float]
    push: InPlane


class Body(Protocol):
    """State after the last step.

    Attributes:
        pose: x, y and heading, the last not wrapped.
        twist: In the robot frame.
        angle: What each wheel has rolled since the start, rad.
        rate: rad/s.
        effort: Torque of each motor, by that at which its tyre slips on a dry floor.
    """

    pose: InPlane
    twist: InPlane
    angle: list[float]
    rate: list[float]
    effort: list[float]

    def step(self, wheels: WheelStates, world: World, duration_s: float) -> None:
        """Move on."""
