"""Likelihoods of all hypotheses for one step, in one go.

For each hypothesis h with variances R_h = R + Q_h of the rows z = H ξ + noise, the unknown twist ξ
is integrated out::

    ln p(z | h) = −½ [Σ ln R_h + ln det(Hᵀ R_h⁻¹ H) + min_ξ Σ (z − H ξ)² / R_h] + constant

Rows that are no rows on ξ (steering and rolling against their references) have H = 0. Only 3 × 3
algebra, on all hypotheses at once; singular configurations need no special case, for what the rows
do not determine costs every hypothesis the same.
"""

import numpy as np

from wackel_kinematics.array import Floats

WIDE = 1e-4
"""One over the variance of the twist before anything is measured: 100 m/s, 100 rad/s. It keeps the
algebra regular where rows are missing, and is nothing beside any row."""

# The upper triangle of a symmetric 3 × 3 matrix, and of its cofactors, in this order.
_I, _J = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])
# 00 = df − ee, 01 = ce − bf, 02 = be − cd, 11 = af − cc, 12 = bc − ae, 22 = ad − bb
_P, _Q = np.array([3, 2, 1, 0, 1, 0]), np.array([5, 4, 4, 5, 2, 3])
_S, _T = np.array([4, 1, 2, 2, 0, 1]), np.array([4, 5, 3, 2, 4, 1])
_TWICE = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])[:, None]
_DIAGONAL = np.array([0, 3, 5])


class Bank:
    """Evaluates hypotheses.

    Args:
        spread: Squares of the factors by which each widens each row, shape (K, M).
    """

    def __init__(self, spread: Floats) -> None:
        self._spread = spread
        count, rows = spread.shape
        self._products = np.empty((rows, 10))
        self._widened = np.empty_like(spread)
        self._weight = np.empty_like(spread)
        self._cofactors: Floats = np.zeros((6, count))
        self._det: Floats = np.ones(count)
        self._right: Floats = np.zeros((3, count))

    def evaluate(self, z: Floats, h: Floats, variance: Floats, size: Floats) -> Floats:
        """Logarithms of the likelihoods, shape (K,), up to a constant that all share.

        Args:
            z: Shape (M,).
            h: Shape (M, 3).
            variance: Without a fault, shape (M,).
            size: What the factors of the spread are shares of, shape (M,).
        """
        ratio = np.multiply(self._spread, size * size / variance, out=self._widened)
        ratio += 1.0
        inverse = 1.0 / variance
        weight = np.divide(inverse, ratio, out=self._weight)
        products = self._products
        np.multiply(h[:, _I], h[:, _J], out=products[:, :6])
        np.multiply(h, z[:, None], out=products[:, 6:9])
        np.multiply(z, z, out=products[:, 9])
        sums = (weight @ products).T
        normal = sums[:6]
        normal[_DIAGONAL] += WIDE
        right = sums[6:9]
        cofactors = normal[_P] * normal[_Q]
        cofactors -= normal[_S] * normal[_T]
        det: Floats = (normal[:3] * cofactors[:3]).sum(axis=0)
        explained = (right[_I] * right[_J] * cofactors * _TWICE).sum(axis=0) / det
        np.log(ratio, out=ratio)
        costs: Floats = ratio.sum(axis=1)
        costs += np.log(det)
        costs += sums[9]
        costs -= explained
        costs *= -0.5
        self._cofactors, self._det, self._right = cofactors, det, right
        return costs

    def covariance(self) -> Floats:
        """Of the twist if nothing is wrong, from the last evaluation, shape (3, 3)."""
        a, b, c, d, e, f = (self._cofactors[:, 0] / self._det[0]).tolist()
        return np.array(((a, b, c), (b, d, e), (c, e, f)))

    def right(self) -> Floats:
        """Hᵀ R⁻¹ z if nothing is wrong, from the last evaluation."""
        right: Floats = self._right[:, 0]
        return right
