"""A robot without contact physics: true motion, and what its servos and gyro say of it.

The servos do what they are told. The robot then moves as its true wheels make it move, which is
not quite as configured: radii and steering angles are off by the calibration errors.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.forward import least_squares
from wackel_kinematics.inverse import inverse
from wackel_kinematics.planar import compose, exponential
from wackel_kinematics.wheel import Wheel
from wackel_node.config_drive import DriveConfig, WheelConfig
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.drive import ImuSample

START_NS = 1_700_000_000_000_000_000
GYRO = "body"
BUS = "main"


def steered_drive(count: int, **settings: float) -> DriveConfig:
    """Wheels of 5 cm on a circle of 0.3 m; servo i drives, servo 100 + i steers wheel i."""
    wheels = [
        WheelConfig(
            name=f"w{i}",
            l=0.3,
            alpha=math.pi / count + 2 * math.pi * i / count,
            radius=0.05,
            bus=BUS,
            drive=i,
            steering=100 + i,
        )
        for i in range(count)
    ]
    return DriveConfig(kind="steered", wheels=wheels, **settings)


def differential_drive(track: float = 0.4, radius: float = 0.05, **settings: float) -> DriveConfig:
    """Servo 1 left, servo 2 right."""
    sides = (("left", track / 2, 1), ("right", -track / 2, 2))
    wheels = [
        WheelConfig(name=name, x=0.0, y=y, radius=radius, bus=BUS, drive=servo)
        for name, y, servo in sides
    ]
    return DriveConfig(kind="differential", wheels=wheels, **settings)


def other_drives() -> dict[str, DriveConfig]:
    """One of each kind but these two; servo 1 + i drives, servo 101 + i steers wheel i."""
    mecanum = [(0.2, 0.2, -1), (0.2, -0.2, 1), (-0.2, 0.2, 1), (-0.2, -0.2, -1)]
    angles = [2 * math.pi * i / 3 for i in range(3)]
    return {
        "tricycle": DriveConfig(
            kind="tricycle",
            wheels=[
                _wheel(0, x=0.5, y=0.0, steering=101, drive=1),
                _wheel(1, x=0.0, y=0.2),
                _wheel(2, x=0.0, y=-0.2),
            ],
        ),
        "ackermann": DriveConfig(
            kind="ackermann",
            wheels=[
                _wheel(0, x=0.5, y=0.2, steering=101),
                _wheel(1, x=0.5, y=-0.2, steering=102),
                _wheel(2, x=0.0, y=0.2, drive=3),
                _wheel(3, x=0.0, y=-0.2, drive=4),
            ],
        ),
        "mecanum": DriveConfig(
            kind="mecanum",
            wheels=[
                _wheel(i, x=x, y=y, drive=1 + i, roller=side * math.pi / 4)
                for i, (x, y, side) in enumerate(mecanum)
            ],
        ),
        "omni": DriveConfig(
            kind="omni",
            wheels=[
                _wheel(i, l=0.2, alpha=angle, heading=angle + math.pi / 2, drive=1 + i)
                for i, angle in enumerate(angles)
            ],
        ),
    }


def _wheel(number: int, **settings: float) -> WheelConfig:
    return WheelConfig(name=f"w{number}", radius=0.05, bus=BUS, **settings)


@dataclass(frozen=True)
class Errors:
    """How the true robot differs from the configured one.

    Attributes:
        radius: Share, for each wheel.
        direction: Steering or mounting, rad, for each wheel.
        bias: Of the gyro, rad/s.
        noise_density: Of the gyro, rad/s/√Hz.
        wheel_noise: Of the rolling speed of each wheel, m/s; white, in every step.
    """

    radius: Floats
    direction: Floats
    bias: float = 0.0
    noise_density: float = 0.0
    wheel_noise: float = 0.0


def exact(count: int) -> Errors:
    """A robot as configured."""
    return Errors(np.zeros(count), np.zeros(count))


def calibration_errors(
    rng: np.random.Generator, count: int, radius: float = 0.003, direction: float = 0.0035
) -> Errors:
    """Errors of the given standard deviations (0.2°), and a common gyro."""
    return Errors(
        rng.normal(0.0, radius, count),
        rng.normal(0.0, direction, count),
        bias=float(rng.normal(0.0, 0.02)),
        noise_density=0.0002,
    )


@dataclass
class Moment:
    """What came in one cycle, and the truth at its end."""

    state: BusState
    sample: ImuSample
    pose: Floats
    twist: Floats


class Robot:
    """The true robot.

    Args:
        config: As it is configured.
        errors: How it differs.
        rng: For noise.
        rate: Cycles per second.
        gyro_late_s: By how much the gyro's stamps are late.

    Attributes:
        pose: Where it is.
    """

    def __init__(
        self,
        config: DriveConfig,
        errors: Errors,
        rng: np.random.Generator,
        rate: float = 100.0,
        gyro_late_s: float = 0.0,
    ) -> None:
        self.pose = np.zeros(3)
        self._layout = Layout(config)
        self._step = config.encoder_step
        self._errors = errors
        self._rng = rng
        self._dt = 1 / rate
        self._late_s = gyro_late_s
        nominal = self._layout.drive
        self._true = Drive([_true(wheel, errors, i) for i, wheel in enumerate(nominal.wheels)])
        self._angle = rng.uniform(0, 2 * math.pi, nominal.n)
        self._steering = nominal.steering(np.zeros(nominal.n))
        self._cycle = 0

    def drive(self, twists: Floats) -> Iterator[Moment]:
        """Follows commanded twists, one a cycle, shape (m, 3)."""
        nominal, dt = self._layout.drive, self._dt
        for command in twists:
            target = inverse(nominal, command, self._steering).steering
            middle = (self._steering + target) / 2
            rows = nominal.rows(middle)
            rate = np.zeros(nominal.n)
            rate[nominal.roll_wheels] = rows[nominal.slide_count :] @ command / nominal.roll_radius
            true_rows = self._true.rows(middle + self._errors.direction)
            twist = least_squares(true_rows, self._true.values(rate), nominal.length_m).twist
            self._angle += rate * dt
            self._steering = target
            self.pose = compose(self.pose, exponential(twist * dt))
            self._cycle += 1
            yield Moment(
                BusState(stamp=self._stamp(0.0), servos=list(self._servos(rate))),
                self._gyro(float(twist[2])),
                self.pose,
                twist,
            )

    def _stamp(self, later_s: float) -> int:
        return START_NS + round((self._cycle * self._dt + later_s) * 1e9)

    def _servos(self, rate: Floats) -> Iterator[ServoState]:
        noise = self._rng.normal(0.0, self._errors.wheel_noise, len(rate)) / 0.05 * self._dt
        self._angle += noise
        headings = self._layout.drive.heading(self._steering)
        for i, (rolling, steering) in enumerate(
            zip(self._layout.rolling, self._layout.steering, strict=True)
        ):
            if rolling is not None:
                position = round(float(self._angle[i]) / self._step) * self._step
                yield ServoState(
                    id=rolling.servo.id,
                    position=rolling.sign * position % (2 * math.pi),
                    velocity=rolling.sign * float(rate[i]),
                )
            if steering is not None:
                shown = round(float(headings[i]) / self._step) * self._step
                yield ServoState(
                    id=steering.servo.id, position=steering.sign * (shown - steering.offset)
                )

    def _gyro(self, omega: float) -> ImuSample:
        """In the middle of the cycle."""
        errors = self._errors
        noise = errors.noise_density / math.sqrt(self._dt)
        shown = omega + errors.bias + float(self._rng.normal(0.0, noise))
        return ImuSample(
            stamp=self._stamp(self._late_s - self._dt / 2), angular_velocity=(0.0, 0.0, shown)
        )


def random_path(
    rng: np.random.Generator, length_m: float = 17.0, rate: float = 100.0, sideways: bool = True
) -> Floats:
    """Twists of a random path, shape (m, 3), that begins and ends with a second of rest.

    Speed about 0.5 m/s, turns of about 1 rad/s, directions that change within seconds.
    """
    dt = 1 / rate
    smooth = np.zeros(3)
    raw = np.zeros(3)
    twists: list[Floats] = []
    driven = 0.0
    mean, spread = np.array([0.3, 0.0, 0.0]), np.array([0.5, 0.3 if sideways else 0.0, 1.0])
    fade = math.exp(-dt / 1.0)
    while driven < length_m:
        raw = fade * raw + math.sqrt(1 - fade**2) * rng.normal(0.0, spread)
        smooth = smooth + (raw + mean - smooth) * (dt / 0.3)
        twists.append(smooth.copy())
        driven += float(np.hypot(smooth[0], smooth[1])) * dt
    rest = np.zeros((round(rate), 3))
    slowing = np.linspace(smooth, np.zeros(3), round(rate / 2))
    return np.concatenate([rest, np.array(twists), slowing, rest])


def _true(wheel: Wheel, errors: Errors, number: int) -> Wheel:
    radius = None if wheel.radius_m is None else wheel.radius_m * (1 + errors.radius[number])
    off = float(errors.direction[number])
    beta = None if wheel.beta_rad is None else wheel.beta_rad + off
    return replace(wheel, radius_m=radius, beta_rad=beta)
