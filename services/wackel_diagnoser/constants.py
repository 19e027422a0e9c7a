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

import msgspec
import numpy as np

from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import UNKNOWN, Measured, Rows
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig

SLIP_M_S = 0.002
"""Of a wheel over a block, for no reason that is modelled. A gyro, by length, and a drive
miss as much."""
STANDS_RAD = 0.002
"""The same of a steering against its reference, if its encoder has no larger steps."""
LONGER = 4.0
"""By what the variance of what a manoeuvre forces is larger here: it lasts longer than a block."""
LATE = 0.1
"""By what it is smaller for gyros and drives: that tyres creep by what turns the robot, and that
drives follow otherwise than expected, is a lag here."""
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


class Shown(msgspec.Struct, frozen=True, gc=False):
    """A step of a block.

    Attributes:
        step, target, measured: What it says.
        bias: Of the gyros, as taken off there, rad/s.
        current: Of each rolling motor, A or share of load; NaN where unknown.
        drive_lag_s: With which the references of drives follow their commands.
    """

    step: Step
    target: Target
    measured: Measured
    bias: Floats
    current: Sequence[float]
    drive_lag_s: float


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
        late: By how much they are later than their commands, s, which pushing would explain, too.
            Before driving it is the lag with which references follow them.
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
        kinds = (  # of rows on the twist, of drives, and of steerings
            slice(self.askew.stop),
            slice(self.off.start, self.stands.start),
            slice(self.stands.start, self.count),
        )
        self.kinds = [kind for kind in kinds if len(range(self.count)[kind])]
        # Of wheels that cannot turn against each other, scales and directions say all; but not
        # where rollers leave no row that a direction would show in.
        fights = UNKNOWN if drive.steers.any() or not slides else SOUND
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
        self._slide_wheels = slides
        # Where what is of single numbers stands among those of a block.
        ends = np.cumsum([0, 1, 1, len(slides), len(rolls), len(rolls), len(rolls)])
        self._columns = [slice(a, b) for a, b in pairwise(ends.tolist())]
        # What rolls under each slide row; what does not roll by itself tells nothing of direction.
        self._under: Floats = np.equal.outer(rolls, slides).astype(np.float64)
        self._noise = np.full(rows.count, SLIP_M_S**2)
        self._noise[rows.gyros] = (SLIP_M_S / drive.length_m) ** 2
        self._noise[rows.steering] = max(STANDS_RAD, config.encoder_step) ** 2
        self._longer = np.full(rows.count, LONGER)
        self._longer[rows.gyros] *= LATE
        self._longer[rows.rolling] *= LATE
        self._askew = slice(self.askew.start, self.askew.stop)
        # Each row has a parameter of its own; gyros and steerings show theirs as it is.
        self._causes = np.zeros((rows.count, self.count + 1))
        self._causes[rows.gyros, self.gyro] = np.eye(len(self.gyro))
        self._causes[rows.steering, self.stands] = np.eye(len(self.stands))
        # Where the rows by a wheel's speed have theirs, among all causes one after the other.
        self._own_direction = self._own(rows.slides, self.direction)
        self._own_scale = self._own(rows.rolls, self.scale)
        self._own_off = self._own(rows.rolling, self.off)

    def equations(self, blocks: Sequence[Sequence[Shown]]) -> Floats:
        """Of blocks of several steps each.

        Returns:
            Sums of the information and, in the last column, of the right side, shape (P, P + 1).
        """
        rows, lengths = self._rows, [*map(len, blocks)]
        starts, counts = [0, *accumulate(lengths[:-1])], np.array(lengths)[:, None]

        def mean(values: Sequence[Floats]) -> Floats:
            """By block, of a value of each step."""
            joined = np.concatenate(values).reshape(len(values), -1)
            return np.asarray(np.add.reduceat(joined, starts) / counts)

        measured = [shown.measured for block in blocks for shown in block]
        z = mean([each.z for each in measured])
        h = mean([each.h for each in measured]).reshape(*z.shape, 3)
        causes, bent = self._caused(blocks, z)

        # The middle of a block knows nothing of a command that changes in its second half.
        middle = [block[len(block) // 2].measured.spread().loose for block in blocks]
        last = [block[-1].measured.spread().loose for block in blocks]
        loose = np.maximum(middle, last)
        variance = self._noise + self._longer * loose
        on_twist = variance[:, : rows.gyros.stop]
        on_twist += bent[:, None]
        weight = np.reciprocal(variance)
        if not all(each.present is rows.every for each in measured):  # as mostly
            weight *= np.logical_and.reduceat([each.present for each in measured], starts)
        weight = weight[:, :, None]
        # Of references nothing is eliminated: their h is 0.
        weighted = h * weight
        across = weighted.swapaxes(1, 2)
        estimate = np.linalg.inv(across @ h + REGULAR) @ across
        causes[:, rows.gyros, self._askew] = (estimate @ z[:, :, None]).swapaxes(1, 2)
        by_cause = causes * weight
        by_cause -= weighted @ (estimate @ causes)
        width = self.count + 1
        return np.asarray(causes.reshape(-1, width)[:, :-1].T @ by_cause.reshape(-1, width))

    def _caused(self, blocks: Sequence[Sequence[Shown]], z: Floats) -> tuple[Floats, Floats]:
        """What rows show, and what parameters cause of it.

        Args:
            blocks: B of them, as above.
            z: Their means, shape (B, M).

        Returns:
            By how much each parameter (but ``askew``) changes each row, and in the last column
            what the row shows, shape (B, M, P + 1); and the variance that turning wheels add to
            rows on the twist, shape (B,).
        """
        rows, numbers = self._rows, np.array([self._numbers(block) for block in blocks])
        seconds, drive_lag_s, turned, faster, current, yielded = (
            numbers[:, each] for each in self._columns
        )
        causes = np.empty((len(blocks), *self._causes.shape))
        causes[:] = self._causes
        by_row, seen, rolled = causes.reshape(len(blocks), -1), causes[:, :, -1], z[:, rows.rolls]
        own = rolled.dot(self._under)
        lag = own * turned / seconds
        seen[:] = z
        sliding, turning, off = seen[:, rows.slides], seen[:, rows.gyros], seen[:, rows.rolling]
        sliding += rows.lag_s * lag
        turning += [block[len(block) // 2].bias for block in blocks]
        off += yielded - drive_lag_s * faster
        by_row[:, self._own_direction] = -own
        by_row[:, self._own_scale] = rolled
        by_row[:, self._own_off] = rolled - off
        causes[:, rows.slides, self.steering_lag] = lag
        causes[:, rows.rolls, self.rolling_lag] = faster
        causes[:, rows.rolling, self.gives_way] = -current
        causes[:, rows.rolling, self.late] = -faster
        # What turns far meanwhile is not on average what its mean direction makes it.
        bent = own * turned * turned / 12.0
        return causes, np.asarray(np.vecdot(bent, bent))

    def _numbers(self, block: Sequence[Shown]) -> list[float]:
        """Of a block, from the end of its first step to that of its last: how long it takes, s; the
        lag of references, s; by how much each slide row's wheel turns, rad, and each rolling one
        becomes faster, m/s²; and means of currents and of what was yielded. 0 in place of what is
        missing.

        Single numbers: for some wheels, Python is faster with them than numpy.
        """
        first, last = block[0], block[-1]
        seconds = (last.step.end - first.step.end) / 1e9
        before, after = first.step.heading, last.step.heading
        numbers = (
            seconds,
            last.drive_lag_s,
            *[after[i] - before[i] for i in self._slide_wheels],
            *[each / seconds for each in map(sub, last.target.speed, first.target.speed)],
            *_mean([shown.current for shown in block]),
            *_mean([shown.measured.yielded for shown in block]),
        )
        return [each if math.isfinite(each) else 0.0 for each in numbers]

    def _own(self, rows: slice, parameters: range) -> slice:
        """Where each of some rows has a parameter of its own, among all rows' causes."""
        width = self.count + 1
        first = rows.start * width + parameters.start
        return slice(first, first + len(parameters) * (width + 1), width + 1)


def _mean(steps: Sequence[Sequence[float]]) -> list[float]:
    """Of each column."""
    return [sum(each) / len(steps) for each in zip(*steps, strict=True)]
