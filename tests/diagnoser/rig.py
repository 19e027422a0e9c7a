"""A simulated robot and its diagnoser, side by side: shared by tests and measurements."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from random import Random
from typing import Literal, Self

import numpy as np

from tests.diagnoser.driving import course
from tests.odometry.simulation import steered_drive
from wackel_diagnoser.core import Diagnoser
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_node.config import RobotConfig
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas.drive import Exclusions
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message
from wackel_schemas.residuals import Residuals
from wackel_schemas.virtual import Injection
from wackel_virtual.build import Build
from wackel_virtual.calibration_errors import CalibrationErrors
from wackel_virtual.drive_simulation import MOST_M_S, START_NS, Cycle, DriveSimulation

GYRO = "body"
WARM_UP_S = 30.0
"""Driving in which the diagnoser learns what its robot is like."""
LOST, LATE, LATEST_NS = 0.005, 0.1, 2_000_000
"""Of a busy computer: which share of all messages never comes, and which share of the states is
stamped late, by how much at most."""
TOGETHER = 200
"""Cycles that are simulated before they are diagnosed: in turn, each would push the other out of
the processor's nearest memory, which costs a seventh more."""
SEED = "tune/core"
SHORT_WARM_UP_S = 12.0
"""Of tests, for speed; the diagnoser is not at its sharpest yet."""


@dataclass
class Rig:
    """A robot that drives.

    Attributes:
        simulation: The robot.
        diagnoser: What it is told.
        config: Its drive.
        path: Commanded twists, one a cycle.
        busy: What draws how messages suffer from a busy computer; ``None``: it has nothing to do.
        cycles: How many have passed.
        reports: All changes of faults.
        exclusions: The latest.
        residuals: The latest.
    """

    simulation: DriveSimulation
    diagnoser: Diagnoser
    config: DriveConfig
    path: Floats
    busy: Random | None = None
    cycles: int = 0
    reports: list[FaultReport] = field(default_factory=list)
    exclusions: Exclusions | None = None
    residuals: Residuals | None = None

    @classmethod
    def of(
        cls,
        seed: str,
        drive: DriveConfig | int = 4,
        *,
        physics: Literal["fast", "mujoco"] = "fast",
        worse: float = 1.0,
        driving: str = "random",
        build: Build = Build(),  # noqa: B008  (frozen)
        busy: bool = False,
        shown: bool = True,
        course_s: float = 120.0,
    ) -> Self:
        """A new robot; ``drive``: or how many steered wheels it has.

        Args:
            seed: Of its errors, its noise, its path and its faults.
            drive: See above.
            physics: Of the simulation.
            worse: By how much its calibration is worse than its configuration says.
            driving: A kind of :mod:`tests.diagnoser.driving`.
            build: What else it is like.
            busy: Whether its computer is.
            shown: Whether anyone looks at residuals.
            course_s: How long it drives until it goes the same way again.
        """
        config = steered_drive(drive) if isinstance(drive, int) else drive
        gyro = GyroConfig()
        simulation = DriveSimulation(
            RobotConfig(drive=config, gyros={GYRO: gyro}),
            seed,
            physics=physics,
            errors=CalibrationErrors.drawn(config, gyro, seed, worse),
            build=build,
        )
        rng = np.random.default_rng(Random(seed).getrandbits(63))
        sideways = config.kind in ("steered", "mecanum", "omni")
        path = course(driving, rng, course_s, sideways=sideways, friction=build.friction)
        path *= _share(path, config)[:, None]
        diagnoser = Diagnoser(config, {GYRO: gyro}, lambda: shown)
        return cls(
            simulation, diagnoser, config, path, busy=Random(f"{seed}/busy") if busy else None
        )

    def copy(self) -> Self:
        """The same robot once more, to go another way from here."""
        return copy.deepcopy(self)

    def inject(self, kind: str, wheel: str | None = None, value: float | None = None) -> None:
        """A fault begins now."""
        self.simulation.inject(Injection(kind=kind, wheel=wheel, value=value))

    @property
    def now_ns(self) -> int:
        """Stamp of the next command."""
        return START_NS + self.cycles * 10_000_000

    def cycle(self, twist: Floats | None = None) -> Cycle:
        """One cycle; without a twist, that of the path."""
        cycle = self._move(twist)
        self._diagnose(cycle)
        return cycle

    def _move(self, twist: Floats | None) -> Cycle:
        if twist is None:
            twist = self.path[self.cycles % len(self.path)]
        self.cycles += 1
        return self.simulation.step(*twist.tolist())

    def _diagnose(self, cycle: Cycle) -> None:
        for message in self.feed(cycle):
            self.take(message)

    def take(self, message: Message) -> None:
        """What the diagnoser has said."""
        if isinstance(message, FaultReport):
            self.reports.append(message)
        elif isinstance(message, Exclusions):
            self.exclusions = message
        elif isinstance(message, Residuals):
            self.residuals = message

    def feed(self, cycle: Cycle) -> Iterator[Message]:
        """What the diagnoser says of a cycle."""
        if self.busy is not None and self.busy.random() < LATE:
            cycle.state.stamp += round(self.busy.uniform(0.0, LATEST_NS))
        if self._comes():
            self.diagnoser.command(cycle.command)
        if self._comes():
            yield from self.diagnoser.imu(self.simulation.gyro, cycle.imu)
        if self._comes():
            yield from self.diagnoser.bus_state(self.simulation.bus, cycle.state)

    def _comes(self) -> bool:
        """Whether the next message does."""
        return self.busy is None or self.busy.random() >= LOST

    def drive(self, seconds: float, twist: Floats | None = None) -> None:
        """Some cycles: what is simulated does not depend on what is concluded."""
        left = round(seconds * 100)
        while left:
            count = min(left, TOGETHER)
            for cycle in [self._move(twist) for _ in range(count)]:
                self._diagnose(cycle)
            left -= count

    def active(self) -> list[tuple[str, str]]:
        """Code and component of what is active."""
        return [(report.code, report.component) for report in self.diagnoser.active()]


def _share(path: Floats, config: DriveConfig) -> Floats:
    """How much of each twist a control commands, where wheels that do not steer had to roll faster
    than their motors can: all of the robot is slower then, shape (m,)."""
    drive = Layout(config).drive
    rolls = drive.rows(drive.steering(np.zeros(drive.n)))[len(drive.slide_wheels) :]
    fastest = np.abs(path @ rolls[~drive.steers[drive.roll_wheels]].T).max(axis=1, initial=MOST_M_S)
    return np.asarray(MOST_M_S / fastest)
