"""What is constant in a sound robot, as normal equations.

What each wheel shows too much, how far it stands off its direction, each gyro's bias, and how far
each servo stays off its reference; and what they would be mistaken for: lags of steering and
rolling, how wheels that fight turn the robot, and how drives give way to their load. The twist is
eliminated, so that wheels and gyros are compared with each other only.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise
from operator import sub
from typing import NamedTuple, TypeAlias

import numpy as np

from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import UNKNOWN, Measured, Rows
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Bools, Floats
from wackel_node.config_drive import DriveConfig, GyroConfig

SLIP_M_S = 0.002
"""Of a wheel over a block, for no reason that is modelled. A gyro, by length, and a drive
miss as much."""
STANDS_RAD = 0.002
"""The same of a steering against its reference: an encoder step."""
LONGER = 4.0
"""By what the variance of what a manoeuvre forces is larger here: it lasts longer than a block."""
LATE = 0.1
"""By what it is smaller for gyros: that tyres creep by what turns the robot is a lag here."""
LAG_S = 0.02
"""Standard deviations of what is not configured, before driving has shown it: lags behind what
encoders show, by which a drive or steering stays off its reference, and by which a drive gives way
(m/s by A, or by share of the greatest load)."""
OFF_SHARE = 0.05
OFF_RAD = 0.05
GIVES_WAY = 0.1
SOUND = 1e-3
"""By what is configured, what there is of a cause where there can be none."""
REGULAR = 1e-6 * np.eye(3)
"""For drives whose rows do not determine the twist."""


class Shown(NamedTuple):
    """A step of a block.

    Attributes:
        step, target, measured: What it says.
        bias: Of the gyros, as taken off there, rad/s.
        current: Of each rolling motor, A or share of load; NaN where unknown.
    """

    step: Step
    target: Target
    measured: Measured
    bias: Floats
    current: Sequence[float]


Block: TypeAlias = Sequence[Shown]


class Constants:
    """Numbers the parameters, and makes their equations.

    Args:
        layout: The drive.
        config: The same, as configured.
        rows: How measurements are numbered.
        gyros: By name.

    Attributes:
        count: P, of parameters.
        direction: By how much each slide row's wheel truly stands more to the left, rad.
        scale: By how much each roll row's wheel shows too much, as a share.
        gyro: What each gyro shows too much, rad/s.
        steering_lag, rolling_lag: s by which wheels follow what their encoders show.
        askew: By how much every gyro shows more than the wheels for each component of the twist,
            rad/m, rad/m and a share. Wheels that stand and roll a little wrong turn the robot, and
            as all slip, their readings agree. In another direction they turn it otherwise.
        off: By how much each drive is faster than its reference, as a share.
        gives_way: By how much drives are slower for what they push, m/s by A.
        late: By how much they are later than their references, s, which pushing would explain too.
        stands: By how much each steering stands left of its reference, rad.
        kinds: Parameters of which the noise is of the same kind.
        prior: One over the variance of each before driving, shape (P,).
    """

    def __init__(
        self, layout: Layout, config: DriveConfig, rows: Rows, gyros: Mapping[str, GyroConfig]
    ) -> None:
        drive, self._rows = layout.drive, rows
        slides, rolls = drive.slide_wheels.tolist(), drive.roll_wheels.tolist()
        steered = [i for i in slides if drive.steers[i]]
        counts = (len(slides), len(rolls), len(gyros), 1, 1, 3, len(rolls), 1, 1, len(steered))
        places = [range(a, b) for a, b in pairwise(np.cumsum([0, *counts]).tolist())]
        self.direction, self.scale, self.gyro, *places = places
        (self.steering_lag,), (self.rolling_lag,), self.askew, *places = places
        self.off, (self.gives_way,), (self.late,), self.stands = places
        self.count = self.stands.stop
        self._moving = self.askew.stop  # parameters of rows on the twist
        self._giving = slice(self.off.start, self.stands.start)
        self._standing = slice(self.stands.start, self.count)
        kinds = (slice(self._moving), self._giving, self._standing)
        self.kinds = [kind for kind in kinds if len(range(self.count)[kind])]
        # Of wheels that cannot turn against each other, scales and directions say all.
        fights = UNKNOWN if drive.steers.any() else SOUND
        # Least squares of all rows, half of whose levers are across any direction.
        both = math.hypot(config.steering_error, config.radius_error) / math.sqrt(2)
        scale = max((gyro.scale_error for gyro in gyros.values()), default=0.0)
        turning = math.hypot(config.radius_error / math.sqrt(drive.n), scale)
        askew = both / (math.sqrt(drive.n) * drive.length_m)
        sigma = np.concatenate(
            (
                np.full(len(slides), UNKNOWN * config.steering_error),
                np.full(len(rolls), UNKNOWN * config.radius_error),
                [gyro.bias_limit for gyro in gyros.values()],
                (LAG_S, LAG_S),
                fights * np.array((askew, askew, turning)),
                np.full(len(rolls), OFF_SHARE),
                (GIVES_WAY, LAG_S),
                np.full(len(steered), OFF_RAD),
            )
        )
        self.prior: Floats = sigma**-2
        self._slide_wheels = drive.slide_wheels
        self._steers = drive.steers[slides]
        # What rolls under each slide row; what does not roll by itself tells nothing of direction.
        self._rolls = np.array([rolls.index(i) if i in rolls else 0 for i in slides], dtype=np.intp)
        self._rolls_itself = np.array([float(i in rolls) for i in slides])
        self._noise = np.full(rows.gyros.stop, SLIP_M_S**2)
        self._noise[rows.gyros] = (SLIP_M_S / drive.length_m) ** 2
        self._longer = np.full(rows.count, LONGER)
        self._longer[rows.gyros] *= LATE

    def equations(self, blocks: Sequence[Block]) -> tuple[Floats, Floats]:
        """Information, shape (P, P), and right side, shape (P,), of B blocks of several steps."""
        rows, seen = self._rows, _seen(blocks, self._rows)
        loose = self._longer * np.array([block[len(block) // 2].measured.loose for block in blocks])
        information, right = np.zeros((self.count, self.count)), np.zeros(self.count)

        # Wheels and gyros: each row has a parameter of its own, and shares the lags.
        end, moving, slides, rolls = rows.gyros.stop, self._moving, rows.slides, rows.rolls
        z, count = seen.z[:, :end], len(blocks)
        rolled = z[:, rolls]
        under = rolled.take(self._rolls, axis=1) if rolled.size else np.ones((count, 1))
        own = self._rolls_itself * under
        bias = np.array([block[len(block) // 2].bias for block in blocks])
        causes = np.zeros((count, end, moving))
        own_causes = np.concatenate((-own, rolled, np.ones(bias.shape)), axis=1)
        causes.reshape(count, -1)[:, :: moving + 1] = own_causes
        turned = np.where(self._steers, seen.turned.take(self._slide_wheels, axis=1), 0.0)
        causes[:, slides, self.steering_lag] = lag = own * turned / seen.seconds
        causes[:, rolls, self.rolling_lag] = seen.faster
        shown = z.copy()
        shown[:, slides] += rows.lag_s * lag
        shown[:, rows.gyros] += bias
        h = seen.h[:, :end]
        # What turns far meanwhile is not on average what its mean direction makes it.
        bent = own * turned * turned / 12.0
        noise = self._noise + loose[:, :end] + np.vecdot(bent, bent)[:, None]
        weight = seen.present[:, :end] / noise
        weighted = h * weight[..., None]
        across = weighted.swapaxes(1, 2)
        estimate = np.linalg.inv(across @ h + REGULAR) @ across
        causes[:, rows.gyros, self.askew] = (estimate @ z[..., None])[:, None, :, 0]
        projection = -weighted @ estimate
        projection.reshape(count, -1)[:, :: end + 1] += weight
        by_cause = (projection @ causes).reshape(-1, moving)
        information[:moving, :moving] = causes.reshape(-1, moving).T @ by_cause
        right[:moving] = shown.ravel() @ by_cause

        self._against_references(seen, loose, (information, right))
        return information, right

    def _against_references(
        self, seen: "_Seen", loose: Floats, equations: tuple[Floats, Floats]
    ) -> None:
        """Drives and steerings, each by itself.

        Args:
            seen: What blocks say.
            loose: Variances of what the manoeuvre adds, shape (B, M).
            equations: What they are added to.
        """
        rows, (information, right), giving = self._rows, equations, self._giving
        off = seen.z[:, rows.rolling] + seen.yielded
        count, rolls = off.shape
        causes = np.zeros((count, rolls, rolls + 2))
        causes.reshape(count, -1)[:, :: rolls + 3] = seen.z[:, rows.rolls] - off
        causes[..., -2], causes[..., -1] = -seen.current, -seen.faster
        weight = seen.present[:, rows.rolling] / (SLIP_M_S**2 + loose[:, rows.rolling])
        by_cause = (causes * weight[..., None]).reshape(-1, rolls + 2)
        information[giving, giving] = causes.reshape(-1, rolls + 2).T @ by_cause
        right[giving] = off.ravel() @ by_cause

        standing = self._standing
        weight = seen.present[:, rows.steering] / (STANDS_RAD**2 + loose[:, rows.steering])
        told = np.add.reduce(weight)
        information.flat[standing.start * (self.count + 1) :: self.count + 1] = told
        right[standing] = np.add.reduce(weight * seen.z[:, rows.steering])


class _Seen(NamedTuple):
    """What B blocks say.

    Attributes:
        z, h: Means of the rows, shapes (B, M) and (B, M, 3).
        present: Which rows all steps of a block have, shape (B, M).
        yielded: Mean by which each drive gave way, m/s, shape (B, R).
        current: Mean of each rolling motor, A or share of load; 0 if unknown, shape (B, R).
        seconds: From the first step's end to the last one's, shape (B, 1).
        turned: By how much each wheel was steered meanwhile, rad, shape (B, n).
        faster: Acceleration of each drive's reference, m/s², shape (B, R).
    """

    z: Floats
    h: Floats
    present: Bools
    yielded: Floats
    current: Floats
    seconds: Floats
    turned: Floats
    faster: Floats


def _seen(blocks: Sequence[Block], rows: Rows) -> _Seen:
    """Means over each block, and changes from its begin to its end."""
    lengths = [len(block) for block in blocks]
    starts = [end - length for end, length in zip(accumulate(lengths), lengths, strict=True)]
    number = np.array(lengths)[:, None]
    each = [shown for block in blocks for shown in block]
    measured = [shown.measured for shown in each]

    def mean(values: Sequence[Floats] | Sequence[Sequence[float]]) -> Floats:
        return np.asarray(np.add.reduceat(np.array(values), starts) / number)

    pairs = [(block[0], block[-1]) for block in blocks]
    seconds = np.array([[last.step.end - first.step.end] for first, last in pairs]) / 1e9
    turned = np.array([last.step.heading - first.step.heading for first, last in pairs])
    faster = np.array([[*map(sub, b.target.speed, a.target.speed)] for a, b in pairs]) / seconds
    present = np.ones((len(blocks), rows.count), dtype=np.bool_)
    if not all(one.present is rows.every for one in measured):
        present = np.logical_and.reduceat([one.present for one in measured], starts)
        turned, faster = np.nan_to_num(turned), np.nan_to_num(faster)
    current = mean([shown.current for shown in each])
    if not math.isfinite(float(current.sum())):
        current = np.nan_to_num(current)
    h = mean([one.h.ravel() for one in measured]).reshape(len(blocks), rows.count, 3)
    return _Seen(
        mean([one.z for one in measured]),
        h,
        present,
        mean([one.yielded for one in measured]),
        current,
        seconds,
        turned,
        faster,
    )
