"""A robot's drive in one process and in virtual time, without bus: for many runs of a diagnosis.

::

    simulation = DriveSimulation(config, seed=1)
    simulation.inject(Injection(kind="wheel_blocked", wheel="w2", start_s=3.0))
    cycle = simulation.step(0.5, 0.0, 0.3)
"""

from dataclasses import dataclass
from math import inf, pi
from operator import sub
from random import Random

import numpy as np

from wackel_drive.layout import Joint
from wackel_kinematics.array import Floats
from wackel_kinematics.inverse import wheel_goals
from wackel_node.config import ConfigError, RobotConfig
from wackel_node.config_drive import GyroConfig
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.drive import ImuSample, TwistCommand
from wackel_schemas.virtual import Injection
from wackel_virtual.build import Build
from wackel_virtual.calibration_errors import CalibrationErrors
from wackel_virtual.drivetrain import Demand, Drivetrain, Physics

START_NS = 1_700_000_000_000_000_000
VELOCITY_STEP = 0.229 * 2 * pi / 60
"""Of Present Velocity, rad/s (e-manual, X series)."""
CURRENT_STEP = 2.69e-3
"""Of Present Current, A (e-manual, XM430-W210)."""
CURRENT_NOISE_A = 0.005
TORQUE_PERIOD_S = 1.0
"""In which a gateway reads each servo's Torque Enable once, one after the other."""
MOST_M_S = 3.0
"""Speed of a wheel that no motor exceeds."""


@dataclass(slots=True)
class Cycle:
    """One cycle: what a robot publishes of it, and the truth at its end.

    Attributes:
        command: What was asked of the drive, stamped at the cycle's start.
        state: What the servos say, at its end.
        imu: Of the first gyro, in its middle: the mean of the cycle.
        pose: x, y, heading; m and rad, the last not wrapped.
        twist: In the robot frame, m/s and rad/s.
    """

    command: TwistCommand
    state: BusState
    imu: ImuSample
    pose: Floats
    twist: Floats


class DriveSimulation:
    """The robot and its control, which turns twists into goals of the servos by the inverse
    kinematics with continuous steering.

    Args:
        robot: With a drive, whose servos are on one bus; without gyros it has one of the defaults.
        seed: Of everything random: the same calls with the same seed give the same cycles.
        physics: ``fast``, or ``mujoco`` (extra ``sim``).
        errors: Of the true robot; absent: drawn as large as the configuration assumes.
        build: What else it is like.
        rate: Cycles per second.

    Attributes:
        bus: Name of the bus of :attr:`Cycle.state`.
        gyro: Name of the gyro of :attr:`Cycle.imu`.

    Raises:
        ConfigError: The robot has no drive, or its servos are on several buses.
        ImportError: ``mujoco`` is not installed.
    """

    def __init__(
        self,
        robot: RobotConfig,
        seed: int | str,
        *,
        physics: Physics = "fast",
        errors: CalibrationErrors | None = None,
        build: Build = Build(),  # noqa: B008  (frozen)
        rate: float = 100.0,
    ) -> None:
        if robot.drive is None:
            raise ConfigError("drive is missing: there are no wheels to simulate")
        buses = {bus for wheel in robot.drive.wheels for bus, _ in wheel.servos()}
        if len(buses) != 1:
            raise ConfigError(f"drive.wheels: servos on buses {sorted(buses)}, expected one bus")
        self.bus = buses.pop()
        gyros = robot.gyros or {"body": GyroConfig(rate=rate)}
        self.gyro = next(iter(gyros))
        self._drivetrain = Drivetrain(
            robot.drive, gyros, seed, physics=physics, errors=errors, build=build
        )
        self._random = Random(f"{seed}/currents")
        layout = self._drivetrain.layout
        self._layout = layout
        self._step = robot.drive.encoder_step
        self._dt = 1.0 / rate
        self._goal = self._drivetrain.steered
        self._most = [MOST_M_S / (wheel.radius_m or inf) for wheel in layout.drive.wheels]
        self._powered = [True] * layout.drive.n
        self._offsets = [joint.offset if joint is not None else 0.0 for joint in layout.steering]
        motors, cycles = 2 * layout.drive.n, round(TORQUE_PERIOD_S * rate)
        self._torque_read: list[list[int]] = [[] for _ in range(cycles)]
        for motor in range(motors):
            self._torque_read[motor * cycles // motors].append(motor)
        self._cycle = 0

    @property
    def blocked(self) -> list[bool]:
        """Which wheels a fault holds now."""
        return self._drivetrain.blocked

    def inject(self, injection: Injection) -> None:
        """Have a fault begin ``start_s`` from now.

        Raises:
            InjectionError: Unknown kind, or a place or value that it cannot have.
        """
        self._drivetrain.inject(injection)

    def heal(self, kind: str = "", wheel: str | None = None) -> None:
        """End faults now; without kind and wheel all of them."""
        self._drivetrain.heal(kind, wheel)

    def step(self, vx: float, vy: float, omega: float) -> Cycle:
        """One cycle with this command: m/s, m/s, rad/s. Any twist is taken, possible or not."""
        begin = START_NS + round(self._cycle * self._dt * 1e9)
        self._cycle += 1
        end = START_NS + round(self._cycle * self._dt * 1e9)
        drivetrain = self._drivetrain
        self._goal, rates = wheel_goals(self._layout.drive, (vx, vy, omega), self._goal)
        rates = [min(most, max(-most, rate)) for most, rate in zip(self._most, rates, strict=True)]
        drivetrain.step(Demand(rates, self._powered, self._goal, self._powered), self._dt)
        sample = ImuSample(stamp=(begin + end) // 2, angular_velocity=drivetrain.sample(self.gyro))
        return Cycle(
            TwistCommand(stamp=begin, vx=vx, vy=vy, omega=omega),
            BusState(stamp=end, servos=self._servos()),
            sample,
            np.array(drivetrain.body.pose),
            np.array(drivetrain.body.twist),
        )

    def _servos(self) -> list[ServoState]:
        layout, drivetrain = self._layout, self._drivetrain
        n = layout.drive.n
        on = [*(not free for free in drivetrain.free), *[True] * n]
        read = self._torque_read[self._cycle % len(self._torque_read)]
        motors = zip(
            (*layout.rolling, *layout.steering),
            (*drivetrain.rolled, *map(sub, drivetrain.steered, self._offsets)),
            (*drivetrain.rate, *drivetrain.steering_rate),
            (*drivetrain.current, *drivetrain.steering_current),
            strict=True,
        )
        return [
            self._servo(joint, angle, rate, current, on[motor] if motor in read else None)
            for motor, (joint, angle, rate, current) in enumerate(motors)
            if joint is not None
        ]

    def _servo(
        self, joint: Joint, angle: float, rate: float, current: float, torque: bool | None
    ) -> ServoState:
        """As registers hold it."""
        sign, step = joint.sign, self._step
        shown = current + self._random.gauss(0.0, CURRENT_NOISE_A)
        return ServoState(
            id=joint.servo.id,
            position=step * round(sign * angle / step),
            velocity=VELOCITY_STEP * round(sign * rate / VELOCITY_STEP),
            current=CURRENT_STEP * round(sign * shown / CURRENT_STEP),
            torque_enabled=torque,
        )
