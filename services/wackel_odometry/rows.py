"""What wheels and gyros measure of the twist in one step, and how well.

Each wheel gives a slide row and a roll row (:mod:`wackel_kinematics.drive`), each gyro one row.
An error has three parts. The white one is new in every step. The systematic one, from radii and
directions that are not quite as configured, stays for as long as the robot moves in the same way.
And wheels slip (:mod:`wackel_odometry.slip`), for as long as a change of motion takes. The filter,
which takes all errors for white, must count what stays as one sample in that time.
"""

import math
import struct
from collections.abc import Collection, Mapping
from operator import add

import numpy as np
from msgspec import Struct

from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.planar import velocity_at
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.filter import FIRST_BIAS, OMEGA, TWIST
from wackel_odometry.slip import LASTS_S, Slip
from wackel_schemas import component
from wackel_schemas.drive import WheelSlip

SAME_MOTION_S = 3.0
"""For how long a robot moves in the same way: time in which systematic errors count once. With it,
the pose on random paths is as far off as its covariance says."""
CREEP = 0.002
"""m/s by which a wheel may creep sideways, whatever its speed."""
_CREEP_SQUARE = CREEP**2
TURNING_LAG_S = 0.001
"""Time between the readings of drive and steering within one answer to a sync read."""
SLIPPING = 0.05
"""Share of speed by which wheels slip that must follow a faulty actuator: on the paper's circle,
the others fall to 0.91 and 0.93 when one is blocked."""


class Measurements(Struct, frozen=True, gc=False):
    """All rows of a step; those without a value are NaN. Slide rows, roll rows, gyros.

    Single numbers where they are few: Python is faster with them than numpy.

    Attributes:
        values: m/s and rad/s.
        z: The same, shape (m,).
        h: Rows on the state, shape (m, 6 + g).
        white: Variance of the white errors.
        at_once: Covariance of all errors in this step, but of slip, R, shape (m, m).
        lasting: The same of all errors, with which those that stay count once in that time.
        most_pulled: By how much larger errors of wheels may be at most where these pull each other,
            as a factor, at least 1.
        present: Which have a value.
    """

    values: list[float]
    z: Floats
    h: Floats
    white: list[float]
    at_once: Floats
    lasting: Floats
    most_pulled: float
    present: list[bool]


class Rows:
    """The measurement model of a drive with its gyros.

    Attributes:
        names: Of the rows, as in messages.
        wheels: Number of rows of the wheels; those of the gyros follow.
        every: All rows.
        rolls: Numbers of the roll rows.
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
        self.rolls = range(len(slides), self.wheels)
        slide_of = dict(zip(slides, range(len(slides)), strict=True))
        roll_of = dict(zip(rolls, self.rolls, strict=True))
        # Name, slide row and roll row.
        self._of_wheel = [
            (name, slide_of.get(i), roll_of.get(i)) for i, name in enumerate(layout.names)
        ]
        self._rows_of_wheel = [
            [row for row in both if row is not None] for _, *both in self._of_wheel
        ]
        self._by_component = {
            **{component.gyro(name): [self.wheels + i] for i, name in enumerate(gyros)},
            **{
                component.wheel_drive(name): [] if roll is None else [roll]
                for name, _, roll in self._of_wheel
            },
            **{
                component.wheel_steering(name): rows
                for name, rows in zip(layout.names, self._rows_of_wheel, strict=True)
            },
        }
        settings = list(gyros.values())
        self._density = [each.noise_density**2 for each in settings]
        # The difference of two positions, each off by up to half an encoder step.
        quantum = drive.roll_radius * config.encoder_step / math.sqrt(6)
        self._quantum: list[float] = (quantum * quantum).tolist()
        shares = [
            *[config.steering_error] * len(slides),
            *[config.radius_error] * len(rolls),
            *(each.scale_error for each in settings),
        ]
        self._share = [share**2 for share in shares]
        self._slipping_share = [
            *(max(share, SLIPPING) ** 2 for share in shares[: self.wheels]),
            *self._share[self.wheels :],
        ]
        self._no_slides = [0.0] * len(slides)
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
        # Variances are set apart, so that they are the diagonals of matrices.
        diagonal = f"{8 * count}x".join("d" * count)
        self._pack = struct.Struct(f"={count}d{diagonal}{diagonal}").pack
        self._pack_turns = struct.Struct(f"{2 * drive.n + 1}d").pack
        self.every = [True] * count
        self._may_creep = [1.0] * self.wheels + [0.0] * len(gyros)
        # Each row is so much of the cosine of its wheel's heading, so much of the sine, or itself.
        h = np.zeros((2 * drive.n + 1, count, FIRST_BIAS + len(gyros)))
        rows, wheels = np.arange(self.wheels), drive.row_wheels
        h[wheels, rows, TWIST], h[drive.n + wheels, rows, TWIST] = drive.known_rows(
            [0.0] * drive.n, [math.pi / 2] * drive.n
        )
        for i in range(len(gyros)):
            h[-1, self.wheels + i, [OMEGA, FIRST_BIAS + i]] = 1.0
        self._by_heading, self._shape = h.reshape(len(h), -1), h.shape[1:]

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
        dt, count = step.seconds, len(self.names)
        rates, told, turned = step.wheel_rate, step.heading, step.steered
        rolled = [radius * rates[i] for i, radius in self._radius_of]
        turning = step.gyro_rate
        heading = self._mounted.copy()
        for i in self._steered:
            heading[i] = told[i]
        # One sum tells whether anything is missing, which is rare.
        whole = math.isfinite(sum(rolled) + sum(turning) + sum(heading))
        if whole and self._all_roll:
            sliding = [abs(rolled[row]) for row in self._roll_of_slide]
        else:
            sliding = self._sliding(rolled, twist)
        late, rate = TURNING_LAG_S / dt, 1.0 / dt
        lag = [
            0.0 if wheel is None else speed * turned[wheel] * late
            for speed, wheel in zip(sliding, self._lagging, strict=True)
        ]
        white = [_CREEP_SQUARE + each * each for each in lag]
        per_s2 = rate * rate
        white += [each * per_s2 for each in self._quantum]
        white += [each * rate for each in self._density]
        shares = self._slipping_share if slipping else self._share
        moved = (*sliding, *rolled, *turning)
        systematic = [share * each * each for share, each in zip(shares, moved, strict=True)]
        # Counted once already.
        stays = max(SAME_MOTION_S * rate, 1.0) - 1.0
        creep = self._slip.creep(twist, dt) * max(LASTS_S * rate, 1.0)
        at_once = [*map(add, white, systematic)]
        lasting = [
            each + stays * same + creep * may
            for each, same, may in zip(at_once, systematic, self._may_creep, strict=True)
        ]
        values = [*self._no_slides, *rolled, *turning]
        # Twice as fast as to make arrays of lists.
        packed = np.frombuffer(self._pack(*values, *at_once, *lasting)).reshape(-1, count)
        # By what a row that moves hardly is off at least.
        most_pulled = 1.0 + self._slip.pull(sliding, turned, dt) / _CREEP_SQUARE
        unknown = [] if whole else [i for i, at in enumerate(heading) if not math.isfinite(at)]
        h = self._rows_along(heading, unknown)
        present = self.every
        if not whole:
            present = [
                math.isfinite(value + share)
                for value, share in zip(values, h[:, TWIST.start].tolist(), strict=True)
            ]
        return Measurements(
            values,
            packed[0],
            h,
            white,
            packed[1 : count + 1],
            packed[count + 1 :],
            most_pulled,
            present,
        )

    def _rows_along(self, heading: list[float], unknown: list[int]) -> Floats:
        """The rows on the state, of wheels that stand along headings; NaN of those that are not
        known."""
        for i in unknown:
            heading[i] = 0.0
        turns = (*map(math.cos, heading), *map(math.sin, heading), 1.0)
        h: Floats = np.frombuffer(self._pack_turns(*turns)).dot(self._by_heading)
        h = h.reshape(self._shape)
        for i in unknown:
            h[self._rows_of_wheel[i], TWIST] = math.nan
        return h

    def widened(self, measurements: Measurements, pulled: float, seconds: float) -> Floats:
        """The lasting errors with the slip of wheels that pull each other: R, shape (m, m).

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

    def slip(self, measurements: Measurements, x: Floats) -> list[WheelSlip]:
        """How each wheel slips at a state, as :mod:`wackel_odometry.filter` orders it."""
        rolled, moved = measurements.values, measurements.h.dot(x).tolist()
        # One sum tells whether anything is missing, which is rare.
        known = math.isfinite(sum(moved) + sum(rolled))
        slips = []
        for name, slide, roll in self._of_wheel:
            along = None if roll is None else rolled[roll] - moved[roll]
            across = None if slide is None else moved[slide]
            if not known:
                along, across = _number(along), _number(across)
            slips.append(WheelSlip(name=name, along=along, across=across))
        return slips


def blocked(rows: Rows, components: Collection[str]) -> list[bool]:
    """Which rows components spoil."""
    spoiled = {row for path in components for row in rows.of_component(path) or ()}
    return [row in spoiled for row in range(len(rows.names))]


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
