"""Steering whose zero is wrong: the one fault that no reading shows.

A wheel that points elsewhere than it says fights all others. They slip a little, their drives give
way, and the robot turns otherwise than its wheels say, in a way that depends on the motion. So the
motion is predicted (:mod:`wackel_diagnoser.forced`) for a right zero and for errors of several
sizes of each wheel, and compared with what the gyro and the rolling wheels show. Evidence gathers
over many headings; an error is named once it explains them far better than calibration does, and
better than that of any other wheel.
"""

import math
from dataclasses import dataclass

import numpy as np

from wackel_diagnoser.forced import ForcedMotion
from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import Measured, Rows
from wackel_diagnoser.scaling import Scaling
from wackel_diagnoser.sequential import threshold
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout

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
YAW = 0.006
YAW_SHARE = 0.01
"""rad/s, and share of speed by length, by which predicted yaw rates miss a sound robot's."""
ROLL_M_S = 0.003
ROLL_SHARE = 0.005
"""The same of rolling speeds."""
WORST = 20.0
"""How much larger the variance of that may be, as driving shows: more is no calibration."""
BOUND = 9.0
"""Of the square of a normalised miss."""
MOST_TOLD = 1.5
"""Evidence of one block at most: a second of driving, in several directions, is the least that
convicts."""
INDEPENDENT = 0.3
"""Share of a block that is new: robots do the same for some tenths of a second."""
CLEAR = 5.0
"""Logarithm of how much likelier it is than an error of any other wheel."""
SUSPECTED = 3.0
"""The same against none at all, from which on nothing is learnt."""
MEMORY_S = 20.0
"""Of driving: calibration that fits an error a little shall not convict in an hour."""
MARGIN = 1.4
"""Of the limit: on stiff tyres, which do not creep, calibration pulls as hard as a wrong zero."""
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
        found: The zero that is known to be wrong.
        suspected: Whether one explains the motion better than none does.
    """

    def __init__(self, layout: Layout, rows: Rows) -> None:
        drive = layout.drive
        n = drive.n
        self._rows = rows
        self._possible = len(drive.slide_wheels) == len(drive.roll_wheels) == n and bool(
            drive.steers.all()
        )
        self._to_beta = math.pi / 2 - drive.alpha
        self._length_m = drive.length_m
        self._motion = ForcedMotion(drive)
        cases = np.zeros((1 + n * len(SIZES), n))
        for wheel in range(n):
            first = 1 + wheel * len(SIZES)
            cases[first : first + len(SIZES), wheel] = SIZES
        self._cases = cases
        self._scaling = Scaling(1 + n, first=3.0, least=1.0)
        self._evidence = np.zeros((n, len(SIZES)))
        self._limit = MARGIN * threshold(n * len(SIZES), 1 / BLOCK_S)
        self._steps: list[tuple[Step, Target, Measured]] = []
        self._seconds = 0.0
        self.found: WrongZero | None = None

    @property
    def suspected(self) -> bool:
        """See above."""
        return bool(self._evidence.max() > SUSPECTED)

    def step(self, step: Step, target: Target, measured: Measured) -> bool:
        """Takes in a step; says whether what is known to be wrong has changed."""
        if not self._possible:
            return False
        self._steps.append((step, target, measured))
        self._seconds += step.seconds
        if self._seconds < BLOCK_S or len(self._steps) < LEAST_STEPS:
            return False
        block, seconds = self._steps, self._seconds
        self._steps, self._seconds = [], 0.0
        if not self._compare(block, seconds):
            return False
        before, self.found = self.found, self._look()
        return (before is None) != (self.found is None) or (
            before is not None and self.found is not None and before.wheel != self.found.wheel
        )

    def _compare(self, block: list[tuple[Step, Target, Measured]], seconds: float) -> bool:
        """Gathers the evidence of a block; says whether there was any."""
        rows = self._rows
        heading = np.array([step.heading for step, _, _ in block])
        aim = np.array([target.heading for _, target, _ in block])
        speed = np.array([target.speed for _, target, _ in block])
        steered = np.array([step.steered for step, _, _ in block])
        z = np.array([measured.z for _, _, measured in block])
        rolled, gyros = z[:, rows.rolls], z[:, rows.gyros]
        if not gyros.size or not all(bool(measured.present.all()) for _, _, measured in block):
            return False
        off = np.abs(rolled - speed) - FOLLOWS_SHARE * np.abs(speed)
        if not (
            off.max() < FOLLOWS_M_S
            and np.abs(heading - aim).max() < FOLLOWS_RAD
            and np.abs(steered).max() < TURNING_RAD_S * seconds / len(block)
        ):
            return False
        twist, now = block[0][1].twist, block[-1][1].twist
        vx, vy, omega = (0.5 * (twist + now)).tolist()
        change = (now - twist) / (seconds * (len(block) - 1) / len(block))
        acceleration = change + np.array([-omega * vy, omega * vx, 0.0])
        steering = heading.mean(axis=0) + self._to_beta + self._cases
        yaw, predicted = self._motion.predict(steering, speed.mean(axis=0), acceleration)
        fast = float(np.abs(speed).max())
        misses = np.column_stack([yaw - gyros.mean(), predicted - rolled.mean(axis=0)])
        base = np.full(misses.shape[1], ROLL_M_S**2 + (ROLL_SHARE * fast) ** 2)
        base[0] = YAW**2 + (YAW_SHARE * fast / self._length_m) ** 2
        squares = misses * misses / base
        if not self.suspected:
            present = np.ones(len(base), dtype=np.bool_)
            self._scaling.learn(squares[0], present, seconds)
        squares /= np.minimum(self._scaling.factors, WORST)
        costs = np.minimum(squares, BOUND).sum(axis=1)
        evidence = self._evidence
        told = 0.5 * INDEPENDENT * (costs[0] - costs[1:])
        evidence *= 1.0 - seconds / MEMORY_S
        evidence += np.minimum(told, MOST_TOLD).reshape(evidence.shape)
        evidence -= max(0.0, float(evidence.max()) - MOST * self._limit)
        np.maximum(evidence, 0.0, out=evidence)
        return True

    def _look(self) -> WrongZero | None:
        """The error that explains most, if it is sure and clear."""
        evidence = self._evidence
        sure = evidence.max(axis=1)
        wheel = int(sure.argmax())
        known = self.found is not None and self.found.wheel == wheel
        share = 0.5 if known else 1.0
        if sure[wheel] < share * self._limit:
            return None
        if sure[wheel] - np.delete(sure, wheel).max() < share * CLEAR:
            return None
        return WrongZero(wheel, float(SIZES[evidence[wheel].argmax()]), float(sure[wheel]))
