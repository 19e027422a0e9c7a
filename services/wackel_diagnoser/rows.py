"""What a step says, as rows with variances: constraints on the twist, and misses of references.

Slide and roll rows (eq. 3 and 4) and gyros share the unknown twist; steering and rolling are also
held against their references. Variances are propagated from what is known of the sensors, and then
scaled by what fault-free driving shows (:mod:`wackel_diagnoser.scaling`). Not so those of
calibration: it is constant, so that hours of one motion say nothing of the next
(:mod:`wackel_diagnoser.small_faults`).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wackel_diagnoser.reference import Target
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Bools, Floats
from wackel_node.config_drive import DriveConfig, GyroConfig

CREEP = 0.002
"""m/s by which a tyre creeps sideways for no reason that is measured."""
STEERING_LAG_S = 0.003
"""s by which steering and rolling of one step may belong to different times."""
FOLLOWS = 0.003
"""Share, and rad, by which a drive and a steering that follow may stay off their references."""
PENDING = 0.15
"""Share of what is still to come (command less reference) by which a reference may be off: a real
drive is no first-order lag."""
FORCED = 0.8
"""A wheel's slip by what the references of all wheels, each with its own lag, force on it."""
SHARED = 0.4
"""The same by the mean slip that they force on all wheels: friction passes it on."""
DROOP_M_S = 0.03
"""By how much a drive gives way while wheels fight, half of it already at a slip of GRIP_M_S: a
tyre that slips pushes no harder if it slips more."""
GRIP_M_S = 0.01
YAWING = 0.3
"""The yaw rate that this causes, by what it would be if all wheels slipped the same way around."""
JERK = 1.0
"""A gyro's sample and a step cover different times, and tyres creep by what turns the robot: wheels
are ahead by as much as its value changes in one step. What changes in one step only is no turn."""
UNKNOWN = 3.0
"""How much worse than configured calibration may be before driving has shown it."""
LOADED = 0.05
"""Slip by speed when tyres are loaded with all their grip, of which SHARED differs from wheel to
wheel: soft tyres creep by 2 % of the speed. With half the load they creep by half of that, and so
much more alike that a quarter differs."""
HOLDS_M_S2 = 6.5
"""Acceleration at which they skid: rubber on a smooth floor. A command that jumps asks for more,
and the robot is late by the rest."""
REGULAR = 1e-9 * np.eye(3)
"""For drives whose rows do not determine the twist."""
SLOWEST = 0.01
"""m/s; a faulty wheel of a robot at rest is not off by less."""
TREMBLE = 0.02
"""rad/s by which a gyro may be off without any motion."""
YAW = 0.3
"""Share of speed by length by which a fault changes the yaw rate."""
MOVING_M_S = 0.05
"""Slower, residuals say nothing of calibration, and a faulty wheel looks sound."""


@dataclass
class Measured:
    """Rows of a step; a missing one has z = 0, h = 0 and size = 0, so that it says nothing.

    Attributes:
        z: Shape (M,).
        h: Shape (M, 3).
        base: Variance of sensors, which driving scales, shape (M,).
        fixed: Variance of calibration, as far as it is known, shape (M,).
        loose: Variance that the present manoeuvre adds, shape (M,).
        size: What a fault's share refers to, shape (M,).
        speed: The fastest wheel's, m/s.
        present: Which rows are there.
    """

    z: Floats
    h: Floats
    base: Floats
    fixed: Floats
    loose: Floats
    size: Floats
    speed: float
    present: Bools


class Rows:
    """Makes them.

    Attributes:
        names: ``wheel/<name>/slide``, ``…/roll``, ``gyro/<name>``, ``…/steering`` and
            ``…/rolling`` (against the references).
        slides, rolls, gyros, steering, rolling: Where each kind stands among the rows.
        lag_s: By how much wheels follow later than their steering's encoders show.
        configured: Squares of the shares of speed by which slide and roll rows may be off.
    """

    def __init__(
        self, layout: Layout, config: DriveConfig, gyros: Mapping[str, GyroConfig]
    ) -> None:
        drive = self._drive = layout.drive
        names = layout.names
        slides, rolls = drive.slide_wheels, drive.roll_wheels
        self._steered = slides[drive.steers[slides]]
        ends = np.cumsum([0, len(slides), len(rolls), len(gyros), len(self._steered), len(rolls)])
        self.slides, self.rolls, self.gyros, self.steering, self.rolling = (
            slice(a, b) for a, b in pairwise(ends.tolist())
        )
        self.count = int(ends[-1])
        self.names = (
            *(f"wheel/{names[i]}/slide" for i in slides),
            *(f"wheel/{names[i]}/roll" for i in rolls),
            *(f"gyro/{name}" for name in gyros),
            *(f"wheel/{names[i]}/steering" for i in self._steered),
            *(f"wheel/{names[i]}/rolling" for i in rolls),
        )
        self._roll_of = np.full(drive.n, -1)
        self._roll_of[rolls] = np.arange(len(rolls))
        self._slide_roll = self._roll_of[slides]
        self._slide_rolls = bool((self._slide_roll >= 0).all())
        settings = list(gyros.values())
        per_kind = (len(slides), len(rolls), len(gyros), len(self._steered), len(rolls))

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
        wander = np.array([gyro.bias_stability**2 for gyro in settings])
        wander += (0.5 * CREEP / drive.length_m) ** 2
        angle = config.encoder_step**2 + FOLLOWS**2
        self._noise = per_row(
            (CREEP**2, 0.0, wander, angle, (0.5 * CREEP) ** 2),  # in every step
            (0.0, 0.0, density, 0.0, 0.0),  # by 1/dt
            (0.0, quantum, 0.0, 0.0, quantum),  # by 1/dt²
        )
        scale = np.array([gyro.scale_error for gyro in settings])
        self._follows = per_row((0.0, 0.0, 0.0, 0.0, FOLLOWS**2))[:, 0]
        wrong = per_row((config.steering_error, config.radius_error, scale, 0.0, 0.0))[:, 0]
        self._calibration: Floats = (UNKNOWN * wrong) ** 2
        self.configured: Floats = wrong[: len(slides) + len(rolls)] ** 2
        self._size = per_row(
            (SLOWEST, SLOWEST, TREMBLE, 1.0, SLOWEST),
            (1.0, 1.0, YAW / drive.length_m, 0.0, 1.0),  # by speed
        )
        # What a manoeuvre adds: by what is forced or late in each row, and by what all slip.
        self._late = per_row((FORCED, FORCED, JERK, PENDING, PENDING))[:, 0]
        self._slipping = per_row(
            (SHARED, SHARED, YAWING / drive.length_m, 0.0, SHARED),  # by mean slip
            (0.0, 0.0, 0.0, 0.0, 1.0),  # by droop
        )
        self._zeros = np.zeros(drive.n)
        self.lag_s = 0.0
        self._h = np.zeros((self.count, 3))
        self._h[self.gyros, 2] = 1.0
        self._constraints = len(slides) + len(rolls)
        self._no_slide, self._no_steering = np.zeros(len(slides)), np.zeros(len(self._steered))
        # The rows of a wheel that has both are square to each other, at any angle.
        straight = drive.rows(drive.steering(np.zeros(drive.n)))
        both = set(slides.tolist()) & set(rolls.tolist())
        turning = {i for i in drive.row_wheels.tolist() if drive.steers[i]}
        self._inverse: Floats | None = None
        if turning <= both:
            self._inverse = np.asarray(np.linalg.inv(straight.T @ straight + REGULAR))
        self._gyro_before = self._turned = np.zeros(len(settings))
        self._told: list[float] = []
        self._root_rolls = math.sqrt(max(len(rolls), 1))
        self._skid = 0.0  # by how much wheels are ahead of the robot, m/s
        self._all = np.ones(self.count, dtype=np.bool_)

    def roll_of(self, wheel: int) -> int:
        """Number of a wheel's roll row among the roll rows; -1 if it has none."""
        return int(self._roll_of[wheel])

    def correct(self, zeros: Floats) -> None:
        """Wheels stand so far off what they show, rad to the left, shape (n,)."""
        self._zeros = zeros

    def calibrate(self, squares: Floats) -> None:
        """Slide and roll rows are off by such shares of a wheel's speed, squares of standard
        deviations."""
        self._calibration[: self._constraints] = squares

    def measure(self, step: Step, target: Target, bias: Floats) -> Measured:
        """The rows of a step.

        Args:
            step: What the sensors said.
            target: What the wheels should have done.
            bias: Of each gyro, rad/s.
        """
        drive, dt, steered = self._drive, step.seconds, self._steered
        slides, rolls, gyros = self.slides, self.rolls, self.gyros
        headings = np.empty((2, drive.n))
        headings[0], headings[1] = step.heading, target.heading
        headings += self._zeros
        if self.lag_s:
            headings[0] -= step.steered * (self.lag_s / dt)
        rows, wanted = drive.rows_along(headings)
        h = self._h.copy()
        h[: self._constraints] = rows
        rolled = step.wheel_rate[drive.roll_wheels] * drive.roll_radius
        z = np.concatenate(
            (
                self._no_slide,
                rolled,
                step.gyro_rate - bias,
                (step.heading - target.heading)[steered],
                rolled - target.speed,
            )
        )
        speeds = target.speed
        lag = np.abs(step.steered[steered]) * (STEERING_LAG_S / dt)
        forced = self._slip(wanted, speeds)
        # One sum tells whether anything is missing, which is rare.
        whole = math.isfinite(sum(z.tolist()))
        present = self._all
        if not whole:
            present = np.isfinite(z) & np.isfinite(h[:, 0])
            z[~present] = 0.0
            h[~present] = 0.0
            rolled, speeds, lag = z[rolls], np.nan_to_num(speeds), np.nan_to_num(lag)
        shown = np.maximum(np.abs(rolled), np.abs(speeds))
        speed = max(shown.tolist(), default=0.0)
        # Along the slide rows a wheel's own speed; the robot's where it does not roll by itself.
        sliding = shown[self._slide_roll] if self._slide_rolls else np.full(slides.stop, speed)
        size = self._size.dot((1.0, speed))
        turning = z[gyros]
        squares = np.concatenate((sliding, shown, turning, self._no_steering, shown))
        squares *= squares
        base = squares * self._follows
        base += self._noise.dot((1.0, 1 / dt, 1 / dt**2))
        fixed = squares * self._calibration

        # While wheels turn, their references contradict each other: they really slip.
        mean = math.sqrt(float(forced.dot(forced)) / len(forced))
        mean += self._hastened(target, speed, dt)
        turned = np.abs(turning - self._gyro_before)
        loose = np.concatenate(
            (
                forced,
                np.minimum(turned, self._turned),
                target.heading_gap[steered],
                target.speed_gap,
            )
        )
        np.abs(loose, out=loose)
        loose *= self._late
        loose += self._slipping.dot((mean, DROOP_M_S * mean / (mean + GRIP_M_S)))
        if len(lag) == len(sliding):
            loose[slides] += sliding * lag
        loose[self.steering] += lag
        loose *= loose
        self._gyro_before, self._turned = turning, turned
        if not whole:
            size[~present] = 0.0
        return Measured(z, h, base, fixed, loose, size, speed, present)

    def _hastened(self, target: Target, speed: float, dt: float) -> float:
        """How much all slip since the command hastens the robot, m/s; 0 if it is not known."""
        told = target.speed.tolist()
        before, self._told = self._told or told, told
        vx, vy, omega = target.twist.tolist()
        hastened = math.dist(told, before) / (self._root_rolls * dt)
        held = math.hypot(omega * vx, omega * vy, hastened) / HOLDS_M_S2
        if not held >= 0.0:
            self._skid = 0.0
            return 0.0
        self._skid = max(0.0, self._skid + (hastened - HOLDS_M_S2) * dt)
        return LOADED * min(held * held, 1.0) * speed + self._skid

    def _slip(self, rows: Floats, speeds: Floats) -> Floats:
        """How much the references contradict each other, m/s, shape (R,); 0 if there are none."""
        right = speeds.dot(rows[self.rolls])
        if not math.isfinite(sum(right.tolist())):
            return np.zeros(len(rows))
        inverse = self._inverse
        if inverse is None:
            inverse = np.asarray(np.linalg.inv(rows.T @ rows + REGULAR))
        slip = np.asarray(rows.dot(inverse.dot(right)))
        slip[self.rolls] -= speeds
        return slip
