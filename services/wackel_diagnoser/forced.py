"""How a robot moves whose wheels contradict each other: which of them slip, and which give way.

A wheel that points elsewhere than it shows forces the others to slip or to roll at another speed
than they are told. The motion is the one in which the friction of all wheels together gives the
robot the acceleration that is commanded. Friction is Coulomb's, smoothed by the creep of tyres;
drives give way by what they push. That is solved for all cases at once, with weights that follow
the slip (iteratively reweighted least squares).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import Measured, Rows
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive

GRIP_M_S2 = 6.5
"""All friction of a robot by its mass: rubber on a smooth floor, 0.7 of gravity."""
GIVES_WAY_M_S = 0.06
"""What a wheel loses of its speed when its drive pushes with all its grip: velocity control without
integral part."""
CREEP_M_S = 0.005
CREEP_SHARE = 0.02
"""Slip at which a tyre has most of its grip: at rest, and by the speed. Tyres of cars have 5 %,
small hard wheels less."""
GYRATION = 0.8
"""Radius of gyration by the mean distance of the wheels."""
ITERATIONS = 3
"""The fourth changes yaw rates by less than the floor does."""
YAW = 0.006
YAW_SHARE = 0.01
"""rad/s, and share of speed by length, by which predicted yaw rates miss a sound robot's."""
ROLL_M_S = 0.003
ROLL_SHARE = 0.005
"""The same of rolling speeds."""
BOUND = 9.0
"""Of the square of a normalised miss."""
INDEPENDENT = 0.3
"""Share of a block of a tenth of a second that is new: robots do the same for longer."""

Block = Sequence[tuple[Step, Target, Measured]]
"""Some successive steps."""


def can_force(drive: Drive) -> bool:
    """Whether all wheels steer, slide and roll."""
    return len(drive.slide_wheels) == len(drive.roll_wheels) == drive.n and bool(drive.steers.all())


@dataclass(frozen=True)
class Observed:
    """Means over a block.

    Attributes:
        heading: Of each wheel as shown, rad, shape (n,).
        told: As told.
        speed: At which each wheel was told to roll, m/s.
        rolled: At which it did.
        yaw: The gyros' rate, rad/s.
        acceleration: Commanded, in the robot frame, shape (3,).
    """

    heading: Floats
    told: Floats
    speed: Floats
    rolled: Floats
    yaw: float
    acceleration: Floats


def observe(block: Block, rows: Rows) -> Observed | None:
    """A block of two steps or more; ``None`` if anything is missing."""
    gyros = np.array([measured.z[rows.gyros] for _, _, measured in block])
    first, last = block[0][1].twist, block[-1][1].twist
    present = np.array([measured.present for _, _, measured in block])
    if not gyros.size or not present.all():
        return None
    vx, vy, omega = (0.5 * (first + last)).tolist()
    seconds = (block[-1][0].end - block[0][0].end) / 1e9
    return Observed(
        _mean([step.heading for step, _, _ in block]),
        _mean([target.heading for _, target, _ in block]),
        _mean([target.speed for _, target, _ in block]),
        _mean([measured.z[rows.rolls] for _, _, measured in block]),
        float(gyros.mean()),
        (last - first) / seconds + np.array([-omega * vy, omega * vx, 0.0]),
    )


def _mean(values: list[Floats]) -> Floats:
    return np.asarray(np.add.reduce(values) / len(values))


class ForcedMotion:
    """Predicts it.

    Args:
        layout: Of a drive that :func:`can_force`.
    """

    def __init__(self, layout: Layout) -> None:
        drive = self._drive = layout.drive
        self._to_beta = math.pi / 2 - drive.alpha
        self._n = drive.n
        length = drive.length_m
        self._inertia: Floats = np.array([1.0, 1.0, (GYRATION * length) ** 2])
        self._grip = GRIP_M_S2 / drive.n
        self._stiffness = self._grip / GIVES_WAY_M_S
        self._length_m = length

    def misses(self, seen: Observed, heading: Floats) -> Floats:
        """By how much what is seen misses what would be if wheels stood like this: squares by their
        variance, of the yaw rate and of each wheel's speed, shape (K, 1 + n).

        Args:
            seen: A block.
            heading: True headings in each of K cases, shape (K, n).
        """
        yaw, rolled = self.predict(heading + self._to_beta, seen.speed, seen.acceleration)
        fast = float(np.abs(seen.speed).max())
        off = np.column_stack([yaw - seen.yaw, rolled - seen.rolled])
        variance = np.full(1 + self._n, ROLL_M_S**2 + (ROLL_SHARE * fast) ** 2)
        variance[0] = YAW**2 + (YAW_SHARE * fast / self._length_m) ** 2
        return np.asarray(off * off / variance)

    def predict(
        self, steering: Floats, speed: Floats, acceleration: Floats
    ) -> tuple[Floats, Floats]:
        """Yaw rates, rad/s, shape (K,), and rolling speeds of the wheels, m/s, shape (K, n).

        Args:
            steering: β of each wheel, in each of K cases, shape (K, n).
            speed: At which each wheel is told to roll, m/s, shape (n,).
            acceleration: Commanded, in the robot frame, shape (3,).
        """
        n, stiffness = self._n, self._stiffness
        rows = self._drive.rows(steering)
        across = np.swapaxes(rows, 1, 2)
        told = np.concatenate([np.zeros(n), speed])
        creep = CREEP_M_S**2 + (CREEP_SHARE * float(np.abs(speed).max())) ** 2
        inertia = self._inertia * acceleration
        normal = across @ rows
        right = across @ told
        rolled = np.broadcast_to(speed, steering.shape)
        weights = np.empty((len(steering), 2 * n))
        for _ in range(ITERATIONS):
            normal[:, [0, 1, 2], [0, 1, 2]] += 1e-6
            twist = np.linalg.solve(normal, right[:, :, None])
            over = (rows @ twist)[:, :, 0]
            slid, pushed = over[:, :n], rolled - over[:, n:]
            weight = self._grip / np.sqrt(slid * slid + pushed * pushed + creep)
            pull = weight * stiffness / (weight + stiffness)
            rolled = speed - pull * (speed - over[:, n:]) / stiffness
            weights[:, :n], weights[:, n:] = weight, pull
            weighted = across * weights[:, None, :]
            normal = weighted @ rows
            right = weighted @ told - inertia
        twist = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        over = (rows[:, n:] @ twist[:, :, None])[:, :, 0]
        return twist[:, 2], speed - weights[:, n:] * (speed - over) / stiffness
