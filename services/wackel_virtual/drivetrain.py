"""The drive of the virtual robot: motors, body, faults, and what its sensors show of them.

Angles are those of the wheels as :class:`~wackel_drive.layout.Layout` has them: rolling forward
and the heading as the servos believe it. Where wheel and servo differ (calibration, a wrong
reference, a loose wheel), the difference lies between this and the body.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import cos, exp, hypot, pi, sin
from operator import add, sub
from random import Random
from typing import Literal

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.drive import Drive
from wackel_kinematics.wheel import Wheel
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas.virtual import Injection
from wackel_virtual.body import GRAVITY, MOST_EFFORT, Body, WheelStates, World
from wackel_virtual.build import FAST_M_S, Build
from wackel_virtual.calibration_errors import CalibrationErrors
from wackel_virtual.drive_course import PATCH_RADIUS_M, DriveCourse
from wackel_virtual.drive_faults import DriveConditions, drive_conditions
from wackel_virtual.fast_body import FastBody
from wackel_virtual.gyro import VirtualGyro
from wackel_virtual.motion import FRICTION_A

Physics = Literal["fast", "mujoco"]

STEERING_A = 0.8
"""Current of a steering servo, by its torque in the unit of efforts; its friction comes on top."""
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
    """What the servos are told; lists of n.

    Attributes:
        rate: Goal of rolling, rad/s.
        powered: Whether the motor has torque.
        heading: Goal of the steering, rad; of a wheel that does not steer, its heading.
        steering_powered: Whether the steering has torque; without, it stays where it is: its gear
            is harder to turn than its wheel on the floor.
    """

    rate: list[float]
    powered: list[bool]
    heading: list[float]
    steering_powered: list[bool]


class Drivetrain:
    """The true drive.

    Args:
        drive: As configured.
        gyros: By name.
        seed: Of everything random.
        physics: Which body.
        errors: How it differs from the configuration; absent: drawn as large as that assumes.
        build: What else it is like.

    Attributes:
        layout: As configured.
        body: Where it is, and how it moves.
        rolled: What the encoders show, rad.
        rate: rad/s.
        steered: Heading that the sensors show, rad.
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
        build: Build = Build(),  # noqa: B008  (frozen)
    ) -> None:
        self._build = build
        self.layout = Layout(drive)
        nominal = self.layout.drive
        first = next(iter(gyros.values()), GyroConfig())
        errors = errors or CalibrationErrors.drawn(drive, first, seed)
        self._direction = errors.direction
        true = Drive([_true(wheel, errors, i) for i, wheel in enumerate(nominal.wheels)])
        # Steerings stand straight ahead.
        self._heading: list[float] = nominal.heading(nominal.steering(np.zeros(nominal.n))).tolist()
        heading = [*map(add, self._heading, self._direction)]
        self.body = _body(physics, true, heading, seed, build)
        self._gyros = {
            name: (
                VirtualGyro(each, f"{seed}/{name}", errors.gyro_bias, errors.gyro_scale),
                _Heading(),
            )
            for name, each in gyros.items()
        }
        self._course = DriveCourse(self.layout, seed)
        self._radii = [wheel.radius_m or 0.0 for wheel in nominal.wheels]
        self._time_s = 0.0
        still = [0.0] * nominal.n
        self._rate = still
        self.rolled = still
        self.rate = still
        self.steered = self._heading
        self.steering_rate = still
        self.current = still
        self.steering_current = still
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
        gain = 1.0 - exp(-duration_s / self._build.lag_s)

        powered = [on and not off for on, off in zip(demand.powered, self.free, strict=True)]
        self._rate = [
            rate + gain * (scale * goal - rate) if on else rolls
            for on, rate, scale, goal, rolls in zip(
                powered, self._rate, self._scale, demand.rate, body.rate, strict=True
            )
        ]
        turns = self._steer(demand, gain, STEERING_LIMIT_RAD_S * duration_s)

        before = body.angle
        wheels = WheelStates(
            rate=self._rate,
            driven=[on and not loose for on, loose in zip(powered, self._loose, strict=True)],
            blocked=self.blocked,
            heading=[
                heading + direction + reference
                for heading, direction, reference in zip(
                    self._heading, self._direction, self._reference, strict=True
                )
            ],
        )
        body.step(wheels, self._world(), duration_s)

        rate, turned = [*body.rate], [*map(sub, body.angle, before)]
        for wheel in self._conditions.loose:
            rate[wheel], turned[wheel] = self._rate[wheel], self._rate[wheel] * duration_s
        grip, rolling = self._build.grip_A, self._build.rolling_A / FAST_M_S
        self.current = [
            grip * effort + rolling * each * radius if on else 0.0
            for on, effort, each, radius in zip(
                powered, body.effort, rate, self._radii, strict=True
            )
        ]
        self._show(rate, turned, [turn / duration_s for turn in turns], duration_s)

    def sample(self, name: str) -> tuple[float, float, float]:
        """What a gyro shows of the time since its last sample."""
        gyro, heading = self._gyros[name]
        now_s, angle = self._time_s, self.body.pose[2]
        passed = now_s - heading.time_s
        mean = (angle - heading.angle) / passed if passed > 0 else self.body.twist[2]
        heading.time_s, heading.angle = now_s, angle
        now = self._conditions
        return gyro.sample(mean, now.gyro_offset, frozen=now.gyro_frozen)

    def _steer(self, demand: Demand, gain: float, most: float) -> list[float]:
        """Steerings follow their goals.

        Args:
            demand: With the goals.
            gain: Share of the way that they go.
            most: Angle that they turn at most, rad.

        Returns:
            How far each turned, rad.
        """
        turned, current = [], []
        for on, jammed, goal, offset, heading in zip(
            demand.steering_powered,
            self._jammed,
            demand.heading,
            self._offset,
            self._heading,
            strict=True,
        ):
            error = goal + offset - heading
            turn = min(most, max(-most, gain * error)) if on and not jammed else 0.0
            effort = min(MOST_EFFORT, max(-MOST_EFFORT, error * MOST_EFFORT / STIFF_RAD))
            turned.append(turn)
            current.append(STEERING_A * effort + FRICTION_A * turn / most if on else 0.0)
        self._heading = [*map(add, self._heading, turned)]
        self.steering_current = current
        return turned

    def _show(
        self, rate: list[float], turned: list[float], steering_rate: list[float], passed_s: float
    ) -> None:
        """Readings, with the faults of sensors; lists are changed in place."""
        now = self._conditions
        for wheel, play in now.free.items():
            swing = 1.0 + play * sin(2 * pi * PLAY_HZ * self._time_s)
            rate[wheel], turned[wheel] = rate[wheel] * swing, turned[wheel] * swing
        for wheel, more in now.drive_reading.items():
            shown = 1.0 + more
            rate[wheel], turned[wheel] = rate[wheel] * shown, turned[wheel] * shown
        for wheel, stuck in now.drive_stuck.items():
            rate[wheel], turned[wheel] = stuck, stuck * passed_s
        self.rolled = [*map(add, self.rolled, turned)]
        self.rate = rate
        steered = [*self._heading]
        for wheel, error in now.steering_reading.items():
            steered[wheel] += error
        for wheel, angle in self._stuck.items():
            steered[wheel], steering_rate[wheel] = angle, 0.0
        self.steered, self.steering_rate = steered, steering_rate

    def _take_over(self, now: DriveConditions) -> None:
        """Conditions as lists, by wheel."""
        self._conditions = now
        n = self.layout.drive.n
        self.free = _marked(n, now.free)
        self.blocked = _marked(n, now.blocked)
        self._loose = _marked(n, now.loose)
        self._jammed = _marked(n, now.steering_blocked)
        self._scale = _filled(n, now.drive_scale, 1.0)
        self._offset = _filled(n, now.offset)
        self._reference = _filled(n, now.reference)
        self._stuck = {
            wheel: self._stuck.get(wheel, self.steered[wheel]) if heading is None else heading
            for wheel, heading in now.steering_stuck.items()
        }
        # Without patches and pushes.
        self._calm_world = World(
            [now.slippery.get(i, self._build.friction) for i in range(n)], (0.0, 0.0, 0.0)
        )

    def _world(self) -> World:
        now = self._conditions
        if not (now.patches or now.pushes):
            return self._calm_world
        friction = [*self._calm_world.friction]
        x, y, heading = self.body.pose
        cosine, sine = cos(heading), sin(heading)
        for i, (along, left) in enumerate(self.layout.drive.xy.tolist()):
            at = (x + cosine * along - sine * left, y + sine * along + cosine * left)
            for px, py, slippery in now.patches:
                if hypot(at[0] - px, at[1] - py) < PATCH_RADIUS_M:
                    friction[i] = min(friction[i], slippery)
        push = (0.0, 0.0, 0.0)
        for angle, lever, share in now.pushes:
            force = share * GRAVITY
            moment = force * lever * self.layout.drive.length_m
            along, left = force * cos(angle - heading), force * sin(angle - heading)
            push = (push[0] + along, push[1] + left, push[2] + moment)
        return World(friction, push)


@dataclass(slots=True)
class _Heading:
    """At a gyro's last sample."""

    time_s: float = 0.0
    angle: float = 0.0


def _body(
    physics: Physics, drive: Drive, heading: list[float], seed: int | str, build: Build
) -> Body:
    if physics == "fast":
        return FastBody(drive, Random(f"{seed}/floor").getrandbits(64), build)
    from wackel_virtual.mujoco_body import MujocoBody

    return MujocoBody(drive, heading, build)


def _true(wheel: Wheel, errors: CalibrationErrors, number: int) -> Wheel:
    radius = None if wheel.radius_m is None else wheel.radius_m * (1 + errors.radius[number])
    beta = None if wheel.beta_rad is None else wheel.beta_rad + errors.direction[number]
    return replace(wheel, radius_m=radius, beta_rad=beta)


def _marked(n: int, wheels: Iterable[int]) -> list[bool]:
    marked = [False] * n
    for wheel in wheels:
        marked[wheel] = True
    return marked


def _filled(n: int, values: Mapping[int, float], base: float = 0.0) -> list[float]:
    """By wheel, each added to the base."""
    return [base + values.get(i, 0.0) for i in range(n)]
