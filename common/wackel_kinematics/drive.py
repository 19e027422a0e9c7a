"""A drive: its wheels' constraints as rows on the twist, slide rows first, then roll rows.

Every row is one form. A direction at angle ψ through the contact point (x, y) sees of the twist
``[cos ψ, sin ψ, x sin ψ − y cos ψ] · ξ``, the contact's velocity along that direction:

- slide row c_i (eq. 4), along the axle: ψ = α + β, equal to 0;
- roll row j_i (eq. 3), along the rolling direction: ψ = α + β − π/2, equal to r φ̇;
- roll row of a wheel with rollers at angle γ: ψ = α + β − π/2 + γ, divided by cos γ, so that it
  too equals r φ̇ (Siegwart, Nourbakhsh, section 3.2.3, Swedish wheel).

Turning ψ by π/2 is the derivative by β, hence dc/dβ = −j and dj/dβ = +c. Each entry
is a sum of constant shares of the cosine and the sine of the wheel's heading α + β − π/2.
"""

import math
import struct
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from wackel_kinematics.array import Bools, Floats, Ints, dot, last_axis
from wackel_kinematics.wheel import Wheel


class Drive:
    """Constraint rows of a set of wheels (eq. 5 and 6), for any mix of kinds.

    ``n`` wheels give ``R`` rows: first the slide rows of :attr:`slide_wheels`, then the roll rows
    of :attr:`roll_wheels`, each in the order of the wheels. ``steering`` and ``wheel_rate`` always
    have ``n`` entries; those of wheels that do not steer, or have no roll row, are ignored.

    Attributes:
        wheels: As given.
        alpha: Placement angles, rad, shape (n,).
        xy: Contact points, m, shape (n, 2).
        steers: Which wheels steer, shape (n,).
        slide_wheels: Wheel number of each slide row, from 0.
        roll_wheels: Wheel number of each roll row, from 0.
        roll_radius: Wheel radius of each roll row, m.
        row_wheels: Wheel number of each row, shape (R,).
        length_m: L, the root mean square of the l of wheels with rows. Dividing the third column by
            it makes the three columns comparable (m/s each); the paper leaves this "metric" open.

    Raises:
        ValueError: No wheel has a row, or all of those stand at the origin.
    """

    def __init__(self, wheels: Sequence[Wheel]) -> None:
        self.wheels = tuple(wheels)
        self.alpha = _frozen([wheel.place.alpha_rad for wheel in wheels])
        self.xy = _frozen([(wheel.place.x_m, wheel.place.y_m) for wheel in wheels])
        self.steers: Bools = np.array([wheel.beta_rad is None for wheel in wheels], dtype=np.bool_)
        self._mounted = _frozen([wheel.beta_rad or 0.0 for wheel in wheels])

        slide = [i for i, wheel in enumerate(wheels) if wheel.slide]
        roll = [i for i, wheel in enumerate(wheels) if wheel.radius_m is not None]
        self.slide_wheels: Ints = np.array(slide, dtype=np.intp)
        self.roll_wheels: Ints = np.array(roll, dtype=np.intp)
        self.row_wheels: Ints = np.array(slide + roll, dtype=np.intp)
        self.roll_radius = _frozen([w.radius_m for w in wheels if w.radius_m is not None])

        distances = [wheels[i].place.l_m for i in {*slide, *roll}]
        if not any(distances):
            raise ValueError("no wheel away from the origin constrains the motion")
        self.length_m = math.sqrt(sum(d * d for d in distances) / len(distances))

        self._scale = _frozen([1.0, 1.0, 1.0 / self.length_m])
        # Heading of a wheel by its angle β.
        self._forward = self.alpha - math.pi / 2
        self._mounted_heading = self._mounted + self._forward
        self._all_steer = bool(self.steers.all())
        # What each row sees of the motion along its wheel's heading, and to the left of it.
        along = np.array([0.0] * len(slide) + [1.0] * len(roll))
        left = np.array([1.0] * len(slide) + [math.tan(wheels[i].roller_rad) for i in roll])
        x, y = self.xy[self.row_wheels].T
        self._by_cos = np.stack([along, left, x * left - y * along], axis=-1)
        self._by_sin = np.stack([-left, along, x * along + y * left], axis=-1)
        # The same as one matrix, from the cosines of all wheels and then their sines.
        rows = np.arange(len(self.row_wheels))
        both = np.zeros((2 * self.n, len(rows), 3))
        both[self.row_wheels, rows] = self._by_cos
        both[self.n + self.row_wheels, rows] = self._by_sin
        self._by_both = both.reshape(2 * self.n, -1)

    @property
    def n(self) -> int:
        """Number of wheels, castors included."""
        return len(self.wheels)

    @property
    def slide_count(self) -> int:
        """Number of slide rows; the roll rows begin at this index."""
        return len(self.slide_wheels)

    def beta(self, steering: Floats) -> Floats:
        """Steering angle β of every wheel: as given where it steers, as mounted elsewhere.

        Args:
            steering: β in rad, shape (..., n).

        Raises:
            ValueError: The last axis is not n long.
        """
        return np.where(self.steers, last_axis(steering, self.n, "steering"), self._mounted)

    def heading(self, steering: Floats) -> Floats:
        """Rolling direction from the robot's x axis, α + β − π/2, rad, shape (..., n)."""
        return self.beta(steering) + self._forward

    def steering(self, heading: Floats) -> Floats:
        """β whose rolling direction is the heading: inverse of :meth:`heading` where it steers."""
        return self.beta(last_axis(heading, self.n, "heading") - self._forward)

    def rows(self, steering: Floats) -> Floats:
        """C₁(β) above J₁(β) (eq. 5 and 6).

        Args:
            steering: β in rad, shape (..., n).

        Returns:
            Shape (..., R, 3); first two columns without unit, third in m. Rows of a wheel whose
            angle is not finite are NaN.
        """
        return self.rows_along(self.heading(steering))

    def rows_along(self, heading: Floats) -> Floats:
        """The rows of wheels that stand along headings; as :meth:`rows`, without an angle β.

        Args:
            heading: Rolling directions, rad, shape (..., n).

        Raises:
            ValueError: The last axis is not n long.
        """
        heading = last_axis(heading, self.n, "heading")
        if not self._all_steer:
            heading = np.where(self.steers, heading, self._mounted_heading)
        with np.errstate(invalid="ignore"):
            turns = np.cos(heading), np.sin(heading)
        cos, sin = (each.take(self.row_wheels, axis=-1)[..., None] for each in turns)
        return np.asarray(cos * self._by_cos + sin * self._by_sin)

    def known_rows(self, *headings: Sequence[float]) -> Floats:
        """As :meth:`rows_along`, up to rounding and in a third of the time.

        Args:
            headings: Each of all wheels, fixed or not, and finite.

        Returns:
            Shape (len(headings), R, 3).
        """
        # For some wheels, Python is faster with single numbers than numpy.
        both: list[float] = []
        for each in headings:
            both += map(math.cos, each)
            both += map(math.sin, each)
        # In half the time of an array of them.
        turns = np.frombuffer(_pack(len(both))(*both))
        return self._turned(turns.reshape(len(headings), -1))

    def many_known_rows(self, headings: Floats) -> Floats:
        """As :meth:`known_rows`, of so many headings that numpy is faster with them.

        Args:
            headings: Each of all wheels, fixed or not, and finite, rad, shape (K, n).

        Returns:
            Shape (K, R, 3).
        """
        return self._turned(np.concatenate((np.cos(headings), np.sin(headings)), axis=1))

    def _turned(self, both: Floats) -> Floats:
        """Rows, from the cosines of all wheels and then their sines, shape (K, 2 n)."""
        rows: Floats = both.dot(self._by_both)
        return rows.reshape(len(both), -1, 3)

    def values(self, wheel_rate: Floats) -> Floats:
        """What the rows times ξ equal: 0 for slide rows, r φ̇ for roll rows (eq. 5 and 6).

        Args:
            wheel_rate: φ̇ in rad/s, shape (..., n).

        Returns:
            Shape (..., R), m/s.

        Raises:
            ValueError: The last axis is not n long.
        """
        rate = last_axis(wheel_rate, self.n, "wheel rate")
        values = np.zeros((*rate.shape[:-1], len(self.row_wheels)))
        values[..., self.slide_count :] = self.roll_radius * rate.take(self.roll_wheels, axis=-1)
        return values

    def scaled(self, rows: Floats) -> Floats:
        """Rows for the scaled twist [vx, vy, L ω]: third column divided by L."""
        return rows * self._scale

    def scaled_unit(self, rows: Floats) -> Floats:
        """Scaled rows of length 1: normals of the planes in velocity space (section 3.1)."""
        scaled = self.scaled(rows)
        return scaled / np.sqrt(dot(scaled, scaled))[..., None]


@cache
def _pack(count: int) -> Callable[..., bytes]:
    """Puts so many numbers side by side."""
    return struct.Struct(f"{count}d").pack


def _frozen(values: Sequence[object]) -> Floats:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
