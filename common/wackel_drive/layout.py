"""From ``robot.toml`` to kinematics: wheels with constraints, and the servos that move them."""

from dataclasses import dataclass
from typing import NamedTuple

from wackel_kinematics.drive import Drive
from wackel_kinematics.wheel import Placement, Wheel, fixed, mecanum, omni, steered
from wackel_node.config_drive import DriveConfig, WheelConfig, position


class Servo(NamedTuple):
    """A servo's place: bus and id."""

    bus: str
    id: int


@dataclass(frozen=True)
class Joint:
    """A servo as part of a wheel: the wheel's angle is ``sign`` × servo angle + ``offset``.

    Attributes:
        servo: Which.
        sign: 1 or -1.
        offset: rad.
    """

    servo: Servo
    sign: int
    offset: float = 0.0


class Layout:
    """A configured drive.

    Attributes:
        drive: Its constraints.
        names: Of the wheels, in order.
        rolling: What drives each wheel; ``None`` where nothing does.
        steering: What steers each wheel; ``None`` where nothing does.

    Raises:
        ValueError: The wheels do not make a drive; a configuration that was checked does.
    """

    def __init__(self, config: DriveConfig) -> None:
        wheels = config.wheels
        self.drive = Drive([_wheel(config, wheel) for wheel in wheels])
        self.names = tuple(wheel.name for wheel in wheels)
        self.rolling = tuple(
            None if wheel.drive is None else Joint(Servo(wheel.bus, wheel.drive), wheel.direction)
            for wheel in wheels
        )
        self.steering = tuple(
            None
            if wheel.steering is None
            else Joint(
                Servo(wheel.steering_bus or wheel.bus, wheel.steering),
                wheel.steering_direction,
                wheel.steering_offset,
            )
            for wheel in wheels
        )


def _wheel(config: DriveConfig, wheel: WheelConfig) -> Wheel:
    x, y = position(wheel)
    place = Placement.cartesian(x, y)
    radius = None if wheel.drive is None else wheel.radius
    if config.kind == "differential":
        # Wheels of one side act as one, on an axle in their middle: only there no wheel slides
        # sideways in a turn.
        axle = sum(position(each)[0] for each in config.wheels) / len(config.wheels)
        half = abs(y) if config.track is None else config.track / 2
        return fixed(Placement.cartesian(axle, half if y > 0 else -half), radius)
    if config.kind == "mecanum" and wheel.roller is not None:
        return mecanum(place, wheel.radius, wheel.roller, wheel.heading)
    if config.kind == "omni":
        return omni(place, wheel.radius, wheel.heading)
    if wheel.steering is not None:
        return steered(place, radius)
    return fixed(place, radius, wheel.heading)
