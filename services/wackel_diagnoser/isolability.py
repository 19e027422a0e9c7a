"""Which faults a drive's geometry can tell apart, and in which motion: the bank asked beforehand.

Each fault of a typical size is put into the measurements of each motion, without noise. The
evidence that the bank then gives per step says whether the fault shows, and against which others.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from wackel_diagnoser.bank import Bank
from wackel_diagnoser.hypotheses import Hypotheses
from wackel_diagnoser.reference import Target, Twist
from wackel_diagnoser.rows import Rows
from wackel_diagnoser.sequential import INDEPENDENT, LEAD, MEMORY_S, threshold
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.inverse import inverse
from wackel_node.config_drive import DriveConfig, GyroConfig

RATE = 100.0
SPEED = 0.5
"""m/s: walking pace of a small robot."""
MOTIONS: dict[str, Twist] = {
    "straight ahead": (SPEED, 0.0, 0.0),
    "sideways": (0.0, SPEED, 0.0),
    "a circle of 1 m": (SPEED, 0.0, SPEED),
    "a turn on the spot": (0.0, 0.0, 2 * SPEED),
    "a curve while crabbing": (0.7 * SPEED, 0.7 * SPEED, 0.7 * SPEED),
}
SLOW = 0.2
"""Share by which a wheel's speed is wrong."""
OFF_RAD = math.radians(5.0)
"""By how much a steering stands off."""
GYRO_OFF = 0.1
"""rad/s."""
SEEN_S = 2.0
"""A fault that needs longer than this does not show in a motion."""
FEASIBLE = 0.02
"""m/s by which a motion that the drive can do may drag a wheel sideways."""


@dataclass(frozen=True)
class Visibility:
    """One fault in one motion.

    Attributes:
        seen_s: Time to an alarm; infinite: never.
        like: Other components that explain it as well.
    """

    seen_s: float
    like: tuple[str, ...]


class Isolability:
    """Asks the bank.

    Args:
        config: The drive.
        gyros: By name.
        commanded: Whether it is known what wheels should do.
    """

    def __init__(
        self, config: DriveConfig, gyros: Mapping[str, GyroConfig], *, commanded: bool = True
    ) -> None:
        self._commanded = commanded
        self._layout = Layout(config)
        self._config = config
        self._gyros = gyros
        self._hypotheses = Hypotheses(self._layout, gyros)
        self._bank = Bank(self._hypotheses.spread)
        self._limit = threshold(len(self._hypotheses), RATE)

    def motions(self) -> dict[str, Twist]:
        """Those that the drive can do."""
        drive = self._layout.drive
        return {
            name: twist
            for name, twist in MOTIONS.items()
            if np.abs(inverse(drive, np.array(twist), drive.steering(np.zeros(drive.n))).slip).max()
            < FEASIBLE
        }

    def faults(self) -> list[str]:
        """Components of wheels and gyros, as the diagnoser names them."""
        hypotheses = self._hypotheses
        names = [hypotheses.each[i].components[0] for i in hypotheses.singles]
        return [name for name in dict.fromkeys(names) if "/" in name]

    def look(self, fault: str, twist: Twist) -> Visibility:
        """How a fault shows in a motion."""
        step, target = self._moving(twist)
        step = self._with(step, fault)
        bias, unloaded = np.zeros(len(self._gyros)), [0.0] * len(target.speed)
        rows = Rows(self._layout, self._config, self._gyros)
        rows.adopt(rows.configured)  # as driving will have shown
        for _ in range(2):  # the fault lasts: nothing has just jumped
            measured = rows.measure(step, target, bias, unloaded)
        variance, _, size = measured.spread()
        likelihood = self._bank.evaluate(measured.z, measured.h, variance, size)
        hypotheses = self._hypotheses
        best = [
            float((likelihood + hypotheses.prior / (MEMORY_S * RATE * INDEPENDENT))[m].max())
            for m in hypotheses.members
        ]
        here = hypotheses.explanations.index((fault,))
        evidence = INDEPENDENT * (best[here] - best[0])
        seen_s = self._limit / (evidence * RATE) if evidence > 0 else math.inf
        needed = LEAD / (MEMORY_S * RATE)
        like = [
            names[0]
            for i, names in enumerate(hypotheses.explanations)
            if len(names) == 1 and i != here and INDEPENDENT * (best[here] - best[i]) < needed
        ]
        return Visibility(seen_s, tuple(like))

    def _moving(self, twist: Twist) -> tuple[Step, Target]:
        """A step without a fault, and what it should have been."""
        drive = self._layout.drive
        motion = inverse(drive, np.array(twist), drive.steering(np.zeros(drive.n)))
        heading = np.where(drive.steers, drive.heading(motion.steering), np.nan)
        shown = np.where(drive.steers, heading, 0.0)
        rates = np.full(drive.n, np.nan)
        rates[drive.roll_wheels] = motion.wheel_rate[drive.roll_wheels]
        nanoseconds, still = round(1e9 / RATE), [0.0] * drive.n
        gyros = [twist[2]] * len(self._gyros)
        step = Step(0, nanoseconds, 1 / RATE, heading.tolist(), still, rates.tolist(), gyros)
        speed = (drive.roll_radius * motion.wheel_rate[drive.roll_wheels]).tolist()
        on_time = [0.0] * len(speed)
        target = Target(
            heading.tolist(), still, still, speed, on_time, on_time, shown.tolist(), twist, 0.0
        )
        if not self._commanded:
            nothing = [math.nan] * drive.n
            target = Target(
                nothing,
                nothing,
                still,
                [math.nan] * len(speed),
                on_time,
                on_time,
                nothing,
                (math.nan,) * 3,
                0.0,
                known=False,
            )
        return step, target

    def _with(self, step: Step, fault: str) -> Step:
        place = self._hypotheses.place(fault)
        if place is None:
            number = list(self._gyros).index(fault.removeprefix("gyro/"))
            rate = step.gyro_rate.copy()
            rate[number] += GYRO_OFF
            return replace(step, gyro_rate=rate)
        part, wheel = place
        if part == "drive":
            rates = step.wheel_rate.copy()
            rates[wheel] *= 1 - SLOW
            return replace(step, wheel_rate=rates)
        heading = step.heading.copy()
        heading[wheel] += OFF_RAD
        return replace(step, heading=heading)
