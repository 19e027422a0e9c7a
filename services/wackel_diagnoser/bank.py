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

from wackel_kinematics.array import Floats, cofactors

WIDE = 1e-4
"""One over the variance of the twist before anything is measured: 100 m/s, 100 rad/s. It keeps the
algebra regular where rows are missing, and is nothing beside any row."""

_ROW, _COLUMN = (each + 1 for each in np.triu_indices(3))
"""Of each element of the upper triangle without its first row."""
_NONE = np.zeros(len(_ROW), dtype=np.intp)
_LEFT = np.concatenate((_NONE, _NONE, _NONE, _ROW))
_RIGHT = np.concatenate((_NONE, _ROW, _COLUMN, _COLUMN))
"""The products that are summed. For each of those elements: the first pivot, what eliminates the
first row, by the element's row and by its column, and the element. Some stand there several times,
which costs less than to put them in their places afterwards."""
_PIVOTS, _BY_ROW, _BY_COLUMN, _REST = (slice(at, at + 6) for at in (0, 6, 12, 18))
_MATRIX, _RIGHT_SIDE = np.array([0, 12, 13, 18, 19, 21]), np.array([14, 20, 22])
"""Where the upper triangle of Hᵀ R⁻¹ H, and Hᵀ R⁻¹ z, stand among them."""
_HALF = np.array(-0.5)  # numpy takes longer for a number of Python's


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
        self._products = np.empty((len(_LEFT), rows + 1))
        self._products[:, rows] = np.diag([WIDE, WIDE, WIDE, 0.0])[_LEFT, _RIGHT]
        self._normal: Floats = np.zeros((len(_LEFT), count))

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
        np.multiply(columns.take(_LEFT, 0), columns.take(_RIGHT, 0), out=products[:, :-1])
        normal = self._normal = products.dot(weights)
        pivots = normal[_PIVOTS]
        taken = normal[_BY_ROW] * normal[_BY_COLUMN]
        taken /= pivots
        rest = normal[_REST] - taken
        # The rows of what is left are d e r, e f s, r s and the costs. Each by itself: numpy takes
        # long to repeat one for several.
        d, e, r, f, s, costs = rest
        share = e / d
        f -= share * e
        s -= share * r
        r *= r
        r /= d
        costs -= r
        s *= s
        s /= f
        costs -= s
        d *= f
        d *= pivots[0]
        costs += np.log(d)
        costs += np.log(levels).dot(self._choice)
        costs *= _HALF
        return np.asarray(costs)

    def covariance(self) -> Floats:
        """Of the twist if nothing is wrong, from the last evaluation, shape (3, 3)."""
        (p, q, r, s, t, u), determinant = cofactors(self._normal[:, 0].take(_MATRIX).tolist())
        return np.array(((p, q, r), (q, s, t), (r, t, u))) / determinant

    def right(self) -> Floats:
        """Hᵀ R⁻¹ z if nothing is wrong, from the last evaluation."""
        return self._normal[:, 0].take(_RIGHT_SIDE)
