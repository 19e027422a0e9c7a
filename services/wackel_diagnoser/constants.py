"""What is constant in a sound robot, as normal equations.

What each wheel shows too much, how far it stands off its direction, each gyro's bias, and how far
each servo stays off its reference; and what they would be mistaken for: lags of steering and
rolling, how wheels that fight turn the robot, and how drives give way to their load. The twist is
eliminated, so that wheels and gyros are compared with each other only.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

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

    def equations(self, block: Sequence[Shown]) -> tuple[Floats, Floats]:
        """Information, shape (P, P), and right side, shape (P,), of a block of several steps."""
        rows, n = self._rows, len(block)
        first, last, (_, _, measured, bias, _) = block[0], block[-1], block[n // 2]
        z = np.add.reduce([shown.measured.z for shown in block]) / n
        present = measured.present
        whole = all(shown.measured.present is rows.every for shown in block)  # as mostly
        if not whole:
            present = np.logical_and.reduce([shown.measured.present for shown in block])
        loose = self._longer * measured.loose
        information, right = np.zeros((self.count, self.count)), np.zeros(self.count)

        # Wheels and gyros: each row has a parameter of its own, and shares the lags.
        end, moving, slides, rolls = rows.gyros.stop, self._moving, rows.slides, rows.rolls
        rolled = z[rolls]
        own = rolled[self._rolls] * self._rolls_itself if len(rolled) else self._rolls_itself
        causes = np.zeros((end, moving))
        causes.flat[:: moving + 1] = np.concatenate((-own, rolled, np.ones(len(bias))))
        seconds = (last.step.end - first.step.end) / 1e9
        turned = last.step.heading - first.step.heading
        turned = np.where(self._steers, turned.take(self._slide_wheels), 0.0)
        faster = np.subtract(last.target.speed, first.target.speed) / seconds
        if not whole:
            turned, faster = np.nan_to_num(turned), np.nan_to_num(faster)
        causes[slides, self.steering_lag] = lag = own * turned / seconds
        causes[rolls, self.rolling_lag] = faster
        seen = z[:end].copy()
        seen[slides] += rows.lag_s * lag
        seen[rows.gyros] += bias
        h = np.add.reduce([shown.measured.h for shown in block])[:end] / n
        # What turns far meanwhile is not on average what its mean direction makes it.
        bent = own * turned * turned / 12.0
        weight = present[:end] / (self._noise + loose[:end] + float(bent.dot(bent)))
        weighted = h * weight[:, None]
        estimate = np.linalg.inv(weighted.T @ h + REGULAR) @ weighted.T
        causes[rows.gyros, self.askew] = estimate @ z[:end]
        projection = -weighted @ estimate
        projection.flat[:: end + 1] += weight
        by_cause = projection @ causes
        information[:moving, :moving] = causes.T @ by_cause
        right[:moving] = seen @ by_cause

        self._against_references(block, (z, present, loose), faster, (information, right))
        return information, right

    def _against_references(
        self,
        block: Sequence[Shown],
        seen: tuple[Floats, Bools, Floats],
        faster: Floats,
        equations: tuple[Floats, Floats],
    ) -> None:
        """Drives and steerings, each by itself.

        Args:
            block: As above.
            seen: All rows, which of them are there, and variances of what the manoeuvre adds.
            faster: Acceleration of each drive's reference, m/s².
            equations: What they are added to.
        """
        rows, n = self._rows, len(block)
        (z, present, loose), (information, right) = seen, equations
        yielded = np.add.reduce([shown.measured.yielded for shown in block]) / n
        off, giving = z[rows.rolling] + yielded, self._giving
        current = np.add.reduce([shown.current for shown in block]) / n
        if not math.isfinite(sum(current.tolist())):
            current = np.nan_to_num(current)
        causes = np.zeros((len(off), len(off) + 2))
        causes.flat[:: len(off) + 3] = z[rows.rolls] - off
        causes[:, -2], causes[:, -1] = -current, -faster
        weight = present[rows.rolling] / (SLIP_M_S**2 + loose[rows.rolling])
        by_cause = causes * weight[:, None]
        information[giving, giving] = causes.T @ by_cause
        right[giving] = off @ by_cause

        standing = self._standing
        weight = present[rows.steering] / (STANDS_RAD**2 + loose[rows.steering])
        information.flat[standing.start * (self.count + 1) :: self.count + 1] = weight
        right[standing] = weight * z[rows.steering]
