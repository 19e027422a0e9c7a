"""Steering whose zero is wrong: the one fault that no reading shows.

A wheel that points elsewhere than it says fights all others. They slip a little, their drives give
way, and the robot turns otherwise than its wheels say, in a way that depends on the motion. So the
motion is predicted (:mod:`wackel_diagnoser.forced`) for a right zero and for errors of several
sizes of each wheel, and compared with what the gyro, the rolling wheels and the power of their
motors show (:mod:`wackel_diagnoser.slip_power`). Evidence gathers over several directions, for
calibration that is wrong deceives for as long as a motion lasts; an error is named once it explains
them far better than calibration does, and better than that of any other wheel, or than a floor on
which all wheels roll hard.
"""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from wackel_diagnoser.forced import (
    INDEPENDENT,
    Block,
    ForcedMotion,
    Motion,
    Observed,
    can_force,
    is_whole,
    observe,
)
from wackel_diagnoser.reference import Target, Twist
from wackel_diagnoser.rows import Measured, Rows
from wackel_diagnoser.scaling import Scaling
from wackel_diagnoser.sequential import threshold
from wackel_diagnoser.slip_power import SlipPower
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats

BLOCK_S = 0.1
"""Motions are compared as means over this: encoder steps and the lag of drives cancel."""
LEAST_STEPS = 2
"""In a block, to know the acceleration."""
SIZES = np.radians((-13.0, -9.0, -5.5, 5.5, 9.0, 13.0))
"""Errors that are compared. Below 3° a right zero explains the motion better than the smallest of
them: that is calibration."""
TURNING_RAD_S = 3.0
"""While wheels turn faster, they slip for other reasons."""
FOLLOWS_SHARE = 0.25
FOLLOWS_M_S = 0.05
FOLLOWS_RAD = 0.1
"""A wheel that does not do what it is told has another fault."""
WORST_YAW, WORST_ROLL = 3.0, 10.0
"""How much larger the variance of misses may be, as driving shows. Calibration three times worse
than configured makes that of yaw rates twice as large, that of rolling speeds on hard tyres ten
times; more is no calibration, but a zero that was wrong from the start."""
MOST_TOLD = 1.5
"""Evidence of one block at most: a second of driving, in several directions, is the least that
convicts."""
CLEAR = 5.0
"""Logarithm of how much likelier it is than an error of any other wheel."""
SHARED = 0.3
"""Share of what another wheel's error explains, too, that does not count: calibration pulls at all
wheels, so errors of two explain it about equally well (by 0.7 to all of it); a wrong zero, that of
another of three wheels by half, of four by 0.7."""
SUSPECTED = 6.0
"""The same against none at all, from which on nothing is learnt, and every block is looked at."""
LOOK_EVERY = 3
"""Blocks, until then: of those in between, little is new (:mod:`wackel_diagnoser.forced`)."""
FIRST_S = 5.0
"""Of driving, in which only is learnt how much the motion misses what is predicted."""
MEMORY_S = 20.0
"""Of driving: calibration that fits an error a little shall not convict in an hour."""
SAME_S = 3.0
"""After which motion in one direction tells nothing new: calibration deceives while it lasts."""
ONE_MOTION = 0.75
"""Of the limit, that motion in one direction may bring: another has to confirm it."""
DIRECTIONS = np.array([each for each in product((-1, 0, 1), repeat=3) if each > (0, 0, 0)])
"""Along, to the left, about, and between: half of them, since back is the same as forth."""
MARGIN = 1.4
"""Of the limit: on stiff tyres, which do not creep, calibration pulls as hard as a wrong zero. The
worst of 110 robots three times worse calibrated than configured brought 0.4, the worst known, whose
wheels stand 2.5° against each other, 1.2; of 110 that are calibrated as configured, none any."""
MOST = 2.0
"""Evidence by what is needed, beyond which no more is gathered, so that it can heal."""


@dataclass(frozen=True)
class WrongZero:
    """A zero that is wrong.

    Attributes:
        wheel: Number.
        angle: rad to the left.
        sure: Logarithm of the likelihood ratio.
    """

    wheel: int
    angle: float
    sure: float


class ReferenceErrors:
    """Looks for them.

    Args:
        layout: The drive.
        rows: How its measurements are numbered.

    Attributes:
        motion: How wheels force each other; ``None`` where they cannot.
        found: The zero that is known to be wrong.
    """

    def __init__(self, layout: Layout, rows: Rows) -> None:
        n = layout.drive.n
        self._rows = rows
        self.motion = ForcedMotion(layout) if can_force(layout.drive) else None
        cases = np.zeros((1 + n * len(SIZES), n))
        for wheel in range(n):
            first = 1 + wheel * len(SIZES)
            cases[first : first + len(SIZES), wheel] = SIZES
        self._cases = cases
        self._power = SlipPower()
        self._before: Motion | None = None
        self._scaling = Scaling(np.full(2 + n, 3.0), least=1.0)
        self._worst = np.array((WORST_YAW, *[WORST_ROLL] * n, math.inf))
        # From each direction, of each wheel's errors, and of a floor that costs as much.
        self._from = np.zeros((len(DIRECTIONS), n + 1, len(SIZES)))
        self._evidence = self._from.sum(axis=0)
        self._sure = [0.0] * (n + 1)  # the most of each row
        self._directions = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]
        self._directions[:, 2] *= layout.drive.length_m
        self._limit = MARGIN * threshold(n * len(SIZES), 1 / BLOCK_S)
        self._steps: list[tuple[Step, Target, Measured, list[float]]] = []
        self._seconds = self._skipped_s = self._driven_s = 0.0
        self._skipped = 0  # blocks in a row that were not looked at
        self.found: WrongZero | None = None

    @property
    def worse(self) -> Floats:
        """How much larger the variances of misses are than expected, shape (2 + n,)."""
        return np.asarray(np.minimum(self._scaling.factors, self._worst))

    def adopt(self, gives_way: float) -> None:
        """By how much drives are slower for what they push, m/s by A, as learnt; 0: not known."""
        if self.motion is not None:
            self.motion.adopt(gives_way * self._power.mass)

    @property
    def suspected(self) -> bool:
        """Whether one explains the motion better than none does, and than the floor."""
        *sure, floor = self._sure
        most = max(sure)
        return most > SUSPECTED and most > floor - CLEAR

    @property
    def suspects(self) -> list[int]:
        """Wheels of which one explains the motion so, the likeliest first."""
        if not self.suspected:
            return []
        likely = [wheel for wheel, sure in enumerate(self._sure[:-1]) if sure > SUSPECTED]
        return sorted(likely, key=self._sure.__getitem__, reverse=True)

    def slip_power(self, seen: Observed) -> float:
        """What slip takes of a block's power, by mass, m²/s³; NaN if unknown."""
        return self._power.left(seen.power, seen.causes, len(seen.rolled))

    def step(self, step: Step, target: Target, measured: Measured, current: list[float]) -> bool:
        """Takes in a step; says whether what is known to be wrong has changed.

        Args:
            step: What the sensors said.
            target: What the wheels should have done.
            measured: The rows of that.
            current: Of the rolling motors, A or share of load; NaN if unknown.
        """
        if self.motion is None:
            return False
        self._steps.append((step, target, measured, current))
        self._seconds += step.seconds
        if self._seconds < BLOCK_S or len(self._steps) < LEAST_STEPS:
            return False
        block, seconds = self._steps, self._seconds
        self._steps, self._seconds = [], 0.0
        if self._skipped < LOOK_EVERY - 1 and self.found is None and not self.suspected:
            self._skipped += 1
            self._skipped_s += seconds
            return False
        stands_for = seconds + self._skipped_s
        self._skipped, self._skipped_s = 0, 0.0
        if not self._compare(block, seconds, stands_for):
            return False
        before, self.found = self.found, self._look()
        return (before is None) != (self.found is None) or (
            before is not None and self.found is not None and before.wheel != self.found.wheel
        )

    def _compare(self, block: Block, seconds: float, stands_for: float) -> bool:
        """Gathers the evidence of a block; says whether there was any.

        Args:
            block: The steps.
            seconds: How long they took.
            stands_for: And with those that were not looked at.
        """
        motion = self.motion
        if motion is None or not is_whole(block, self._rows):
            self._before = None
            return False
        turned = np.concatenate([step.steered for step, _, _, _ in block]).tolist()
        if not max(map(abs, turned)) < TURNING_RAD_S * seconds / len(block):
            return False
        seen = observe(block, self._rows, motion.yields_s)
        off = np.abs(seen.rolled - seen.speed) - FOLLOWS_SHARE * np.abs(seen.speed)
        astray = np.abs(seen.heading - seen.told).max()
        if not (off.max() < FOLLOWS_M_S and astray < FOLLOWS_RAD):
            return False
        self._before = motion.move(seen, seen.heading + self._cases, self._before)
        power, floor = self.slip_power(seen), motion.grip_power(seen, SIZES)
        costs, squares = motion.compare(seen, self._before, power, self.worse, floor)
        if not self.suspected:
            known = np.isfinite(squares)
            self._scaling.learn(np.where(known, squares, 0.0), known, stands_for)
            self._power.learn(seen.power, seen.causes, stands_for)
        self._driven_s += stands_for
        if self._driven_s < FIRST_S:
            return False
        told = costs[0] - costs[1:]
        # A wrong zero leaves a quarter of what it explains; calibration, which is wrong of several
        # wheels, most of it. So what is left counts against it, but no error is refuted by that.
        told = np.where(told > 0.0, np.maximum(told - costs[1:], 0.0), told)
        told *= 0.5 * INDEPENDENT * stands_for / BLOCK_S
        self._gather(told.reshape(self._evidence.shape), block[-1][1].twist, stands_for)
        return True

    def _gather(self, told: Floats, twist: Twist, stands_for: float) -> None:
        """Adds the evidence of a block to that of its direction; what speaks against an error, to
        all."""
        if not math.isfinite(sum(twist)):
            return
        each = self._from
        here = each[int(np.abs(self._directions.dot(twist)).argmax())]
        here *= 1.0 - stands_for / SAME_S
        most = np.minimum(ONE_MOTION * self._limit - here, MOST_TOLD)
        here += np.minimum(np.maximum(told, 0.0), most)
        total = np.add.reduce(each)
        kept = 1.0 - stands_for / MEMORY_S + np.minimum(told, 0.0) / np.maximum(total, 1e-9)
        highest = max(float(total.max()) / (MOST * self._limit), 1.0)
        kept = np.maximum(kept, 0.0) / highest
        each *= kept
        self._evidence = total * kept
        self._sure = [*map(max, self._evidence.tolist())]

    def _look(self) -> WrongZero | None:
        """The error that explains most, if it is sure and clear."""
        *sure, floor = self._sure
        most = max(sure)
        wheel = sure.index(most)
        other = max([*sure[:wheel], *sure[wheel + 1 :], floor])
        known = self.found is not None and self.found.wheel == wheel
        share = 0.5 if known else 1.0
        if most - SHARED * other < share * self._limit or most - other < share * CLEAR:
            return None
        return WrongZero(wheel, float(SIZES[self._evidence[wheel].argmax()]), most)
