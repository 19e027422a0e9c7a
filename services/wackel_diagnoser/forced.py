"""How a robot moves whose wheels contradict each other: which of them slip, and which give way.

A wheel that points elsewhere than it shows forces the others to slip or to roll at another speed
than they are told. The motion is the one in which the friction of all wheels together gives the
robot the acceleration that is commanded. Friction is Coulomb's, smoothed by the creep of tyres;
drives give way by what they push. That is solved for all cases at once, with weights that follow
the slip (iteratively reweighted least squares).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import Measured, Rows
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive

GRIP_M_S2 = 6.5
"""All friction of a robot by its mass: rubber on a smooth floor, 0.7 of gravity."""
YIELDS_S = 0.008
"""What drives lose of their speed by the acceleration that they push with, before it is known: with
all their grip 5 cm/s, of a velocity control without integral part."""
LEAST_YIELDS_S, MOST_YIELDS_S = 0.001, 0.03
"""Stiffer drives move a robot no otherwise; softer ones would not drive it."""
CREEP_M_S = 0.001
CREEP_SHARE = 0.002
"""Slip at which a tyre has most of its grip: at rest, and by the speed. Tyres of cars have 5 %,
small hard wheels less. A wheel that stands 5° off slips more than either, so soft tyres do nearly
the same as stiff ones; but who takes tyres for soft expects a stiff robot to be turned."""
GYRATION = 0.8
"""Radius of gyration by the mean distance of the wheels."""
FIRST_ITERATIONS = 12
ITERATIONS = 2
"""From nothing, and from the forces of a moment ago, until more of them change yaw rates by less
than the floor does."""
YAW = 0.006
YAW_SHARE = 0.01
"""rad/s, and share of speed by length, by which predicted yaw rates miss a sound robot's."""
ROLL_M_S = 0.003
ROLL_SHARE = 0.005
"""The same of rolling speeds."""
POWER_M2_S3 = 0.01
POWER_SHARE = 0.03
"""The same of the power that slip takes by mass: what it is anyway, and by the speed in m/s."""
UNSURE = 0.4
"""Share by which the effect of a wheel that stands off may be another: grip, load and tyres are
only assumed."""
REGULAR = 1e-6 * np.eye(3)
"""For wheels that do not determine the motion."""
BOUND = 9.0
"""Of the square of a normalised miss."""
INDEPENDENT = 0.3
"""Share of a block of a tenth of a second that is new: robots do the same for longer."""

Block = Sequence[tuple[Step, Target, Measured, list[float]]]
"""Some successive steps, with the currents of the rolling motors."""


def can_force(drive: Drive) -> bool:
    """Whether all wheels steer, slide and roll."""
    return len(drive.slide_wheels) == len(drive.roll_wheels) == drive.n and bool(drive.steers.all())


class Observed(NamedTuple):
    """Means over a block.

    Attributes:
        heading: Of each wheel, rad, shape (n,): as shown, as much later as wheels follow.
        told: As told, likewise.
        speed: At which each wheel would have rolled without any load, m/s.
        rolled: At which it did.
        yaw: The gyros' rate, rad/s.
        acceleration: Of the references, in the robot frame, shape (3,).
        power: That motors delivered, A m/s; NaN where currents are not known.
        causes: What driving itself costs power for, see :class:`SlipPower`.
    """

    heading: Floats
    told: Floats
    speed: Floats
    rolled: Floats
    yaw: float
    acceleration: Floats
    power: float
    causes: Floats


def is_whole(block: Block, rows: Rows) -> bool:
    """Whether nothing is missing that :func:`observe` needs."""
    gyros = rows.gyros.stop - rows.gyros.start
    return gyros > 0 and all(measured.present is rows.every for _, _, measured, _ in block)


def observe(block: Block, rows: Rows, yields_s: float) -> Observed:
    """A block of two steps or more, which :func:`is_whole`.

    Drives lag because they give way to the robot's mass, by ``yields_s``: references, which lag as
    drives were seen to, have that in them.
    """
    (first, _, at_first, _), (last, _, at_last, _) = block[0], block[-1]
    seconds, intervals = (last.end - first.end) / 1e9, len(block) - 1
    each = np.array(
        [
            [
                *step.heading,
                *target.heading,
                *target.speed,
                *measured.rolled,
                *current,
            ]
            for step, target, measured, current in block
        ]
    ).reshape(len(block), 5, -1)
    heading, told, speed, rolled, _ = np.add.reduce(each) / len(block)
    begin, end = each[0, 2], each[-1, 2]
    hastened = float(end.dot(end) - begin.dot(begin))
    # A current is read at a step's end, which lies half way between the middles of two steps.
    current, between = each[:-1, 4].ravel(), (0.5 * (each[:-1, 3] + each[1:, 3])).ravel()
    gyros = [measured.z[rows.gyros].tolist() for _, _, measured, _ in block]
    yaw = [sum(rates) / len(rates) for rates in gyros]
    late = rows.lag_s / seconds * np.subtract(last.heading, first.heading)
    before, after = at_first.followed, at_last.followed
    vx, vy, omega = (0.5 * (a + b) for a, b in zip(before, after, strict=True))
    ax, ay, alpha = ((b - a) / seconds for a, b in zip(before, after, strict=True))
    return Observed(
        heading - late,
        told - late,
        speed + yields_s / seconds * (end - begin),
        rolled,
        sum(yaw) / len(yaw),
        np.array((ax - omega * vy, ay + omega * vx, alpha)),
        float(current.dot(between)) / intervals,
        np.array(
            (
                float(between.dot(between)) / intervals,
                0.5 * hastened / seconds,
                0.5 * (yaw[-1] ** 2 - yaw[0] ** 2) / seconds,
                float(np.abs(between).sum()) / intervals,
            )
        ),
    )


class Motion(NamedTuple):
    """How the robot moves in each of K cases.

    Attributes:
        yaw: Rates, rad/s, shape (K,).
        rolled: Speeds of the wheels, m/s, shape (K, n).
        force: With which each drives the robot, by its mass, m/s², shape (K, n).
        weights: Of slide and roll rows, 1/s, shape (K, 2 n).
    """

    yaw: Floats
    rolled: Floats
    force: Floats
    weights: Floats


class ForcedMotion:
    """Predicts it.

    Args:
        layout: Of a drive that :func:`can_force`.

    Attributes:
        yields_s: What drives lose of their speed by the acceleration that they push with.
    """

    def __init__(self, layout: Layout) -> None:
        drive = self._drive = layout.drive
        self._n = drive.n
        length = drive.length_m
        self._inertia: Floats = np.array([1.0, 1.0, (GYRATION * length) ** 2])
        self._anyway = np.column_stack((REGULAR, np.zeros(3)))  # of the normal equations
        self._grip = GRIP_M_S2 / drive.n
        self.yields_s = YIELDS_S
        self._length_m = length

    def adopt(self, yields_s: float) -> None:
        """What has been learnt of this robot's drives; 0: nothing."""
        if yields_s > 0.0:
            self.yields_s = min(max(yields_s, LEAST_YIELDS_S), MOST_YIELDS_S)

    def move(self, seen: Observed, heading: Floats, before: Motion | None) -> Motion:
        """How the robot would move in a block if wheels stood like this.

        Args:
            seen: The block.
            heading: True headings in each of K cases, shape (K, n).
            before: The same cases a moment ago.
        """
        return self.predict(heading, seen.speed, seen.acceleration, before)

    def compare(
        self,
        seen: Observed,
        motion: Motion,
        power: float,
        worse: Floats,
        costly: Floats,
        *,
        far: bool = False,
    ) -> tuple[Floats, Floats]:
        """How well each case explains what is seen.

        Args:
            seen: A block.
            motion: Of the cases; nothing is wrong in the first.
            power: That slip took by mass, m²/s³; NaN if unknown.
            worse: How much larger variances are than expected, shape (2 + n,).
            costly: Power that the same floor takes in each of F further cases in which no wheel
                stands off, m²/s³, shape (F,).
            far: Whether a wheel may stand so far off that no case explains the motion. Such a miss
                then says nothing, or the case that expects the least would win.

        Returns:
            Twice the negative logarithms of the likelihoods, up to a constant, shape (K + F,); and
            how far the first case misses yaw rate, rolling speeds and power: squares by their
            variances, shape (2 + n,).
        """
        fast, cases = max(map(abs, seen.speed.tolist())), len(motion.yaw)
        turned = YAW**2 + (YAW_SHARE * fast / self._length_m) ** 2
        rolled = ROLL_M_S**2 + (ROLL_SHARE * fast) ** 2
        variance = np.array((turned, *[rolled] * self._n, (POWER_M2_S3 + POWER_SHARE * fast) ** 2))
        effect = np.zeros((cases + len(costly), 2 + self._n))
        wrong = effect[:cases]
        wrong[:, 0], wrong[:, 1:-1] = motion.yaw, motion.rolled
        wrong[:, -1] = np.vecdot(motion.force, motion.rolled)
        off = wrong[0].copy()
        wrong -= off
        effect[cases:, -1] = costly
        off[0] -= seen.yaw
        off[1:-1] -= seen.rolled
        off[-1] = -power
        squares = off * off / variance
        if not math.isfinite(power):
            off[-1], effect[:, -1] = 0.0, 0.0
        usual = variance * worse
        miss = off + effect
        wide = usual + (UNSURE * effect) ** 2
        spread = np.log(wide / usual)
        bound = BOUND - spread if far else BOUND
        costs = np.minimum(miss * miss / wide, bound) + spread
        return costs.sum(axis=1), squares

    def grip_power(self, seen: Observed, angle: Floats) -> Floats:
        """What it would cost by mass if a wheel of the mean speed stood off by each of some angles,
        m²/s³."""
        speed = sum(map(abs, seen.speed.tolist())) / self._n
        return np.asarray(self._grip * speed * np.abs(np.sin(angle)))

    def predict(
        self,
        heading: Floats,
        speed: Floats,
        acceleration: Floats,
        before: Motion | None = None,
    ) -> Motion:
        """How the robot moves.

        Args:
            heading: Of each wheel, rad, finite, in each of K cases, shape (K, n).
            speed: At which each wheel is told to roll, m/s, shape (n,).
            acceleration: Commanded, in the robot frame, shape (3,).
            before: The same cases a moment ago.
        """
        n, stiffness = self._n, 1.0 / (self._n * self.yields_s)
        rows = self._drive.many_known_rows(heading)
        across = rows.swapaxes(1, 2)
        # The rows beside what they show, as the normal equations beside their right sides.
        known = np.zeros((*rows.shape[:2], 4))
        known[:, :, :3] = rows
        known[:, n:, 3] = speed
        anyway = self._anyway.copy()
        anyway[:, 3] -= self._inertia * acceleration
        creep = CREEP_M_S**2 + (CREEP_SHARE * max(map(abs, speed.tolist()))) ** 2
        if before is None:
            weights = np.full((len(heading), 2 * n), stiffness)
            force: Floats = np.zeros(heading.shape)
        else:
            weights, force = before.weights.copy(), before.force
        for left in range(FIRST_ITERATIONS if before is None else ITERATIONS, -1, -1):
            normal = (across * weights[:, None, :]) @ known
            normal += anyway
            twist = np.linalg.solve(normal[:, :, :3], normal[:, :, 3:])
            over = (rows @ twist)[:, :, 0]
            slower = speed - over[:, n:]
            if left:
                slid, pushed = over[:, :n], slower - force / stiffness
                weight = self._grip / np.sqrt(slid * slid + pushed * pushed + creep)
                weights[:, :n], weights[:, n:] = weight, weight * stiffness / (weight + stiffness)
            force = weights[:, n:] * slower
        return Motion(twist[:, 2, 0], speed - force / stiffness, force, weights)
