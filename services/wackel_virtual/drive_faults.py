"""The kinds of drive faults that can be injected, and what all active ones do to the drive.

The kinds are the rows of table 1 of the paper (Rienmüller, Gruber, Hofbaur: "Odometriebasierte
Fehlerdiagnose für quasiomnidirektionale mobile Radroboter"), each as the physical event or the
wrong reading that it is, and what a drive suffers beyond them. Faulty commands need no kind: a
simulation takes any command.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import pi
from typing import TYPE_CHECKING

from wackel_schemas.virtual import Injection
from wackel_virtual.faults import InjectionError, Kind, of_strength

if TYPE_CHECKING:  # it needs numpy, which a command that only lists kinds need not load
    from wackel_drive.layout import Layout

_ANGLE = "rad to the left"
_SHARE = "share, positive for more"

DRIVE_KINDS: dict[str, Kind] = {
    "wheel_blocked": Kind("The wheel is jammed: it stands and is dragged along.", "drive"),
    "wheel_temporarily_blocked": Kind(
        "The wheel jams and comes free again, some tenths of a second each.",
        "drive",
        "share of the time that it is jammed",
        0.5,
        0.05,
        0.95,
    ),
    "wheel_free": Kind(
        "The motor is off: torque is disabled, and the wheel rolls as the floor moves it.",
        "drive",
        "oscillation by the play of the gear, share of the rolling speed",
        0.0,
        0.0,
        1.0,
    ),
    "wheel_loose": Kind(
        "The wheel has come loose from its motor: the motor turns as it should, the wheel rolls "
        "as the floor moves it. Only currents show it, while motors hasten the robot or slow it.",
        "drive",
    ),
    "drive_scale": Kind(
        "The motor turns faster or slower than it is told.", "drive", _SHARE, 0.1, -1.0, 1.0
    ),
    "steering_blocked": Kind("The steering is jammed where it stands.", "steering"),
    "steering_reference_error": Kind(
        "The zero of the steering is wrong: the wheel stands off, its reading does not show it.",
        "steering",
        _ANGLE,
        0.1,
        -pi,
        pi,
    ),
    "steering_offset": Kind(
        "The steering stands off what it is told, and its reading shows it.",
        "steering",
        _ANGLE,
        0.1,
        -pi,
        pi,
    ),
    "drive_sensor_stuck": Kind(
        "The wheel's encoder shows this speed, whatever the wheel does.",
        "drive",
        "rad/s",
        0.0,
        -100.0,
        100.0,
    ),
    "drive_sensor_scale": Kind(
        "The wheel's encoder shows too much or too little.", "drive", _SHARE, 0.1, -1.0, 1.0
    ),
    "steering_sensor_stuck": Kind(
        "The sensor of the steering shows this heading, else that of the moment; the wheel steers "
        "as it should.",
        "steering",
        _ANGLE,
        None,
        -pi,
        pi,
    ),
    "steering_sensor_offset": Kind(
        "The sensor of the steering is off; the wheel steers as it should.",
        "steering",
        _ANGLE,
        0.1,
        -pi,
        pi,
    ),
    "gyro_offset": Kind("The gyros' bias jumps.", "robot", "rad/s", 0.1, -100.0, 100.0),
    "gyro_frozen": Kind("The gyros go on showing the values of this moment.", "robot"),
    "push": Kind(
        "Something pushes the robot from one side, off its centre; for 0.2 s unless told.",
        "robot",
        "force, share of the robot's weight",
        1.0,
        0.0,
        10.0,
    ),
    "ice_patch": Kind(
        "The wheel stands on ice; without a wheel, a round patch of 0.6 m lies just ahead of the "
        "robot.",
        "any wheel",
        "coefficient of friction",
        0.05,
        0.001,
        1.0,
    ),
}

PUSH_S = 0.2
"""A collision with something that gives way."""


def checked_drive(injection: Injection, layout: "Layout") -> Injection:
    """The injection with its default value filled in.

    Raises:
        InjectionError: Unknown kind, place or value that it cannot have.
    """
    name, wheel = injection.kind, injection.wheel
    kind = DRIVE_KINDS.get(name)
    if kind is None:
        raise InjectionError(f"kind {name!r} is unknown; there are {', '.join(DRIVE_KINDS)}")
    if injection.servo is not None or injection.bus:
        raise InjectionError(f"{name} concerns the drive; name a wheel, not a bus or a servo")
    joints = {"drive": layout.rolling, "steering": layout.steering}.get(kind.place)
    able = [each for i, each in enumerate(layout.names) if joints is None or joints[i] is not None]
    if kind.place == "robot" and wheel is not None:
        raise InjectionError(f"{name} concerns the whole robot; leave out the wheel")
    if not able:
        raise InjectionError(f"{name}: no wheel of this robot has a {kind.place} of its own")
    if joints is not None and wheel is None:
        raise InjectionError(f"{name} needs a wheel; there are {', '.join(able)}")
    if wheel is not None and wheel not in able:
        raise InjectionError(f"{name}: no wheel {wheel!r}; there are {', '.join(able)}")
    if name == "push" and injection.duration_s is None:
        injection = Injection(
            kind=name, value=injection.value, start_s=injection.start_s, duration_s=PUSH_S
        )
    return of_strength(injection, kind)


@dataclass
class Moment:
    """What a fault adds by chance while it is active.

    Attributes:
        jammed: Whether a wheel that jams now and then is jammed now.
        angle: Direction of a push, rad.
        lever: Of its point of attack from the centre, as a share of the robot's size.
        patch: Centre of a patch of ice, m; absent if a wheel has its own.
    """

    jammed: bool = True
    angle: float = 0.0
    lever: float = 0.0
    patch: tuple[float, float] | None = None


@dataclass
class DriveConditions:
    """How a drive is, given its active faults; wheels by number.

    Attributes:
        blocked: Wheels that are jammed.
        free: Wheels whose motor is off, with the oscillation that their play allows.
        loose: Wheels that have come off their motor.
        drive_scale: What motors turn too much, as a share.
        steering_blocked: Wheels whose steering is jammed.
        reference: Errors of steering that no reading shows, rad.
        offset: Errors of steering that the reading shows, rad.
        drive_stuck: Speeds that encoders show whatever the wheel does, rad/s.
        drive_reading: What encoders show too much, as a share.
        steering_stuck: Headings that sensors show, rad; ``None``: that of the moment.
        steering_reading: Errors of the reading alone, rad.
        gyro_offset: rad/s.
        gyro_frozen: Whether gyros stand.
        pushes: Direction, lever and force, as shares of size and weight.
        slippery: Coefficients of friction of wheels that stand on ice.
        patches: Centres of patches of ice and their coefficients of friction.
    """

    blocked: set[int] = field(default_factory=set)
    free: dict[int, float] = field(default_factory=dict)
    loose: set[int] = field(default_factory=set)
    drive_scale: dict[int, float] = field(default_factory=dict)
    steering_blocked: set[int] = field(default_factory=set)
    reference: dict[int, float] = field(default_factory=dict)
    offset: dict[int, float] = field(default_factory=dict)
    drive_stuck: dict[int, float] = field(default_factory=dict)
    drive_reading: dict[int, float] = field(default_factory=dict)
    steering_stuck: dict[int, float | None] = field(default_factory=dict)
    steering_reading: dict[int, float] = field(default_factory=dict)
    gyro_offset: float = 0.0
    gyro_frozen: bool = False
    pushes: list[tuple[float, float, float]] = field(default_factory=list)
    slippery: dict[int, float] = field(default_factory=dict)
    patches: list[tuple[float, float, float]] = field(default_factory=list)


def drive_conditions(
    active: Iterable[tuple[Injection, Moment]], layout: "Layout"
) -> DriveConditions:
    """What the active faults, which are checked, do together."""
    result = DriveConditions()
    for injection, moment in active:
        value = injection.value or 0.0
        if injection.wheel is None:
            _concern_robot(result, injection.kind, value, moment)
        else:
            wheel = layout.names.index(injection.wheel)
            if injection.kind == "steering_sensor_stuck":
                result.steering_stuck[wheel] = injection.value
            else:
                _concern_wheel(result, injection.kind, wheel, value, jammed=moment.jammed)
    return result


def _concern_robot(result: DriveConditions, kind: str, value: float, moment: Moment) -> None:
    match kind:
        case "gyro_offset":
            result.gyro_offset += value
        case "gyro_frozen":
            result.gyro_frozen = True
        case "push":
            result.pushes.append((moment.angle, moment.lever, value))
        case "ice_patch" if moment.patch is not None:
            result.patches.append((*moment.patch, value))


def _concern_wheel(
    result: DriveConditions, kind: str, wheel: int, value: float, *, jammed: bool
) -> None:
    match kind:
        case "wheel_blocked":
            result.blocked.add(wheel)
        case "wheel_temporarily_blocked":
            if jammed:
                result.blocked.add(wheel)
        case "wheel_free":
            result.free[wheel] = value
        case "wheel_loose":
            result.loose.add(wheel)
        case "drive_scale":
            result.drive_scale[wheel] = result.drive_scale.get(wheel, 0.0) + value
        case "steering_blocked":
            result.steering_blocked.add(wheel)
        case "steering_reference_error":
            result.reference[wheel] = result.reference.get(wheel, 0.0) + value
        case "steering_offset":
            result.offset[wheel] = result.offset.get(wheel, 0.0) + value
        case "drive_sensor_stuck":
            result.drive_stuck[wheel] = value
        case "drive_sensor_scale":
            result.drive_reading[wheel] = result.drive_reading.get(wheel, 0.0) + value
        case "steering_sensor_offset":
            result.steering_reading[wheel] = result.steering_reading.get(wheel, 0.0) + value
        case "ice_patch":
            result.slippery[wheel] = value
