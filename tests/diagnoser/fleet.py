"""Robots without a fault, no two alike, in which false alarms are counted.

Half of them have three wheels and half four, half are simulated with contact physics, half drive on
random paths and the others in the ways of :mod:`tests.diagnoser.driving`. A quarter has a busy
computer. One in eleven is three times worse calibrated than configured.
"""

from dataclasses import dataclass
from random import Random

from tests.diagnoser.driving import DRIVING
from tests.diagnoser.rig import Rig
from wackel_virtual.build import Build
from wackel_virtual.drivetrain import Physics

COMPLAINTS = ("command_infeasible", "command_singular")
"""Of the command, which is as it is: no faults of the robot."""
WORSE_SHARE = 1 / 11
"""Of the robots; so many are worse calibrated that both aims are told at the same time."""
BUSY_SHARE = 1 / 4
ROBOT_S = 300.0
"""For how long each drives."""


@dataclass(frozen=True)
class Member:
    """A robot.

    Attributes:
        seed: Of it, from which all else is drawn.
        wheels: How many.
        physics: Of its simulation.
        driving: Its kind.
        worse: By how much its calibration is worse than configured.
        busy: Whether its computer is, see :attr:`Rig.busy`.
        build: What else it is like.
    """

    seed: str
    wheels: int
    physics: Physics
    driving: str
    worse: float
    busy: bool
    build: Build

    @classmethod
    def of(cls, fleet: str, number: int) -> "Member":
        """That with a number, in a fleet of that name."""
        seed = f"{fleet}/{number}"
        random = Random(seed)
        return cls(
            seed,
            random.choice((3, 4)),
            random.choice(("fast", "mujoco")),
            random.choice(("random", random.choice(list(DRIVING)))),
            3.0 if random.random() < WORSE_SHARE else 1.0,
            random.random() < BUSY_SHARE,
            Build.drawn(random),
        )

    def rig(self) -> Rig:
        """It and its diagnoser, before they drive."""
        return Rig.of(
            self.seed,
            self.wheels,
            physics=self.physics,
            worse=self.worse,
            driving=self.driving,
            build=self.build,
            busy=self.busy,
            shown=False,
            course_s=ROBOT_S,
        )

    def drive(self) -> list[str]:
        """Code and component of each report, and when, s: all of them are false."""
        rig = self.rig()
        begin_ns = rig.now_ns
        rig.drive(ROBOT_S)
        return [
            f"{report.code} {report.component} after {(report.stamp - begin_ns) / 1e9:.1f} s"
            for report in rig.reports
            if report.status == "active" and report.code not in COMPLAINTS
        ]
