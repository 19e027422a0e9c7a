"""Velocity candidates ξ_c(k,l; w): twists from two slide rows and one roll row each (eq. 9).

Wheels k and l leave one line of twists, along Σ = c_k × c_l (eq. 7 and 8); the roll row of w, which
is k or l, picks the point on it: ξ = Σ r_w φ̇_w / (j_w · Σ).
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from wackel_kinematics.array import LAST, NEXT, Bools, Floats, Ints, cross, dot
from wackel_kinematics.drive import Drive

COINCIDENT = 0.10
"""‖Σ‖ of unit rows below which a pair is singular (kind B). It is the sine of the angle between the
pair's planes in velocity space; an error of steering turns their line 1/‖Σ‖ times as far, so here
1° of steering error becomes 6° and more."""

AT_CONTACT = 0.05
"""|j_w · Σ| / ‖Σ‖ of unit rows below which a candidate is singular (kind A): w rolls by less than
this share of the robot's motion, so errors of its rate are magnified 20 times and more."""

_DEPENDENT = 1e-9
"""|det| / L below which three rows count as linearly dependent: a solution would be rounding."""


class Singularities(NamedTuple):
    """Which candidates say nothing at given steering angles (section 3.2); shapes (..., m).

    Attributes:
        at_contact: Kind A, the centre of rotation of the pair lies at the contact of w.
        coincident: Kind B, the axles of the pair coincide; kind A is not asked then, for the pair
            has no definite centre.
    """

    at_contact: Bools
    coincident: Bools

    @property
    def any(self) -> Bools:
        """Singular of either kind."""
        return self.at_contact | self.coincident


class Candidates:
    """All candidates of a drive, in the paper's order.

    Pairs of wheels with slide rows in lexicographic order, within a pair first the roll row of k,
    then of l, as far as these have one: (1,2;1) (1,2;2) (1,3;1) (1,3;3) (2,3;2) (2,3;3) for n = 3
    steered wheels, m = n (n − 1) in general. Drives on Swedish wheels have none.

    Attributes:
        drive: The wheels.
        k: First wheel of the pair of each candidate, from 0, shape (m,).
        l: Second wheel.
        w: Wheel whose roll row is used.
        labels: The paper's names, with wheels from 1: ``(1,2;1)``.
    """

    def __init__(self, drive: Drive) -> None:
        rolls = set(drive.roll_wheels.tolist())
        members = [
            (pair, w)
            for pair in combinations(drive.slide_wheels.tolist(), 2)
            for w in pair
            if w in rolls
        ]
        pairs = sorted({pair for pair, _ in members})
        first, second = _indices(pairs, 2)
        self.drive = drive
        self.k, self.l, self.w = _indices([(*pair, w) for pair, w in members], 3)
        self.labels = tuple(f"({k + 1},{m + 1};{w + 1})" for (k, m), w in members)
        self._pair: Ints = np.array([pairs.index(pair) for pair, _ in members], dtype=np.intp)
        self._first: Ints = np.searchsorted(drive.slide_wheels, first)
        self._second: Ints = np.searchsorted(drive.slide_wheels, second)
        self._roll: Ints = drive.slide_count + np.searchsorted(drive.roll_wheels, self.w)
        # Where the factors of c_k × c_l stand among all entries of the rows, shape (2, m, 3) each.
        a, b = (3 * each[self._pair][:, None] for each in (self._first, self._second))
        self._of_k, self._of_l = np.stack((a + NEXT, a + LAST)), np.stack((b + LAST, b + NEXT))

    def __len__(self) -> int:
        return len(self.labels)

    def lines(self, rows: Floats) -> Floats:
        """Σ = c_k × c_l (eq. 7), the direction in which each candidate can lie.

        Args:
            rows: :meth:`Drive.rows`, shape (..., R, 3).

        Returns:
            Shape (..., m, 3); the instantaneous centre of Σ is where the axles of k and l meet.
        """
        entries = rows.reshape(*rows.shape[:-2], 3 * rows.shape[-2])
        products = entries.take(self._of_k, axis=-1)
        products *= entries.take(self._of_l, axis=-1)
        lines: Floats = products[..., 0, :, :] - products[..., 1, :, :]
        return lines

    def levers(self, rows: Floats) -> Floats:
        """det [c_k; c_l; j_w] = j_w · Σ: distance of the contact of w to the other wheel's axle.

        Args:
            rows: Shape (..., R, 3).

        Returns:
            m, signed, shape (..., m).
        """
        return dot(rows.take(self._roll, axis=-2), self.lines(rows))

    def twists(self, rows: Floats, values: Floats) -> Floats:
        """The candidates' twists (eq. 9).

        Args:
            rows: At the measured steering, shape (..., R, 3).
            values: :meth:`Drive.values` of the measured wheel rates, shape (..., R).

        Returns:
            Shape (..., m, 3); NaN where the three rows are dependent. Near a singularity the values
            are finite and worthless: ask :meth:`singularities`.
        """
        lines = self.lines(rows)
        lever = dot(rows.take(self._roll, axis=-2), lines)
        return lines * self._over(values.take(self._roll, axis=-1), lever)[..., None]

    def singularities(self, rows: Floats) -> Singularities:
        """Step I: which candidates to leave out; asked at the commanded steering.

        Args:
            rows: Shape (..., R, 3).
        """
        unit = self.drive.scaled_unit(rows)
        lines = self.lines(unit)
        length = dot(lines, lines)
        rolling = dot(unit.take(self._roll, axis=-2), lines)
        rolling *= rolling
        # All squared. Asked this way round, what is not a number is singular too.
        distinct = length >= COINCIDENT**2
        return Singularities(distinct & (rolling < AT_CONTACT**2 * length), ~distinct)

    def sensitivities(self, rows: Floats) -> Floats:
        """Inverse of [c_k; c_l; j_w]: how errors of the three rows turn into errors of the twist.

        The covariance of a candidate is G diag(variances of its three rows) Gᵀ, where an error δβ
        of the steering of wheel i means j_i · ξ δβ on its slide row, and nothing on its roll row,
        since dj/dβ = c and c · ξ = 0.

        Args:
            rows: Shape (..., R, 3).

        Returns:
            G, shape (..., m, 3, 3); columns for the slide row of k, of l, the roll row of w; NaN
            where the three rows are dependent.
        """
        slide_k = rows.take(self._first[self._pair], axis=-2)
        slide_l = rows.take(self._second[self._pair], axis=-2)
        roll = rows.take(self._roll, axis=-2)
        lines = cross(slide_k, slide_l)
        columns = np.stack([cross(slide_l, roll), cross(roll, slide_k), lines], axis=-1)
        lever = dot(roll, lines)
        return columns * self._over(np.ones_like(lever), lever)[..., None, None]

    def noise_gains(self, rows: Floats) -> Floats:
        """Error of the twist as [vx, vy, L ω] for an error of the rolling speed of w, without unit.

        Args:
            rows: Shape (..., R, 3).

        Returns:
            ‖Σ‖ / |j_w · Σ| of scaled rows, shape (..., m); NaN where the three are dependent.
        """
        lines = self.lines(rows) * (1.0, 1.0, self.drive.length_m)
        return np.abs(self._over(np.sqrt(dot(lines, lines)), self.levers(rows)))

    def _over(self, numerator: Floats, lever: Floats) -> Floats:
        """Quotient, NaN where the lever vanishes beside the drive's size; it is changed there."""
        lever[np.abs(lever) <= _DEPENDENT * self.drive.length_m] = np.nan
        return numerator / lever


def _indices(members: Sequence[tuple[int, ...]], width: int) -> Ints:
    return np.array(members, dtype=np.intp).reshape(-1, width).T
