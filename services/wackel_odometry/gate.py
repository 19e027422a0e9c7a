"""Which measurements to believe: each is held against the prediction and all the others."""

from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotrf, dpotri

from wackel_kinematics.array import Bools, Floats

GATE = 16.0
"""Square of the 4 standard deviations at which a measurement is rejected (facts: y² < 16 S): of
normal ones, 6 in 100 000."""


class Verdict(NamedTuple):
    """What the gates say; shapes (m,).

    Attributes:
        accepted: Whether each is believed.
        innovation: How far it is from what prediction and the other accepted ones say of it.
        sigma: Standard deviation that this should have.
    """

    accepted: Bools
    innovation: Floats
    sigma: Floats


def gate(innovation: Floats, spread: Floats, variance: Floats) -> Verdict:
    """Judges measurements that were made at the same time.

    With S = H P Hᵀ + R, what measurement i says beyond the prediction and all others is
    (S⁻¹ y)_i / (S⁻¹)_ii with variance 1 / (S⁻¹)_ii: so a wheel that slips stands out against the
    other wheels, even where the prediction alone leaves much open. The worst is taken out until
    the rest agree.

    Args:
        innovation: Measurements less what is predicted, y, shape (m,).
        spread: Covariance of what is predicted of them, H P Hᵀ, shape (m, m).
        variance: Of the measurements, diagonal of R, shape (m,).
    """
    s = spread.copy()
    s.reshape(-1)[:: len(s) + 1] += variance
    alone, sigma = all_alone, all_sigma = _left_out(s, innovation)
    accepted = np.array([True] * len(innovation), dtype=np.bool_)
    while (worst := _worst(alone, sigma)) is not None:
        accepted[accepted.nonzero()[0][worst]] = False
        kept = accepted.nonzero()[0]
        alone, sigma = _left_out(s[np.ix_(kept, kept)], innovation[kept])
        all_alone[kept], all_sigma[kept] = alone, sigma
    return Verdict(accepted, all_alone, all_sigma)


def _worst(alone: Floats, sigma: Floats) -> int | None:
    """Which is the farthest off; ``None`` if none is beyond the gate."""
    if not len(alone):
        return None
    off = np.abs(alone / sigma)
    at = int(off.argmax())
    return at if off[at] ** 2 > GATE else None


def _left_out(s: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Innovation of each given all others, and its standard deviation."""
    if not len(y):
        return np.zeros(0), np.zeros(0)
    # LAPACK without numpy's or scipy's checks, which take longer than a matrix of this size.
    factor, _ = dpotrf(s, lower=True)
    lower, _ = dpotri(factor, lower=True)
    own = lower.diagonal()
    # dsymv reads the lower triangle only.
    return dsymv(1.0, lower, y, lower=True) / own, 1.0 / np.sqrt(own)
