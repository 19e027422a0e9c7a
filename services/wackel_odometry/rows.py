"""What wheels and gyros measure of the twist in one step, and how well.

Each wheel gives a slide row and a roll row (:mod:`wackel_kinematics.drive`), each gyro one row.
An error has three parts. The white one is new in every step. The systematic one, from radii and
directions that are not quite as configured, stays for as long as the robot moves in the same way.
And wheels slip (:mod:`wackel_odometry.slip`), for as long as a change of motion takes. The filter,
which takes all errors for white, must count what stays as one sample in that time.
"""

import math
from collections.abc import Collection, Mapping
from struct import Struct
from typing import NamedTuple

import numpy as np

from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Bools, Floats
from wackel_kinematics.planar import velocity_at
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.filter import FIRST_BIAS, OMEGA, TWIST
from wackel_odometry.slip import LASTS_S, Slip
from wackel_schemas import component

SAME_MOTION_S = 3.0
"""For how long a robot moves in the same way: time in which systematic errors count once. With it,
the pose on random paths is as far off as its covariance says."""
CREEP = 0.002
"""m/s by which a wheel may creep sideways, whatever its speed."""
TURNING_LAG_S = 0.001
"""Time between the readings of drive and steering within one answer to a sync read."""
SLIPPING = 0.05
"""Share of speed by which wheels slip that must follow a faulty actuator: on the paper's circle,
the others fall to 0.91 and 0.93 when one is blocked."""


class Measurements(NamedTuple):
    """All rows of a step; those without a value are NaN. Slide rows, roll rows, gyros.

    Attributes:
        z: Values, m/s and rad/s, shape (m,).
        h: Rows on the state, shape (m, 6 + g).
        white: Variance of the white errors, shape (m,).
        at_once: Of all errors in this step, but of slip, shape (m,).
        lasting: Of all errors, with which those that stay count once in that time, shape (m,).
        most_pulled: By how much larger errors of wheels may be at most where these pull each other,
            as a factor, at least 1.
        present: Which have a value, shape (m,).
    """

    z: Floats
    h: Floats
    white: Floats
    at_once: Floats
    lasting: Floats
    most_pulled: float
    present: Bools


class Rows:
    """The measurement model of a drive with its gyros.

    Attributes:
        names: Of the rows, as in messages.
        wheels: Number of rows of the wheels; those of the gyros follow.
        every: All rows, shape (m,).
        slide_of, roll_of: Number of each wheel's slide and roll row, -1 for none, shape (n,).
    """

    def __init__(
        self, layout: Layout, config: DriveConfig, gyros: Mapping[str, GyroConfig]
    ) -> None:
        drive = self._drive = layout.drive
        slides, rolls = drive.slide_wheels.tolist(), drive.roll_wheels.tolist()
        self.names = (
            *(f"wheel/{layout.names[i]}/slide" for i in slides),
            *(f"wheel/{layout.names[i]}/roll" for i in rolls),
            *(component.gyro(name) for name in gyros),
        )
        self.wheels = len(slides) + len(rolls)
        self.slide_of = np.full(drive.n, -1)
        self.roll_of = np.full(drive.n, -1)
        self.slide_of[slides] = np.arange(len(slides))
        self.roll_of[rolls] = np.arange(len(rolls)) + len(slides)
        self._by_component = {
            **{component.gyro(name): [self.wheels + i] for i, name in enumerate(gyros)},
            **{
                component.wheel_drive(name): _rows(self.roll_of[i])
                for i, name in enumerate(layout.names)
            },
            **{
                component.wheel_steering(name): _rows(self.slide_of[i], self.roll_of[i])
                for i, name in enumerate(layout.names)
            },
        }
        self._rows_of_wheel = list(zip(self.roll_of.tolist(), self.slide_of.tolist(), strict=True))
        self._gyros = slice(self.wheels, None)
        settings = list(gyros.values())
        density = np.array([each.noise_density for each in settings])
        # The difference of two positions, each off by up to half an encoder step.
        quantum = drive.roll_radius * config.encoder_step / math.sqrt(6)
        # In every step, by 1/dt, by 1/dt², and what they creep; the first time without that.
        white = np.zeros((2, len(self.names), 4))
        white[:, : len(slides), 0] = CREEP**2
        white[:, self._gyros, 1] = density**2
        white[:, len(slides) : self.wheels, 2] = quantum**2
        white[1, : self.wheels, 3] = 1.0
        self._white = white.reshape(-1, 4)
        self._share = np.concatenate(
            [
                np.full(len(slides), config.steering_error),
                np.full(len(rolls), config.radius_error),
                [each.scale_error for each in settings],
            ]
        )
        slipping = self._share.copy()
        np.maximum(slipping[: self.wheels], SLIPPING, out=slipping[: self.wheels])
        self._share, self._slipping_share = self._share**2, slipping**2
        self._no_slides, self._no_rolls = [0.0] * len(slides), [0.0] * len(rolls)
        self._no_gyros = [0.0] * len(gyros)
        self._steered = [i for i in slides if drive.steers[i]]
        # What lags is that of the wheel of a slide row, if it steers.
        self._lagging = [i if drive.steers[i] else None for i in slides]
        self._mounted: list[float] = drive.heading(np.zeros(drive.n)).tolist()
        self._radius_of = list(zip(rolls, drive.roll_radius.tolist(), strict=True))
        # Where the slide row of a wheel finds its rolling speed; -1 where it has none.
        self._roll_of_slide = [rolls.index(i) if i in rolls else -1 for i in slides]
        self._all_roll = min(self._roll_of_slide, default=0) >= 0
        self._slip = Slip(layout)
        count = len(self.names)
        self._pack = Struct(f"{3 * count}d").pack
        self.every: Bools = np.ones(count, dtype=np.bool_)
        self._h = np.zeros((count, FIRST_BIAS + len(gyros)))
        for i in range(len(gyros)):
            self._h[self.wheels + i, [OMEGA, FIRST_BIAS + i]] = 1.0

    def of_component(self, path: str) -> list[int] | None:
        """Rows that a component spoils; ``None`` if there is no such component."""
        return self._by_component.get(path)

    def measure(self, step: Step, twist: Floats, slipping: bool) -> Measurements:
        """The rows of a step.

        Args:
            step: What the sensors said.
            twist: As last estimated, for the speed of wheels that measure none.
            slipping: Whether an actuator is faulty, so that the robot slips.
        """
        drive, dt, count = self._drive, step.seconds, len(self.names)
        # Single numbers: for some wheels, Python is faster with them than numpy.
        rates, told, turned = step.wheel_rate, step.heading, step.steered
        rolled = [radius * rates[i] for i, radius in self._radius_of]
        turning = step.gyro_rate
        heading = self._mounted.copy()
        for i in self._steered:
            heading[i] = told[i]
        # One sum tells whether anything is missing, which is rare.
        whole = math.isfinite(sum(rolled) + sum(turning) + sum(heading))
        h = self._h.copy()
        h[: self.wheels, TWIST] = (
            drive.known_rows(heading)[0] if whole else drive.rows_along(np.array(heading))
        )
        if whole and self._all_roll:
            sliding = [abs(rolled[row]) for row in self._roll_of_slide]
        else:
            sliding = self._sliding(rolled, twist)
        late = TURNING_LAG_S / dt
        lag = [
            0.0 if wheel is None else speed * turned[wheel] * late
            for speed, wheel in zip(sliding, self._lagging, strict=True)
        ]
        # Twice as fast as to make an array of a list.
        values = np.frombuffer(
            self._pack(
                *(*self._no_slides, *rolled, *turning),
                # What errors are shares of, and what comes of lags.
                *(*sliding, *rolled, *turning),
                *(*lag, *self._no_rolls, *self._no_gyros),
            )
        )
        z = values[:count]
        square = values[count:] * values[count:]
        creep = self._slip.creep(twist, dt) * max(LASTS_S / dt, 1.0)
        both = self._white.dot((1.0, 1 / dt, 1 / dt**2, creep))
        white, lasting = both[:count], both[count:]
        white += square[count:]
        lasting += square[count:]
        systematic = square[:count]
        systematic *= self._slipping_share if slipping else self._share
        at_once = white + systematic
        systematic *= max(SAME_MOTION_S / dt, 1.0)
        lasting += systematic
        # By what a row that moves hardly is off at least.
        most_pulled = 1.0 + self._slip.pull(sliding, turned, dt) / CREEP**2
        present = self.every if whole else np.isfinite(z + h[:, TWIST.start])
        return Measurements(z, h, white, at_once, lasting, most_pulled, present)

    def widened(self, measurements: Measurements, pulled: float, seconds: float) -> Floats:
        """The lasting variance with the slip of wheels that pull each other, shape (m,).

        Args:
            measurements: Of a step.
            pulled: By how much larger errors of wheels are than at once, as a factor, at least 1.
            seconds: How long it took.
        """
        if pulled == 1.0:
            return measurements.lasting
        lasting, wheels = measurements.lasting.copy(), slice(self.wheels)
        slip = (pulled - 1.0) * max(LASTS_S / seconds, 1.0)
        lasting[wheels] += slip * measurements.at_once[wheels]
        return lasting

    def _sliding(self, rolled: list[float], twist: Floats) -> list[float]:
        """Speed of the wheel of each slide row; where it measures none, by the last estimate."""
        drive = self._drive
        contact = velocity_at(twist, drive.xy[drive.slide_wheels]).tolist()
        return [
            abs(rolled[row]) if row >= 0 and math.isfinite(rolled[row]) else math.hypot(*velocity)
            for row, velocity in zip(self._roll_of_slide, contact, strict=True)
        ]

    def slip(self, measurements: Measurements, state: Floats) -> list[tuple[float, float]]:
        """(along, across) of each wheel in m/s in a state; NaN where it is not known."""
        off = (measurements.z - measurements.h.dot(state)).tolist()
        return [
            (off[roll] if roll >= 0 else math.nan, -off[slide] if slide >= 0 else math.nan)
            for roll, slide in self._rows_of_wheel
        ]


def _rows(*numbers: int) -> list[int]:
    return [int(number) for number in numbers if number >= 0]


def blocked(rows: Rows, components: Collection[str]) -> Bools:
    """Which rows components spoil, shape (m,)."""
    mask = np.zeros(len(rows.names), dtype=np.bool_)
    for path in components:
        mask[rows.of_component(path) or []] = True
    return mask
