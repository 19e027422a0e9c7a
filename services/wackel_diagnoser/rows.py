"""What a step says, as rows with variances: constraints on the twist, and misses of references.

Slide and roll rows (eq. 3 and 4) and gyros share the unknown twist; steering and rolling are also
held against their references. Variances are propagated from what is known of the sensors, and then
scaled by what fault-free driving shows (:mod:`wackel_diagnoser.scaling`). Not so those of
calibration: it is constant, so that hours of one motion say nothing of the next
(:mod:`wackel_diagnoser.small_faults`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise, repeat
from operator import add, mul, sub
from struct import Struct
from typing import NamedTuple

import msgspec
import numpy as np

from wackel_diagnoser.reference import PENDING, Target
from wackel_diagnoser.transients import Untold
from wackel_diagnoser.tyres import Tyres
from wackel_drive.alignment import UNCERTAIN_S, Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Bools, Floats
from wackel_kinematics.drive import Drive
from wackel_node.config_drive import DriveConfig, GyroConfig

CREEP = 0.002
"""m/s by which a tyre creeps sideways for no reason that is measured."""
STEERING_LAG_S = 0.003
"""s by which steering and rolling of one step may belong to different times."""
FOLLOWS = 0.003
"""Share, and rad, by which a drive and a steering that follow may stay off their references."""
SHARED = 0.4
"""A wheel's slip by the mean slip that references force on all wheels: friction passes it on."""
DROOP_M_S = 0.03
"""By how much a drive gives way while wheels fight, half of it already at a slip of GRIP_M_S: a
tyre that slips pushes no harder if it slips more."""
GRIP_M_S = 0.01
YAWING = 0.3
"""The yaw rate that slip causes, by what it would be if all wheels slipped the same way around."""
ASKEW = 0.6
"""The same of what calibration forces on wheels: a mean over three or four of them makes it that.
Friction decides who slips, so it may be twice as much where they are calibrated badly."""
JERK = 1.0
"""A gyro's sample and a step cover different times, and tyres creep by what turns the robot: wheels
are ahead by as much as its value changes in one step. What changes in one step only is no turn."""
ASKED = 2.0
ASKED_FADES = 0.8
"""How much faster a yaw rate changes than that of the references, and what is left of their change
a step later: tyres and drives follow within 50 ms, and not evenly. What nobody asked for is no
turn, but the gyro's."""
SHAKES_FADE = 0.9
"""What is left, a step later, of the share by which all wheels seemed faster, or all slower, than
just before: whatever delays one answer delays others."""
UNKNOWN = 3.0
"""How much worse than configured calibration may be before driving has shown it."""
STEP_S = 0.01
"""Usual length of a step, from which encoders make speeds."""
SLOWEST = 0.01
"""m/s; a faulty wheel of a robot at rest is not off by less."""
TREMBLE = 0.02
"""rad/s by which a gyro may be off without any motion."""
YAW = 0.3
"""Share of speed by length by which a fault changes the yaw rate."""
MOVING_M_S = 0.05
"""Slower, residuals say nothing of calibration, and a faulty wheel looks sound."""

_NO_TWIST = [math.nan] * 3
_NOTHING = (0.0,) * 5  # of a column per kind of rows


class Spread(NamedTuple):
    """By how much rows may be off.

    Attributes:
        variance: If nothing is wrong, shape (M,).
        loose: What the present manoeuvre is expected to add to that, before driving has scaled it,
            shape (M,).
        size: What a fault's share refers to, shape (M,).
    """

    variance: Floats
    loose: Floats
    size: Floats


class _Seen(msgspec.Struct, frozen=True, gc=False):
    """What variances depend on, of a step.

    Attributes:
        target: What the wheels should have done.
        present: Which rows are there.
        sliding: Speed of the wheel of each slide row, m/s.
        shown: Of each roll row's wheel, or of its reference if that is faster, m/s.
        turning: What gyros show less their bias, rad/s.
        lag: By how much steerings may belong to another time, rad.
        lagging: What that is across each slide row, m/s.
        forced: m/s by which references force wheels to slip, of slide and roll rows.
        changed: By how much each gyro has changed unasked, rad/s.
        uneven: Share by which all speeds may be off, for the step took another time.
        late_yaw: rad/s by which the robot turns otherwise than its wheels, see :class:`Tyres`.
        speed: The fastest wheel's, m/s.
        mean: How much wheels slip on average, m/s.
        seconds: Length of the step.
    """

    target: Target
    present: Bools
    sliding: list[float]
    shown: list[float]
    turning: list[float]
    lag: list[float]
    lagging: list[float]
    forced: list[float]
    changed: list[float]
    uneven: float
    late_yaw: float
    speed: float
    mean: float
    seconds: float


class Measured(msgspec.Struct, gc=False):
    """Rows of a step; a missing one has z = 0, h = 0 and size = 0, so that it says nothing.

    Attributes:
        z: Shape (M,).
        h: Shape (M, 3).
        misses: By how much gyros are off the twist below, rad/s, and steerings and drives off their
            references, rad and m/s; 0 where one says nothing.
        rolled: What each roll row measured, m/s.
        yielded: By how much each drive is usually faster than its reference (mostly slower), which
            has been taken off, m/s, shape (roll rows,).
        speed: The fastest wheel's, m/s.
        creep: How much all wheels slip by their load, m/s.
        skids: Whether they are asked for more than tyres hold.
        present: Which rows are there.
        followed: Twist by which references follow the commanded one, m/s and rad/s; NaN if they are
            not known.
        turning: How much of each roll row's reference is for the robot's turning, m/s.
    """

    z: Floats
    h: Floats
    misses: list[float]
    rolled: list[float]
    yielded: list[float]
    speed: float
    creep: float
    skids: bool
    present: Bools
    followed: list[float]
    turning: list[float]
    _work_out: Callable[[], Spread]
    _spread: Spread | None = None

    def spread(self) -> Spread:
        """By how much they may be off. It is worked out when somebody asks for it, which in most
        steps nobody does."""
        if self._spread is None:
            self._spread = self._work_out()
        return self._spread


class Following(NamedTuple):
    """How drives follow their references, beyond what those know.

    Attributes:
        off: By how much each is faster, as a share, shape (roll rows,).
        gives_way: By how much they are slower for what they push, m/s by A or share of load.
        late_s: By how much they are later; mostly negative, since what they push makes them so.
    """

    off: list[float]
    gives_way: float
    late_s: float


class Rows:
    """Makes them.

    Attributes:
        names: ``wheel/<name>/slide``, ``…/roll``, ``gyro/<name>``, ``…/steering`` and
            ``…/rolling`` (against the references).
        slides, rolls, gyros, steering, rolling: Where each kind stands among the rows.
        lag_s: By how much wheels follow later than their steering's encoders show.
        following: How drives follow their references.
        every: Of all rows, that they are there.
        configured: Squares of the shares by which slide and roll rows (of speed) and gyros (of
            their rate) may be off.
    """

    def __init__(
        self, layout: Layout, config: DriveConfig, gyros: Mapping[str, GyroConfig]
    ) -> None:
        drive = self._drive = layout.drive
        names = layout.names
        slides, rolls = drive.slide_wheels, drive.roll_wheels
        steered = slides[drive.steers[slides]]
        self._steered: list[int] = steered.tolist()
        ends = np.cumsum([0, len(slides), len(rolls), len(gyros), len(steered), len(rolls)])
        self.slides, self.rolls, self.gyros, self.steering, self.rolling = (
            slice(a, b) for a, b in pairwise(ends.tolist())
        )
        self.count = int(ends[-1])
        self.names = (
            *(f"wheel/{names[i]}/slide" for i in slides),
            *(f"wheel/{names[i]}/roll" for i in rolls),
            *(f"gyro/{name}" for name in gyros),
            *(f"wheel/{names[i]}/steering" for i in steered),
            *(f"wheel/{names[i]}/rolling" for i in rolls),
        )
        self._roll_of = np.full(drive.n, -1)
        self._roll_of[rolls] = np.arange(len(rolls))
        self._slide_roll: list[int] = self._roll_of[slides].tolist()
        self._slide_rolls = min(self._slide_roll, default=0) >= 0
        self._radius_of = list(zip(rolls.tolist(), drive.roll_radius.tolist(), strict=True))
        settings = list(gyros.values())
        per_kind = (len(slides), len(rolls), len(gyros), len(steered), len(rolls))

        def per_row(*columns: tuple[Floats | float, ...]) -> Floats:
            """From values for slides, rolls, gyros, steering and rolling: one, or one each."""
            return np.stack(
                [
                    np.concatenate(
                        [np.broadcast_to(*each) for each in zip(column, per_kind, strict=True)]
                    )
                    for column in columns
                ],
                axis=-1,
            )

        quantum = (drive.roll_radius * config.encoder_step / math.sqrt(6)) ** 2
        density = np.array([gyro.noise_density**2 for gyro in settings])
        creep = 0.5 * CREEP / drive.length_m
        wander = np.array([gyro.bias_stability**2 + creep**2 for gyro in settings])
        angle = config.encoder_step**2 + FOLLOWS**2
        scale = np.array([gyro.scale_error for gyro in settings])
        # What does not depend on a row's own value, in one product: numpy takes long to be called.
        self._noise = per_row(
            (CREEP**2, 0.0, wander, angle, (0.5 * CREEP) ** 2),  # in every step
            (0.0, 0.0, density, 0.0, 0.0),  # by 1/dt
            (0.0, quantum, 0.0, 0.0, quantum),  # by 1/dt²
            *(_NOTHING,) * 4,
        )
        self._causes = np.concatenate(
            (
                # Noise, and how calibration turns the robot: see adopt().
                self._noise,
                # Size of a fault.
                per_row(
                    (SLOWEST, SLOWEST, TREMBLE, 1.0, SLOWEST),
                    *(_NOTHING,) * 2,
                    (1.0, 1.0, YAW / drive.length_m, 0.0, 1.0),  # by speed
                    *(_NOTHING,) * 3,
                ),
                # What all slip.
                per_row(
                    *(_NOTHING,) * 4,
                    (SHARED, SHARED, YAWING / drive.length_m, 0.0, SHARED),  # by mean slip
                    (0.0, 0.0, 0.0, 0.0, 1.0),  # by droop
                    _NOTHING,
                ),
            )
        )
        self._follows = per_row((0.0, 0.0, 0.0, 0.0, FOLLOWS**2))[:, 0]
        wrong = per_row((config.steering_error, config.radius_error, scale, 0.0, 0.0))[:, 0]
        self.configured: Floats = wrong[: self.gyros.stop] ** 2
        self._mounted: list[float] = drive.heading(np.zeros(drive.n)).tolist()
        self._zeros, self._h = [0.0] * drive.n, np.zeros((self.count, 3))
        self._h[self.gyros, 2] = 1.0
        self._constraints = len(slides) + len(rolls)
        self._no_slides, self._no_rolls = [0.0] * len(slides), [0.0] * len(rolls)
        self.lag_s, self.following = 0.0, Following(self._no_rolls, 0.0, 0.0)
        self._before: list[float] | None = None  # what wheels should have rolled at, if known
        self._no_gyros, self._no_steering = [0.0] * len(settings), [0.0] * len(steered)
        self._tyres = Tyres(drive)
        # For when no command tells.
        self._row_wheels: list[int] = drive.row_wheels.tolist()
        step = config.encoder_step / math.sqrt(6)  # of a difference, or a mean of two
        self._untold_drives = Untold([step] * drive.n, (drive.roll_radius * step / STEP_S).tolist())
        self._gyro_before = self._turned = self._no_gyros
        self._missed, self._shakes = self._no_rolls, 0.0  # of the last step
        # The references' yaw rate, and by how much that has changed of late, rad/s.
        self._told_yaw, self._asked = math.nan, 0.0
        self.every: Bools = np.ones(self.count, dtype=np.bool_)
        self._expected = np.ones((2, self.count))  # scales while driving has not shown others
        self._pack_z, self._pack = (
            Struct(f"{size}d").pack for size in (self.count, 2 * self.count + self._causes.shape[1])
        )
        self._untold: Bools = np.arange(self.count) < self.gyros.stop
        self.adopt(UNKNOWN**2 * self.configured)

    def roll_of(self, wheel: int) -> int:
        """Number of a wheel's roll row among the roll rows; -1 if it has none."""
        return int(self._roll_of[wheel])

    def correct(self, zeros: Floats) -> None:
        """Wheels stand so far off what they show, rad to the left, shape (n,)."""
        self._zeros = zeros.tolist()

    def adopt(
        self,
        calibration: Floats,
        *,
        follows: Floats | float = 0.0,
        biases: Floats | float = 0.0,
        scales: Floats | None = None,
    ) -> None:
        """Variances are made from now on of what driving has shown.

        Args:
            calibration: By what share of a wheel's speed slide and roll rows are off, and of their
                rate gyros, squares of standard deviations.
            follows: The same of what drives are faster than their references, beyond what is known
                of that, shape (roll rows,).
            biases: Variances with which those of gyros are known, (rad/s)², shape (g,).
            scales: By how much variances of sensors, and those that manoeuvres add, are larger than
                expected, shape (2, M); ``None``: they are not.
        """
        sensors, manoeuvre = self._expected if scales is None else scales
        # By the square of what each row shows (how far drives follow, and calibration), and of what
        # is forced or late.
        self._by_squares = np.concatenate((sensors * self._follows, manoeuvre))
        self._by_squares[: self.gyros.stop] += calibration
        self._by_squares[self.rolling] += follows
        constant = self._causes[: self.count]
        mean = float(np.add.reduce(calibration[: self._constraints])) / self._constraints
        np.multiply(self._noise, sensors[:, None], out=constant)
        constant[self.gyros, 0] += biases
        constant[self.gyros, -1] += (ASKEW / self._drive.length_m) ** 2 * mean

    def measure(
        self,
        step: Step,
        target: Target,
        bias: Floats,
        currents: list[float],
    ) -> Measured:
        """The rows of a step.

        Args:
            step: What the sensors said.
            target: What the wheels should have done.
            bias: Of each gyro, rad/s.
            currents: Of the rolling motors, A or share of load; NaN if unknown.
        """
        # Single numbers: for some wheels, Python is faster with them than numpy.
        drive, steered, zeros = self._drive, self._steered, self._zeros
        dt, heading, turns, rates = step.seconds, step.heading, step.steered, step.wheel_rate
        stands, late, uncertain = self._mounted.copy(), self.lag_s / dt, STEERING_LAG_S / dt
        for i in steered:
            stands[i] = heading[i] + zeros[i] - late * turns[i]
        lag = [abs(turns[i]) * uncertain for i in steered]
        rolled = [rates[i] * radius for i, radius in self._radius_of]
        turning = [*map(sub, step.gyro_rate, bias.tolist())]
        # One sum tells whether anything is missing, which is rare.
        whole = math.isfinite(sum(stands) + sum(lag) + sum(rolled) + sum(turning))
        if target.known:
            told, speeds = target.heading, target.speed
            aimed = self._aimed(target, late, stands)
            off = [heading[i] - told[i] for i in steered]
            rows = drive.known_rows(stands, aimed) if whole else _any_rows(drive, stands, aimed)
            forced, mean, made = self._tyres.slip(rows[1], speeds)
            present, followed = self.every, made
            turning_rolls = [lever * made[2] for lever in rows[1][self.rolls, 2].tolist()]
            yielded = self._yielded(speeds, currents, dt)
            missed = [*map(sub, map(sub, rolled, speeds), yielded)]
            self._untold_drives.told(stands, target.heading_gap, rolled, dt)
        else:
            rows = drive.known_rows(stands) if whole else _any_rows(drive, stands)
            forced, mean, made = self._untold_slip(rows[0], stands, target.heading_gap, rolled, dt)
            off, present, followed = self._no_steering, self._untold, _NO_TWIST
            missed = speeds = yielded = turning_rolls = self._no_rolls
            self._before = None
        h = self._h.copy()
        h[: self._constraints] = rows[0]
        z = [*self._no_slides, *rolled, *turning, *off, *missed]
        misses = [*[each - followed[2] for each in turning], *off, *missed]
        if not whole:
            present = present & np.isfinite(z) & np.isfinite(h[:, 0])
            h[~present] = 0.0
            z = np.where(present, z, 0.0).tolist()
            rolled, turning = z[self.rolls], z[self.gyros]
            lag, misses = _known(lag), _known(misses)
        shown = [*map(max, map(abs, rolled), map(abs, speeds))]
        speed = max(shown) if shown else 0.0
        # Along the slide rows a wheel's own speed; the robot's where it does not roll by itself.
        sliding = (
            [shown[i] for i in self._slide_roll]
            if self._slide_rolls
            else [speed] * len(self._no_slides)
        )
        lagging = [*map(mul, sliding, lag)] if len(lag) == len(sliding) else self._no_slides
        creep = self._tyres.creep(rows[-1], made, mean, speed, dt)
        mean += creep
        uneven = self._uneven(missed, target, dt)
        changed = self._changed(turning, followed[2])
        seen = _Seen(
            target,
            present,
            sliding,
            shown,
            turning,
            lag,
            lagging,
            forced,
            changed,
            uneven,
            self._tyres.late_yaw,
            speed,
            mean,
            dt,
        )
        return Measured(
            np.frombuffer(self._pack_z(*z)),  # in half the time of an array of them
            h,
            misses,
            rolled,
            yielded,
            speed,
            creep,
            self._tyres.skids,
            present,
            followed,
            turning_rolls,
            partial(self._spread, seen),
        )

    def _aimed(self, target: Target, late: float, stands: list[float]) -> list[float]:
        """Where wheels really point if they follow what they are told, rad.

        Args:
            target: What they should have done.
            late: By how many steps what encoders show is late; wheels follow as late.
            stands: Where they show to point, which is known better while lags are not learnt; NaN
                if unknown.
        """
        told, turned, zeros = target.heading, target.turned, self._zeros
        aimed = self._mounted.copy()
        for i in self._steered:
            aimed[i] = told[i] + zeros[i] - late * turned[i]
        if target.pending_share > PENDING:
            aimed = [*map(_first_known, stands, aimed)]
        return aimed

    def _yielded(self, speeds: list[float], currents: list[float], dt: float) -> list[float]:
        """By how much each drive is usually faster than it should, m/s."""
        # Single numbers: for some wheels, Python is faster with them than numpy.
        off, way, late_s = self.following
        before, self._before = self._before or speeds, speeds
        late = late_s / dt
        if not math.isfinite(sum(currents)):
            currents = _known(currents)
        return [
            share * now - way * amperes - late * (now - then)
            for share, now, then, amperes in zip(off, speeds, before, currents, strict=True)
        ]

    def _untold_slip(
        self,
        rows: Floats,
        stands: list[float],
        turns: list[float],
        rolled: list[float],
        dt: float,
    ) -> tuple[list[float], float, list[float]]:
        """As :meth:`Tyres.slip`, of what wheels do without being told.

        Args:
            rows: Slide and roll rows.
            stands: Where each wheel stands, rad.
            turns: How far it has at least yet to turn, rad.
            rolled: At which each roll row's rolls, m/s.
            dt: Of the step, s.
        """
        turning, hastening = self._untold_drives.step(stands, turns, rolled, dt)
        speed = max((abs(each) for each in rolled if math.isfinite(each)), default=0.0)
        # One that is still turned rolls at what it shall do once it is there.
        forced = [speed * turning[i] for i in self._row_wheels]
        for row, late in enumerate(hastening, start=self.rolls.start):
            forced[row] += late
        mean = math.sqrt(sum([each * each for each in forced]) / len(forced))
        return forced, mean, self._tyres.slip(rows, rolled)[2]

    def _spread(self, seen: _Seen) -> Spread:
        """By how much rows may be off."""
        target, shown, lag, mean, dt = seen.target, seen.shown, seen.lag, seen.mean, seen.seconds
        forced, gaps, slides = seen.forced, target.heading_gap, len(seen.sliding)
        uneven, late_yaw, speed = seen.uneven, seen.late_yaw, seen.speed
        # How much is shown; what is forced or late, or belongs to another time; and what causes
        # depend on.
        values = (
            *seen.sliding,
            *shown,
            *seen.turning,
            *self._no_steering,
            *shown,
            *map(add, forced[:slides], seen.lagging),
            *forced[slides:],
            *[
                JERK * each + uneven * abs(rate) + late_yaw
                for each, rate in zip(seen.changed, seen.turning, strict=True)
            ],
            *map(add, [target.pending_share * gaps[i] for i in self._steered], lag),
            *[
                max(PENDING * gap, target.lag_share * late) + uneven * each
                for gap, late, each in zip(target.speed_gap, target.speed_late, shown, strict=True)
            ],
            1.0,
            1 / dt,
            1 / dt**2,
            speed,
            mean,
            # While wheels turn, their references contradict each other: they slip.
            DROOP_M_S * mean / (mean + GRIP_M_S),
            speed * speed,
        )
        count = self.count
        # Twice as fast as to make an array of them.
        squares = np.frombuffer(bytearray(self._pack(*values)))
        causes = self._causes.dot(squares[2 * count :])
        squares = squares[: 2 * count]
        loose, size = squares[count:], causes[count : 2 * count]
        loose += causes[2 * count :]
        squares *= squares
        scaled = squares * self._by_squares
        variance = scaled[:count]
        variance += causes[:count]
        variance += scaled[count:]
        if seen.present is not self.every:
            size *= seen.present
        return Spread(variance, loose, size)

    def _uneven(self, missed: list[float], target: Target, dt: float) -> float:
        """Share by which all speeds may be off, for another time was measured than stamps say.

        Either a step is longer or shorter than most; or an adapter or the computer was late by a
        millisecond or two, which stamps do not show. All wheels then seem faster than just before,
        or all slower, as no fault of a part makes them.

        Args:
            missed: By how much each roll row's wheel is faster than its reference, m/s.
            target: What it should have done.
            dt: Of the step, s.
        """
        before, self._missed = self._missed, missed
        faster = [
            (now - then) / speed
            for now, then, speed in zip(missed, before, target.speed, strict=True)
            if abs(speed) > MOVING_M_S and math.isfinite(now - then)
        ]
        if len(faster) > 1:  # of one alone nobody can tell
            common = max(min(faster), -max(faster), 0.0)  # none if they differ in sign
            self._shakes = max(min(common, UNCERTAIN_S / dt), SHAKES_FADE * self._shakes)
        return max(abs(target.off_s) / dt, self._shakes)

    def _changed(self, turning: list[float], told: float) -> list[float]:
        """By how much each gyro's value has changed, in this step and in the one before, as far as
        the references' yaw rate, rad/s, has done so of late; what else changes is no turn."""
        before, now = self._turned, [*map(abs, map(sub, turning, self._gyro_before))]
        asked, self._told_yaw = abs(told - self._told_yaw), told
        self._gyro_before, self._turned = turning, now
        if not math.isfinite(asked):
            self._asked = 0.0
            return [*map(min, now, before)]
        self._asked = max(asked, ASKED_FADES * self._asked)
        return [*map(min, now, before, repeat(ASKED * self._asked))]


def _known(values: list[float]) -> list[float]:
    """0 in place of what is not known."""
    return [each if math.isfinite(each) else 0.0 for each in values]


def _first_known(value: float, other: float) -> float:
    return value if math.isfinite(value) else other


def _any_rows(drive: Drive, *headings: Sequence[float]) -> Floats:
    """As :meth:`Drive.known_rows`, of headings that may be unknown."""
    return drive.rows_along(np.array(headings))
