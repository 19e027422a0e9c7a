"""The drive of the virtual robot: motors, body, faults, and what its sensors show of them.

Angles are those of the wheels as :class:`~wackel_drive.layout.Layout` has them: rolling forward
and β as the servos believe it. Where wheel and servo differ (calibration, a wrong reference, a
loose wheel), the difference lies between this and the body.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import exp, hypot, pi, sin
from random import Random
from typing import Literal

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.array import Bools, Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.wheel import Wheel
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas.virtual import Injection
from wackel_virtual.body import FRICTION, GRAVITY, MOST_EFFORT, Body, WheelStates, World
from wackel_virtual.calibration_errors import CalibrationErrors
from wackel_virtual.drive_course import PATCH_RADIUS_M, DriveCourse
from wackel_virtual.drive_faults import DriveConditions, drive_conditions
from wackel_virtual.fast_body import FastBody
from wackel_virtual.gyro import VirtualGyro
from wackel_virtual.motion import FRICTION_A, TIME_CONSTANT_S

Physics = Literal["fast", "mujoco"]

GRIP_A = 0.8
"""Current at which a wheel's tyre slips: a motor that fits its robot has some reserve."""
FAST_M_S = 2.0
"""Speed of a wheel at which its motor needs :data:`~wackel_virtual.motion.FRICTION_A`."""
STEERING_LIMIT_RAD_S = 2 * pi
"""Greatest velocity of a steering servo (60 rev/min)."""
STIFF_RAD = 0.1
"""Error of a position at which a servo's torque is at its limit."""
PLAY_HZ = 2.0
"""How fast a wheel without torque swings in the play of its gear: about as in the paper's figure
6c."""

_ROUNDING_S = 1e-6
"""By what sums of many steps may miss the time at which a fault begins."""


@dataclass(slots=True)
class Demand:
    """What the servos are told; arrays of n.

    Attributes:
        rate: Goal of rolling, rad/s.
        powered: Whether the motor has torque.
        steering: Goal of β, rad.
        steering_powered: The same of the steering, which without torque stays where it is: its
            gear is harder to turn than its wheel on the floor.
    """

    rate: Floats
    powered: Bools
    steering: Floats
    steering_powered: Bools


class Drivetrain:
    """The true drive.

    Args:
        drive: As configured.
        gyros: By name.
        seed: Of everything random.
        physics: Which body.
        errors: How it differs from the configuration; absent: drawn as large as that assumes.
        lag_s: Time constant with which its servos follow their goals.

    Attributes:
        layout: As configured.
        body: Where it is, and how it moves.
        rolled: What the encoders show, rad.
        rate: rad/s.
        steered: β that the sensors show, rad.
        steering_rate: rad/s.
        current: Of the rolling motors, A.
        steering_current: A.
        free: Whether an injected fault has switched the motor off.
        blocked: Whether one holds the wheel now.

    Raises:
        ImportError: MuJoCo is not installed.
    """

    def __init__(
        self,
        drive: DriveConfig,
        gyros: Mapping[str, GyroConfig],
        seed: int | str,
        *,
        physics: Physics = "fast",
        errors: CalibrationErrors | None = None,
        lag_s: float = TIME_CONSTANT_S,
    ) -> None:
        self._lag_s = lag_s
        self.layout = Layout(drive)
        nominal = self.layout.drive
        first = next(iter(gyros.values()), GyroConfig())
        errors = errors or CalibrationErrors.drawn(drive, first, seed)
        self._direction = np.where(nominal.steers, errors.direction, 0.0)
        true = Drive([_true(wheel, errors, i) for i, wheel in enumerate(nominal.wheels)])
        self._beta = nominal.steering(np.zeros(nominal.n))
        self.body = _body(physics, true, self._beta + self._direction, seed)
        self._gyros = {
            name: (
                VirtualGyro(each, f"{seed}/{name}", errors.gyro_bias, errors.gyro_scale),
                _Heading(),
            )
            for name, each in gyros.items()
        }
        self._course = DriveCourse(self.layout, seed)
        self._radii = np.ones(nominal.n)
        self._radii[nominal.roll_wheels] = nominal.roll_radius
        self._time_s = 0.0
        self._rate = np.zeros(nominal.n)
        self.rolled = np.zeros(nominal.n)
        self.rate = np.zeros(nominal.n)
        self.steered = self._beta.copy()
        self.steering_rate = np.zeros(nominal.n)
        self.current = np.zeros(nominal.n)
        self.steering_current = np.zeros(nominal.n)
        self._stuck: dict[int, float] = {}
        self._take_over(DriveConditions())

    def inject(self, injection: Injection) -> Injection:
        """Have a fault begin ``start_s`` from now; returns it with its defaults filled in.

        Raises:
            InjectionError: Unknown kind, or a place or value that it cannot have.
        """
        return self._course.inject(injection, self._time_s)

    def heal(self, kind: str = "", wheel: str | None = None) -> list[Injection]:
        """End faults now, scheduled ones too; returns those that it concerned."""
        return self._course.heal(kind, wheel)

    def active(self) -> list[Injection]:
        """The faults that act now."""
        return [injection for injection, _ in self._course.active()]

    def step(self, demand: Demand, duration_s: float) -> None:
        """Move on; faults begin and end at the start of a step."""
        body = self.body
        if self._course.advance(self._time_s + _ROUNDING_S, body.pose, body.twist):
            self._take_over(drive_conditions(self._course.active(), self.layout))
        self._time_s += duration_s
        gain = 1.0 - exp(-duration_s / self._lag_s)

        powered = demand.powered & ~self.free
        aim = self._scale * demand.rate
        self._rate = np.where(powered, self._rate + gain * (aim - self._rate), body.rate)
        error = demand.steering + self._offset - self._beta
        turns = demand.steering_powered & ~self._jammed
        most = STEERING_LIMIT_RAD_S * duration_s
        turn = np.where(turns, np.minimum(most, np.maximum(-most, gain * error)), 0.0)
        self._beta = self._beta + turn

        before = body.angle.copy()
        wheels = WheelStates(
            rate=self._rate,
            driven=powered & ~self._loose,
            blocked=self.blocked,
            steering=self._beta + self._direction + self._reference,
        )
        body.step(wheels, self._world(), duration_s)

        rate = np.where(self._loose, self._rate, body.rate)
        turned = np.where(self._loose, self._rate * duration_s, body.angle - before)
        effort = np.minimum(MOST_EFFORT, np.maximum(-MOST_EFFORT, error * MOST_EFFORT / STIFF_RAD))
        self.steering_current = np.where(
            demand.steering_powered,
            GRIP_A * effort + FRICTION_A * turn / most,
            0.0,
        )
        self.current = np.where(
            powered,
            GRIP_A * body.effort + FRICTION_A / FAST_M_S * rate * self._radii,
            0.0,
        )
        self._show(rate, turned, turn / duration_s, duration_s)

    def sample(self, name: str) -> tuple[float, float, float]:
        """What a gyro shows of the time since its last sample."""
        gyro, heading = self._gyros[name]
        now_s, angle = self._time_s, float(self.body.pose[2])
        passed = now_s - heading.time_s
        mean = (angle - heading.angle) / passed if passed > 0 else float(self.body.twist[2])
        heading.time_s, heading.angle = now_s, angle
        now = self._conditions
        return gyro.sample(mean, now.gyro_offset, frozen=now.gyro_frozen)

    def _show(self, rate: Floats, turned: Floats, steering_rate: Floats, passed_s: float) -> None:
        """Readings, with the faults of sensors."""
        if self._play is not None:
            swing = 1.0 + self._play * sin(2 * pi * PLAY_HZ * self._time_s)
            rate, turned = rate * swing, turned * swing
        now = self._conditions
        if now.drive_reading:
            rate, turned = rate * self._reading, turned * self._reading
        for wheel, shown in now.drive_stuck.items():
            rate[wheel], turned[wheel] = shown, shown * passed_s
        self.rolled += turned
        self.rate = rate
        beta = self._beta + self._misread
        for wheel, angle in self._stuck.items():
            beta[wheel], steering_rate[wheel] = angle, 0.0
        self.steered, self.steering_rate = beta, steering_rate

    def _take_over(self, now: DriveConditions) -> None:
        """Conditions as arrays."""
        self._conditions = now
        n = self.layout.drive.n
        self.free = _marked(n, now.free)
        self.blocked = _marked(n, now.blocked)
        self._loose = _marked(n, now.loose)
        self._jammed = _marked(n, now.steering_blocked)
        self._scale = 1.0 + _filled(n, now.drive_scale)
        self._reading = 1.0 + _filled(n, now.drive_reading)
        self._offset = _filled(n, now.offset)
        self._reference = _filled(n, now.reference)
        self._misread = _filled(n, now.steering_reading)
        self._play = _filled(n, now.free) if any(now.free.values()) else None
        headings = np.array([now.steering_stuck.get(i) or 0.0 for i in range(n)])
        fixed = self.layout.drive.steering(headings)
        self._stuck = {
            wheel: self._stuck.get(wheel, float(self.steered[wheel]))
            if heading is None
            else float(fixed[wheel])
            for wheel, heading in now.steering_stuck.items()
        }
        self._friction = np.full(n, FRICTION)
        for wheel, friction in now.slippery.items():
            self._friction[wheel] = friction

    def _world(self) -> World:
        now = self._conditions
        friction, push = self._friction, np.zeros(3)
        if not (now.patches or now.pushes):
            return World(friction, push)
        x, y, heading = self.body.pose.tolist()
        cos, sine = np.cos(heading), np.sin(heading)
        if now.patches:
            friction = friction.copy()
            for i, (along, left) in enumerate(self.layout.drive.xy.tolist()):
                at = (x + cos * along - sine * left, y + sine * along + cos * left)
                for px, py, slippery in now.patches:
                    if hypot(at[0] - px, at[1] - py) < PATCH_RADIUS_M:
                        friction[i] = min(friction[i], slippery)
        for angle, lever, share in now.pushes:
            force = share * GRAVITY
            along, left = np.cos(angle - heading), np.sin(angle - heading)
            push += force * np.array([along, left, lever * self.layout.drive.length_m])
        return World(friction, push)


@dataclass(slots=True)
class _Heading:
    """At a gyro's last sample."""

    time_s: float = 0.0
    angle: float = 0.0


def _body(physics: Physics, drive: Drive, beta: Floats, seed: int | str) -> Body:
    if physics == "fast":
        return FastBody(drive, Random(f"{seed}/floor").getrandbits(64))
    from wackel_virtual.mujoco_body import MujocoBody

    return MujocoBody(drive, beta)


def _true(wheel: Wheel, errors: CalibrationErrors, number: int) -> Wheel:
    radius = None if wheel.radius_m is None else wheel.radius_m * (1 + errors.radius[number])
    beta = None if wheel.beta_rad is None else wheel.beta_rad + errors.direction[number]
    return replace(wheel, radius_m=radius, beta_rad=beta)


def _marked(n: int, wheels: Iterable[int]) -> Bools:
    marked = np.zeros(n, dtype=np.bool_)
    marked[list(wheels)] = True
    return marked


def _filled(n: int, values: Mapping[int, float]) -> Floats:
    filled = np.zeros(n)
    for wheel, value in values.items():
        filled[wheel] = value
    return filled
