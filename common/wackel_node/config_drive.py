"""The drive and its gyros in ``robot.toml``: sections, defaults, and what types cannot say."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Annotated, Literal, TypeAlias

from msgspec import Meta

from wackel_node.config_types import Name, Positive, Section, ServoId

DriveKind = Literal["steered", "differential", "tricycle", "ackermann", "mecanum", "omni"]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Direction = Annotated[int, Meta(extra={"values": (1, -1)})]
# No robot of serial servos is as large as these: who comes here has written mm, cm or degrees.
Radius = Annotated[float, Meta(gt=0, le=1, extra={"unit": "m"})]
Coordinate = Annotated[float, Meta(ge=-10, le=10, extra={"unit": "m"})]
Distance = Annotated[float, Meta(ge=0, le=10, extra={"unit": "m"})]
Width = Annotated[float, Meta(gt=0, le=10, extra={"unit": "m"})]
Angle = Annotated[float, Meta(ge=-10, le=10, extra={"unit": "rad"})]
MOST_READ = 64
"""Bytes of one read of a sensor: 0.7 ms at 1 Mbit/s, which each cycle pays."""
RATE_FACTOR = 1.5
"""A gyro's timer is within a few percent; the next setting of a sensor is twice or half."""
_Row: TypeAlias = tuple[float, float, float]
_APART_M = 0.001
_SINGULAR = 0.01
"""Sines and determinants below are 0 but for angles that are rounded or half a degree off."""
# 80° is as far as the kinematics goes: beyond, a mecanum wheel pushes nothing.
Roller = Annotated[float, Meta(ge=-math.radians(80), le=math.radians(80), extra={"unit": "rad"})]


class WheelConfig(Section, kw_only=True, frozen=True):
    """One wheel; robot frame: x forward, y left, angles counter-clockwise, m and rad.

    Attributes:
        name: As faults call it.
        x, y: Contact point, m; absent where l and alpha tell it.
        l, alpha: Contact point in polar form, m and rad; absent where x and y tell it.
        radius: Of the wheel, m.
        bus: Bus of the drive servo.
        drive: Id of the servo that drives the wheel, in wheel mode; absent if it rolls freely.
        direction: 1 if the wheel rolls forward when the servo turns positively, else -1.
        steering: Id of the servo that steers the wheel; absent if it does not steer.
        steering_bus: Bus of that servo; absent: ``bus``.
        steering_direction: 1 if a positive angle of the servo steers to the left, else -1.
        steering_offset: Where the wheel points (rad to the left of forward) when the steering
            servo reads 0.
        heading: Where a wheel that does not steer rolls to, rad to the left of forward.
        roller: Mecanum: from ``heading`` to the axis of the roller on the floor, rad to the left.
            Where the upper rollers form an X seen from above: -0.7854 front left and rear right,
            0.7854 front right and rear left.
    """

    name: Name
    radius: Radius
    bus: Name
    x: Coordinate | None = None
    y: Coordinate | None = None
    l: Distance | None = None  # noqa: E741 (the paper's name)
    alpha: Angle | None = None
    drive: ServoId | None = None
    direction: Direction = 1
    steering: ServoId | None = None
    steering_bus: Name | None = None
    steering_direction: Direction = 1
    steering_offset: Angle = 0.0
    heading: Angle = 0.0
    roller: Roller | None = None

    def servos(self) -> Iterator[tuple[str, int]]:
        """(bus, id) of what moves it."""
        if self.drive is not None:
            yield self.bus, self.drive
        if self.steering is not None:
            yield self.steering_bus or self.bus, self.steering


class DriveConfig(Section, kw_only=True, frozen=True):
    """The wheels, and how well their measures are known.

    Attributes:
        kind: ``steered``: 3 or more steered and driven wheels; ``differential``: fixed wheels on
            both sides, also skid-steered; ``tricycle``: one steered; ``ackermann``: two steered;
            ``mecanum``; ``omni``. Castors are left out.
        wheels: In the order in which messages list them.
        track: Differential: distance between the sides that the robot turns as if it had, which
            for a skid-steered one is larger than what a ruler says, m; absent: from the wheels.
        radius_error: Standard deviation of the radii, as a share. A skid-steered robot, whose
            wheels slide by design, needs 0.1 and more.
        steering_error: Standard deviation of the wheels' directions, rad (0.2°).
        encoder_step: Resolution of the servos' position, rad.
    """

    kind: DriveKind
    wheels: list[WheelConfig] = []
    track: Width | None = None
    radius_error: Annotated[float, Meta(gt=0, le=1)] = 0.003
    steering_error: Annotated[float, Meta(gt=0, le=1)] = 0.0035
    encoder_step: Positive = 2 * math.pi / 4096


class GyroRegister(Section, kw_only=True, frozen=True):
    """Where a device on a servo bus keeps its rate about one axis.

    Attributes:
        address: Of the first byte.
        encoding: Of the value, low byte first.
        scale: rad/s for a value of 1; negative where the axis points the other way. Absent: the
            value is in rad/s, which of integers it never is.
    """

    address: Annotated[int, Meta(ge=0, le=0xFFFF)]
    encoding: Literal["int16", "int32", "float32"] = "float32"
    scale: float | None = None

    @property
    def factor(self) -> float:
        """The scale that is in force, rad/s."""
        return 1.0 if self.scale is None else self.scale

    @property
    def end(self) -> int:
        """Address behind the last byte."""
        return self.address + (2 if self.encoding == "int16" else 4)


class GyroConfig(Section, kw_only=True, frozen=True):
    """One gyro, published on ``imu/<name>``; its faults are found where there is a drive, too.

    Figures are those of the data sheet of a common MEMS part.

    Attributes:
        source: ``topic``: a driver of yours publishes it; ``bus``: the gateway reads it from a
            device on a servo bus, once a cycle; ``iio``: ``wackel imu`` reads it from the kernel.
        bus, id: Of source bus: where the device is.
        registers: Of source bus: by axis of the sensor; an axis without shows 0. As on an OpenCR:
            ``registers.z = { address = 68 }``.
        device: Of source iio: its name (``lsm6dsl_gyro``) or path (``/dev/iio:device0``).
        axis: Which axis of the sensor points up.
        rate: Samples per second; below 33, most steps of wheels at 100 Hz go without.
        noise_density: rad/s/√Hz (0.01 °/s/√Hz).
        bias_limit: Greatest bias after power-on, rad/s.
        bias_stability: How far the bias wanders within 100 s, rad/s.
        scale_error: Standard deviation of the scale, as a share.
        saturation: Greatest rate that it can measure, rad/s (2000 °/s).
    """

    source: Literal["topic", "bus", "iio"] = "topic"
    bus: Name | None = None
    id: ServoId | None = None
    registers: dict[Literal["x", "y", "z"], GyroRegister] = {}
    device: str | None = None
    axis: Axis = "z"
    rate: Positive = 100.0
    noise_density: Positive = 0.0002
    bias_limit: Positive = 0.1
    bias_stability: Positive = 0.0003
    scale_error: Annotated[float, Meta(gt=0, le=1)] = 0.003
    saturation: Positive = 34.9


def drive_problem(drive: DriveConfig, buses: Mapping[str, Collection[int]]) -> str | None:
    """The first thing in a drive that cannot be; ``None`` if it is all right.

    Args:
        drive: The section.
        buses: Servo ids of each bus; none at all where the configuration lists none.
    """
    names = [wheel.name for wheel in drive.wheels]
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        return f"drive.wheels: name {doubled[0]!r} stands there twice"
    problem = _kind_problem(drive)
    if problem:
        return f"drive.wheels: {problem}"
    users: dict[tuple[str, int], str] = {}
    for number, wheel in enumerate(drive.wheels):
        where = f"drive.wheels[{number}]"
        problem = _place_problem(wheel) or _role_problem(drive.kind, wheel)
        if problem:
            return f"{where}{problem}"
        for bus, servo in wheel.servos():
            if bus not in buses:
                return f"{where}: there is no bus {bus!r}; known are {', '.join(buses) or 'none'}"
            if buses[bus] and servo not in buses[bus]:
                return f"{where}: there is no servo {servo} on bus {bus}"
            if (bus, servo) in users:
                return f"{where}: servo {servo} on bus {bus} moves wheel {users[bus, servo]!r}"
            users[bus, servo] = wheel.name
    if drive.track is not None and drive.kind != "differential":
        return f"drive.track: a drive of kind {drive.kind!r} has none"
    if drive.kind == "differential" and not _both_sides(drive.wheels):
        return "drive.wheels: the left and the right wheels must stand apart (y)"
    if all(math.hypot(*position(wheel)) == 0 for wheel in drive.wheels):
        return "drive.wheels: at least one must stand away from the origin"
    for one, other in combinations(drive.wheels, 2):
        if math.dist(position(one), position(other)) < _APART_M:
            return f"drive.wheels: {one.name!r} and {other.name!r} stand in one place"
    problem = _push_problem(drive.wheels) if drive.kind in ("mecanum", "omni") else None
    return f"drive.wheels: {problem}" if problem else None


def gyro_problem(
    gyros: Mapping[str, GyroConfig], polled: Mapping[str, tuple[Collection[int], float]]
) -> str | None:
    """The first thing in the gyros that cannot be; ``None`` if they are all right.

    Args:
        gyros: The sections, by name.
        polled: Servo ids and rate of each bus in mode poll.
    """
    for name, gyro in gyros.items():
        problem = _source_problem(gyro) or (
            _bus_problem(gyro, polled) if gyro.source == "bus" else None
        )
        if problem:
            return f"gyros.{name}{problem}"
    return None


def position(wheel: WheelConfig) -> tuple[float, float]:
    """Contact point of a wheel that has been checked, x and y in m."""
    if wheel.x is not None and wheel.y is not None:
        return wheel.x, wheel.y
    distance, angle = wheel.l or 0.0, wheel.alpha or 0.0
    return distance * math.cos(angle), distance * math.sin(angle)


def _kind_problem(drive: DriveConfig) -> str | None:
    wheels = drive.wheels
    steering = sum(wheel.steering is not None for wheel in wheels)
    driven = sum(wheel.drive is not None for wheel in wheels)
    kind = drive.kind
    if kind == "steered" and not len(wheels) == steering == driven >= 3:
        return "kind 'steered' needs 3 or more, each with the ids drive and steering"
    if kind == "tricycle" and not (steering == 1 and driven >= 1 and len(wheels) >= 3):
        return "kind 'tricycle' needs 3 or more, one of them with steering, and one with drive"
    if kind == "ackermann" and not (steering == 2 and driven >= 1 and len(wheels) >= 4):
        return "kind 'ackermann' needs 4 or more, two of them with steering, and one with drive"
    if kind in ("mecanum", "omni") and not (len(wheels) == driven >= 3 and not steering):
        return f"kind {kind!r} needs 3 or more, each with drive and none with steering"
    if kind == "differential" and not (len(wheels) == driven >= 2 and not steering):
        return "kind 'differential' needs 2 or more, each with drive and none with steering"
    return None


def _place_problem(wheel: WheelConfig) -> str | None:
    cartesian = [wheel.x is not None, wheel.y is not None]
    polar = [wheel.l is not None, wheel.alpha is not None]
    if all(cartesian) != all(polar) and any(cartesian) != any(polar):
        return None
    return " needs its place: either x and y, or l and alpha"


def _role_problem(kind: DriveKind, wheel: WheelConfig) -> str | None:
    if kind == "mecanum" and not wheel.roller:
        return ".roller is missing: the angle of the rollers, mostly ±0.7854 (pi/4)"
    if kind != "mecanum" and wheel.roller is not None:
        return f".roller: a drive of kind {kind!r} has none"
    if wheel.steering is None and wheel.steering_bus is not None:
        return ".steering_bus is useless without steering"
    if kind == "differential" and wheel.heading:
        return ".heading: the wheels of a differential drive roll forward"
    return None


def _both_sides(wheels: Sequence[WheelConfig]) -> bool:
    sides = [position(wheel)[1] for wheel in wheels]
    return min(sides) < 0 < max(sides)


def _push_problem(wheels: Sequence[WheelConfig]) -> str | None:
    """Why wheels with rollers cannot move the robot in any direction and turn it."""
    # Lines of push in the plane: three that are neither parallel nor meet make any motion.
    angles = [wheel.heading + (wheel.roller or 0.0) for wheel in wheels]
    if all(abs(math.sin(one - other)) < _SINGULAR for one, other in combinations(angles, 2)):
        return "all push in the same direction, so the robot cannot go sideways to it (heading)"
    size = max(math.hypot(*position(wheel)) for wheel in wheels)
    rows = []
    for wheel, angle in zip(wheels, angles, strict=True):
        x, y = position(wheel)
        cos, sin = math.cos(angle), math.sin(angle)
        rows.append((cos, sin, (x * sin - y * cos) / size))
    if all(abs(_determinant(*three)) < _SINGULAR for three in combinations(rows, 3)):
        return "all push through the same point, so they cannot turn the robot (heading, roller)"
    return None


def _determinant(a: _Row, b: _Row, c: _Row) -> float:
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _source_problem(gyro: GyroConfig) -> str | None:
    of_source: dict[str, dict[str, object]] = {
        "bus": {"bus": gyro.bus, "id": gyro.id, "registers": gyro.registers or None},
        "iio": {"device": gyro.device},
    }
    for source, keys in of_source.items():
        for key, value in keys.items():
            if source == gyro.source and value is None:
                return f".{key} is missing: source = {source!r} needs it"
            if source != gyro.source and value is not None:
                return f".{key} is useless without source = {source!r}"
    return None


def _bus_problem(
    gyro: GyroConfig, polled: Mapping[str, tuple[Collection[int], float]]
) -> str | None:
    if gyro.bus is None or gyro.bus not in polled:
        known = ", ".join(polled) or "none"
        return f".bus = {gyro.bus!r}: there is no such bus in mode poll; known are {known}"
    ids, rate = polled[gyro.bus]
    if gyro.id in ids:
        return f".id = {gyro.id}: bus {gyro.bus} has a servo of this id"
    if gyro.axis[-1] not in gyro.registers:
        return f".registers: axis {gyro.axis!r} points up, so {gyro.axis[-1]} must be there"
    for axis, register in gyro.registers.items():
        where = f".registers.{axis}.scale"
        if register.scale == 0:
            return f"{where} = 0: the gyro would always show that it stands"
        if register.scale is None and register.encoding != "float32":
            return (
                f"{where} is missing: encoding = {register.encoding!r} needs rad/s for a value of 1"
            )
    registers = gyro.registers.values()
    if max(each.end for each in registers) - min(each.address for each in registers) > MOST_READ:
        return f".registers: they must lie within {MOST_READ} bytes, to be read in one go"
    if not 1 / RATE_FACTOR <= gyro.rate / rate <= RATE_FACTOR:
        return (
            f".rate = {gyro.rate:g}: it is read in every cycle of bus {gyro.bus}, {rate:g} a second"
        )
    return None
