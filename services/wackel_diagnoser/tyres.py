"""How tyres slip when all wheels follow their references: for those contradict each other while
wheels turn, and what changes the robot's motion pulls at all of them."""

import math
from collections.abc import Sequence
from struct import Struct

import numpy as np

from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive

FORCED = 0.8
"""A wheel's slip by what the references of all wheels, each with its own lag, force on it."""
SKIDS = 0.083
"""Slip by speed at which a tyre has spent all its grip and skids: rubber, by the brush model. It is
0.12 on a floor that holds 6.5 m/s², and so much less where one holds less that a tyre which is
loaded little creeps the same. With a share f of its grip, it creeps by 1 - (1 - f)^(1/3) of that,
and the less it is loaded, the more all creep alike: f of that differs from wheel to wheel, and of
this again a share is one wheel's."""
HOLDS_M_S2 = 5.4
"""Acceleration at which they skid, if all push alike: rubber on a dusty floor (friction of 0.6),
less a tenth, as a robot that brakes leans on some of them. A command that jumps asks for more, and
the robot is late by the rest, long after wheels roll and stand as they should."""
REGULAR = 1e-9 * np.eye(3)
"""For drives whose rows do not determine the twist."""


class Tyres:
    """Follows them.

    Args:
        drive: The wheels.

    Attributes:
        late_yaw: rad/s by which the robot turns otherwise than its wheels, for what they do not
            hold; 0 where each pushes any way, and friction decides.
        skids: Whether the robot has to catch up with what wheels ask of it beyond what they hold.
    """

    def __init__(self, drive: Drive) -> None:
        self.late_yaw, self.skids = 0.0, False
        self._n, self._length_m = drive.n, drive.length_m
        self._root = math.sqrt(len(drive.row_wheels))
        # Of all rows, from those of the roll rows: none slides.
        count = len(drive.row_wheels)
        self._pack = Struct(f"={8 * drive.slide_count}x{count - drive.slide_count}d").pack
        straight = drive.rows(drive.steering(np.zeros(drive.n)))
        # By how much the force of each row's wheel is larger than the row's.
        levers = np.hypot(straight[:, 0], straight[:, 1]).tolist()
        self._levers = list(zip(drive.row_wheels.tolist(), levers, strict=True))
        # The rows of a wheel that has both are square to each other, at any angle.
        both = set(drive.slide_wheels.tolist()) & set(drive.roll_wheels.tolist())
        self._any_way = len(both) == drive.n
        turning = {i for i in drive.row_wheels.tolist() if drive.steers[i]}
        self._inverse = _inverse(straight) if turning <= both else None
        # What they have given the robot of the twist that wheels make: m/s, m/s, rad/s.
        self._given: tuple[float, float, float] | None = None

    def slip(self, rows: Floats, speeds: list[float]) -> tuple[list[float], float, list[float]]:
        """How much references contradict each other.

        Args:
            rows: Slide and roll rows of the references.
            speeds: At which wheels should roll, m/s, of each roll row.

        Returns:
            m/s by which each row may be off, and on average; and the twist that they make, m/s and
            rad/s.
        """
        values = np.frombuffer(self._pack(*speeds))  # in half the time of an array of them
        twist = self._inverse_of(rows).dot(values.dot(rows))
        slip: list[float] = (rows.dot(twist) - values).tolist()
        mean = math.hypot(*slip) / self._root
        return [FORCED * abs(each) for each in slip], mean, twist.tolist()

    def creep(
        self, rows: Floats, followed: Sequence[float], mean: float, speed: float, seconds: float
    ) -> float:
        """How much all slip since wheels hasten the robot, m/s; 0 if it is not known.

        Args:
            rows: As above.
            followed: Twist that the wheels make, m/s and rad/s.
            mean: How much they slip against each other, m/s. Beyond what tyres creep with all their
                grip, it takes its share of that: a tyre pushes against the way in which it slips.
            speed: The fastest wheel's, m/s.
            seconds: Since the last step.
        """
        x, y, omega = followed
        known = math.isfinite(x + y + omega)
        if self._given is None or not known:
            self._given = (x, y, omega) if known else None
            self.late_yaw, self.skids = 0.0, False
            return 0.0
        before_x, before_y, before_omega = self._given
        # Left alone, it goes straight on over the floor.
        turned = before_omega * seconds
        gone_x, gone_y = before_x + turned * before_y, before_y - turned * before_x
        dx, dy, turn = x - gone_x, y - gone_y, omega - before_omega
        asked = math.hypot(dx, dy, self._length_m * turn)
        whole, skids = HOLDS_M_S2 * seconds, SKIDS * speed
        if not self._any_way:
            whole *= self._share(rows, (dx, dy, self._length_m * turn), asked)
        fight = max(mean - skids, 0.0)
        given = min(asked, whole * asked / math.hypot(asked, fight) if fight else whole)
        share = given / asked if asked else 1.0
        self.skids = given < asked
        self._given = gone_x + share * dx, gone_y + share * dy, before_omega + share * turn
        if not self._any_way:
            self.late_yaw = abs(turn) * (1.0 - share)
        load = given / whole
        return skids * load * (1.0 - math.cbrt(1.0 - load)) + asked - given

    def _share(self, rows: Floats, change: tuple[float, float, float], asked: float) -> float:
        """Of the grip of all wheels, that can change the robot's motion so: wheels that do not roll
        by themselves do not push along, and those with rollers not across.

        Args:
            rows: As above.
            change: m/s along, to the left, and about at the wheels' distance.
            asked: Its size, m/s.
        """
        x, y, about = change
        # The least forces of rows that do it, by the robot's mass and the step.
        needed = np.array((x, y, self._length_m * about))
        forces: list[float] = rows.dot(self._inverse_of(rows).dot(needed)).tolist()
        squares = [0.0] * self._n
        for force, (wheel, lever) in zip(forces, self._levers, strict=True):
            squares[wheel] += (lever * force) ** 2
        most = self._n * math.sqrt(max(squares))
        return asked / most if most > asked else 1.0

    def _inverse_of(self, rows: Floats) -> Floats:
        """Of the rows' normal matrix; of most drives it is the same at all angles."""
        return _inverse(rows) if self._inverse is None else self._inverse


def _inverse(rows: Floats) -> Floats:
    return np.asarray(np.linalg.inv(rows.T @ rows + REGULAR))
