"""Likelihoods of all hypotheses for one step, in one go.

For each hypothesis h with variances R_h = R + Q_h of the rows z = H ξ + noise, the unknown twist ξ
is integrated out::

    ln p(z | h) = −½ [Σ ln R_h + ln det(Hᵀ R_h⁻¹ H) + min_ξ Σ (z − H ξ)² / R_h] + constant

Elimination of ξ from [H z]ᵀ R_h⁻¹ [H z], a matrix of 4 × 4 of which the upper triangle is enough,
leaves the minimum, and the determinant is the product of the pivots. Rows that are no rows on ξ
(steering and rolling against their references) have H = 0. Singular configurations need no special
case, for what the rows do not determine costs every hypothesis the same.
"""

import numpy as np

from wackel_kinematics.array import Floats

WIDE = 1e-4
"""One over the variance of the twist before anything is measured: 100 m/s, 100 rad/s. It keeps the
algebra regular where rows are missing, and is nothing beside any row."""

_UPPER = {size: np.triu_indices(size) for size in (2, 3, 4)}
"""Row and column of each element of an upper triangle."""


class Bank:
    """Evaluates hypotheses.

    Hypotheses widen a row by few different factors: what each such *level* needs is computed once.

    Args:
        spread: Squares of the factors by which each widens each row, shape (K, M).
    """

    def __init__(self, spread: Floats) -> None:
        count, rows = spread.shape
        factors = spread.tolist()
        levels = sorted({level for each in factors for level in enumerate(each)})
        number = {level: at for at, level in enumerate(levels)}
        self._row = np.array([row for row, _ in levels])
        self._factor = np.array([factor for _, factor in levels])
        # Which level each hypothesis takes of each row, shape (M, K), and as 0 and 1, (levels, K).
        chosen = [[number[level] for level in enumerate(each)] for each in factors]
        self._chosen = np.array(chosen).T.copy()
        self._choice = np.zeros((len(levels), count))
        self._choice[self._chosen, np.arange(count)] = 1.0
        # The last row is WIDE, which no hypothesis changes.
        self._weights = np.ones((rows + 1, count))
        self._columns = np.empty((4, rows))
        self._products = np.empty((10, rows + 1))
        self._products[:, rows] = np.diag([WIDE, WIDE, WIDE, 0.0])[_UPPER[4]]
        self._normal: Floats = np.zeros((10, count))

    def evaluate(self, z: Floats, h: Floats, variance: Floats, size: Floats) -> Floats:
        """Logarithms of the likelihoods, shape (K,), up to a constant that all share.

        Args:
            z: Shape (M,).
            h: Shape (M, 3).
            variance: Without a fault, shape (M,).
            size: What the factors of the spread are shares of, shape (M,).
        """
        levels = (size * size).take(self._row)
        levels *= self._factor
        levels += variance.take(self._row)
        weight = np.reciprocal(levels)
        weights, columns, products = self._weights, self._columns, self._products
        # Written straight to its place; without "clip", numpy would write to a copy first.
        weight.take(self._chosen, out=weights[:-1], mode="clip")
        columns[:3] = h.T
        columns[3] = z
        left, right = _UPPER[4]
        np.multiply(columns.take(left, 0), columns.take(right, 0), out=products[:, :-1])
        one = self._normal = products.dot(weights)
        two = _eliminate(one, 4)
        three = _eliminate(two, 3)
        costs: Floats = np.log(levels).dot(self._choice)
        costs += np.log(one[0] * two[0] * three[0])
        costs += three[2] - three[1] ** 2 / three[0]
        costs *= -0.5
        return costs

    def covariance(self) -> Floats:
        """Of the twist if nothing is wrong, from the last evaluation, shape (3, 3)."""
        a, b, c, _, d, e, _, f, _, _ = self._normal[:, 0].tolist()
        # By cofactors: LAPACK takes longer to be called than this.
        p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
        s, t, u = a * f - c * c, b * c - a * e, a * d - b * b
        cofactors = np.array(((p, q, r), (q, s, t), (r, t, u)))
        return np.asarray(cofactors / (a * p + b * q + c * r))

    def right(self) -> Floats:
        """Hᵀ R⁻¹ z if nothing is wrong, from the last evaluation."""
        return self._normal[[3, 6, 8], 0]


def _eliminate(matrices: Floats, size: int) -> Floats:
    """What the first row and column leave of symmetric matrices, whose upper triangles are given,
    shape (size · (size + 1) / 2, K)."""
    first = matrices[1:size]
    share = first / matrices[0]
    row, column = _UPPER[size - 1]
    taken = share.take(row, 0)
    taken *= first.take(column, 0)
    return np.asarray(matrices[size:] - taken)
