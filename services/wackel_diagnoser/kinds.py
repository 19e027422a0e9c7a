"""Sensor or actuator: Step IV as numbers, and what the motors need.

Without the suspected rows the others say how the robot would move if only a sensor were wrong; with
them, how it moves if the part really does what it shows. The gyro shows some share of the
difference: none for a sensor, some for an actuator. And an actuator that fights the floor costs
current: its own, or that of the others. A steering forces the whole robot aside if it really stands
where it says; so its motion is compared with both predictions (:mod:`wackel_diagnoser.forced`).
"""

import math

import numpy as np

from wackel_diagnoser.forced import INDEPENDENT, Block, ForcedMotion, Motion, is_whole, observe
from wackel_diagnoser.hypotheses import Class
from wackel_diagnoser.references import ReferenceErrors
from wackel_diagnoser.rows import Measured, Rows
from wackel_kinematics.array import Bools, Floats

SHARE = 0.25
"""Share of the expected yaw change that an actuator shows, and its spread: blocked wheels 0.02 to
0.3, steerings that stand off 0.1 to 1."""
SENSOR_SPREAD = 0.05
"""The same of sensors, which show 0.00."""
NEW = 0.1
"""Share of the steps that tell something new."""
STRAINED = 2.5
"""Effort of a drive's own motor, by what is usual, from which on it fights something: sensor faults
show 0.2 to 2.0, wheels that are blocked or turn too fast 3.4 to 17."""
STEERING_STRAINED = 1.35
"""Of a steering's own motor: sensor faults show 0.2 to 1.3, blocked ones 1.4 to 1.7."""
OTHERS_STRAINED = 1.3
"""Of the rolling motors of the other wheels when a steering stands off: they drag its wheel."""
CHANGE = 1.0
"""Evidence for the other kind from which on what was said is taken back."""
WEIGHT = 4.0
"""Evidence of an effort that is e times the limit."""
CLEAR = 8.0
"""Evidence that a steering needs that is hardly off: calibration of 0.2° in each wheel shows half a
degree in one with up to 5, as often as not of the wrong kind. Efforts never tell it."""
NOTHING = np.zeros(0)
TOLD, TOLD_SHARE = 0.05, 0.1
"""rad/s, and share, by which a sound robot turns otherwise than commanded: lags and slip. That
counts where no other wheels say how it turns."""
WINDOW_S = 3.0
"""How long after the onset a kind is still reconsidered."""


class KindTest:
    """Gathers evidence on one component since it was suspected.

    Args:
        own_rows: Rows that the component spoils, without the gyro's, shape (M,).
        others_rows: Those that what else is faulty spoils.
        gyros: Where the gyros stand among the rows.
        own: Which of the efforts is its own motor's.
        rolling: How many of the efforts are rolling motors'; they come first.

    Attributes:
        steering: Whether it is a steering.
        seconds: For how long evidence has been gathered.
        clear: Whether it also tells the kind of a steering that is hardly off.
    """

    def __init__(
        self, own_rows: Bools, others_rows: Bools, gyros: slice, own: int, rolling: int
    ) -> None:
        self._own_rows = own_rows
        self._unusable = others_rows.copy()
        self._unusable[gyros] = True
        self._gyros = gyros
        self._own = own
        self.steering = own >= rolling
        self._others = np.arange(rolling) != own
        self.seconds = 0.0
        self.clear = False
        self._xx = self._xe = 0.0
        self._efforts = np.zeros(2)
        self._effort_s = 0.0
        self._forced = 0.0
        self._is_forced = False
        self._before: Motion | None = None
        self._kind: Class = ""

    def step(self, measured: Measured, efforts: Floats, seconds: float) -> None:
        """Takes in a step; ``efforts``: squares by what is usual, NaN where unknown."""
        self.seconds += seconds
        variance = measured.spread().variance
        weight = np.where(measured.present, 1.0 / variance, 0.0)
        weight[self._unusable] = 0.0
        yaw_all = _yaw(measured, weight)
        weight[self._own_rows] = 0.0
        yaw = _yaw(measured, weight) or _told_yaw(measured)
        heard = measured.present[self._gyros]
        if yaw_all is not None and yaw is not None and heard.any():
            expected = yaw_all[0] - yaw[0]
            shown = float(measured.z[self._gyros][heard].mean()) - yaw[0]
            noise = float(variance[self._gyros][heard].mean()) + yaw[1]
            self._xx += expected * expected / noise
            self._xe += expected * shown / noise
        others = efforts[: len(self._others)][self._others].tolist()
        both = np.array([efforts[self._own], sum(others) / len(others) if others else math.nan])
        if math.isfinite(float(both.sum())):
            self._efforts += seconds * both
            self._effort_s += seconds

    @property
    def share(self) -> tuple[float, float]:
        """Of the expected yaw change that the gyro shows, and the standard deviation of that."""
        information = max(NEW * self._xx, 1e-9)
        return self._xe / max(self._xx, 1e-9), 1.0 / math.sqrt(information)

    @property
    def strains(self) -> tuple[float, float]:
        """Efforts by what is usual: its own motor's, and the other wheels'; NaN if unknown."""
        if not self._effort_s:
            return math.nan, math.nan
        own, others = np.sqrt(self._efforts / self._effort_s).tolist()
        return own, others

    def force(
        self, block: Block, rows: Rows, motion: ForcedMotion, references: ReferenceErrors
    ) -> None:
        """Takes in a block of steps of a steering: does it stand where it says, or where it is
        told?

        Args:
            block: The steps.
            rows: How measurements are numbered.
            motion: How wheels force each other.
            references: How well that is known of this robot, and what driving costs it.
        """
        if not is_whole(block, rows):
            return
        seen, wheel = observe(block, rows, motion.yields_s), self._own - len(self._others)
        if not math.isfinite(float(seen.told[wheel])):
            return
        headings = np.array([seen.heading, seen.heading])
        headings[0, wheel] = seen.told[wheel]
        self._before = motion.move(seen, headings, self._before)
        power = references.slip_power(seen)
        worse = references.worse
        costs, _ = motion.compare(seen, self._before, power, worse, NOTHING, far=True)
        self._forced += 0.5 * INDEPENDENT * float(costs[0] - costs[1])
        self._is_forced = True

    def kind(self) -> Class:
        """What it is, as far as the evidence goes; a sensor where nothing says otherwise."""
        share, sigma = self.share
        as_sensor = math.hypot(sigma, SENSOR_SPREAD)
        as_actuator = math.hypot(sigma, SHARE)
        evidence = 0.5 * (share / as_sensor) ** 2 - 0.5 * ((share - SHARE) / as_actuator) ** 2
        evidence += math.log(as_sensor / as_actuator)
        own, others = self.strains
        if self._is_forced:
            evidence = self._forced
        elif self.steering:
            evidence += _strain(own, STEERING_STRAINED) + _strain(others, OTHERS_STRAINED)
        else:
            evidence += _strain(own, STRAINED)
        self.clear = self._is_forced and abs(evidence) > CLEAR
        if not self._kind or abs(evidence) > CHANGE:
            self._kind = "actuator" if evidence > 0 else "sensor"
        return self._kind


def _strain(effort: float, limit: float) -> float:
    """Evidence of an effort; none where it is not known."""
    return WEIGHT * math.log(max(effort, 0.1) / limit) if math.isfinite(effort) else 0.0


def _told_yaw(measured: Measured) -> tuple[float, float] | None:
    """Yaw rate that was commanded, and the variance with which the robot follows."""
    omega = measured.followed[2]
    return (omega, (TOLD + TOLD_SHARE * abs(omega)) ** 2) if math.isfinite(omega) else None


def _yaw(measured: Measured, weight: Floats) -> tuple[float, float] | None:
    """Yaw rate that rows say, and its variance; ``None`` if they do not determine it."""
    weighted = measured.h * weight[:, None]
    normal = weighted.T @ measured.h
    normal.flat[::4] += 1e-4
    covariance = np.linalg.inv(normal)
    if not covariance[2, 2] < 1.0:
        return None
    return float(covariance[2] @ (weighted.T @ measured.z)), float(covariance[2, 2])
