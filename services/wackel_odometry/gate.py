"""Which measurements to believe: each is held against the prediction and all the others."""

import math
from operator import mul, truediv

import numpy as np
from msgspec import Struct

from wackel_kinematics.array import Floats
from wackel_odometry.filter import whitening

GATE = 16.0
"""Square of the 4 standard deviations at which a measurement is rejected (facts: y² < 16 S): of
normal ones, 6 in 100 000."""
CHANCE = 2.0
"""Standard deviations of their squares by which measurements may contradict each other by chance,
without anything that pulls."""
LEAST_OWN = 1e-30
"""One over a variance of nothing that is measured; less is rounding, and would be no number."""
TOLD = 3
"""Numbers of a twist, which measurements decide themselves: the prediction leaves them open."""


class Verdict(Struct, frozen=True, gc=False):
    """What the gates say of each of m measurements.

    Single numbers: for some measurements, Python is faster with them than numpy.

    Attributes:
        accepted: Whether each is believed.
        innovation: How far it is from what prediction and the other accepted ones say of it.
        sigma: Standard deviation that this should have.
        pulled: By how much larger all variances are than expected, as a factor, for measurements
            contradict each other; at least 1.
    """

    accepted: list[bool]
    innovation: list[float]
    sigma: list[float]
    pulled: float = 1.0


def gate(
    innovation: Floats,
    spread: Floats,
    noise: Floats,
    *,
    before: float = 1.0,
    most: float = 1.0,
) -> Verdict:
    """Judges measurements that were made at the same time.

    With S = H P Hᵀ + R, what measurement i says beyond the prediction and all others is
    (S⁻¹ y)_i / (S⁻¹)_ii with variance 1 / (S⁻¹)_ii: so a wheel that slips stands out against the
    other wheels, even where the prediction alone leaves much open. The worst is taken out until
    the rest agree.

    Where wheels may pull each other, all contradict each other a little, and none should be taken
    out for that. Without measurement i, the others contradict prediction and each other by
    yᵀ S⁻¹ y less the square of what i says beyond them by its variance: what is left of that
    without the one that stands out most is by how much larger variances are, if it may be so much.

    Args:
        innovation: Measurements less what is predicted, y, shape (m,).
        spread: Covariance of what is predicted of them, H P Hᵀ, shape (m, m).
        noise: Of their errors, R, shape (m, m).
        before: By how much larger variances have been of late, as a factor.
        most: And at most may be.
    """
    s = spread + noise
    told = _left_out(s, innovation)
    alone, own, count = told.alone, told.own, len(innovation)
    pulled = 1.0
    if most > 1.0 and (spare := count - 1 - TOLD) > 0:
        left = (float(innovation.dot(told.weight)) - told.farthest) / spare
        if left < 1.0 + CHANCE * math.sqrt(2.0 / spare):
            left = 1.0
        pulled = max(min(max(left, before), most), 1.0)
    accepted, limit = [True] * count, GATE * pulled
    if told.farthest > limit:
        kept = list(range(count))
        while told.farthest > limit:
            accepted[kept.pop(told.squares.index(told.farthest))] = False
            told = _left_out(s[np.ix_(kept, kept)], innovation[kept])
            for at, apart, known in zip(kept, told.alone, told.own, strict=True):
                alone[at], own[at] = apart, known
    return Verdict(accepted, alone, [math.sqrt(pulled / each) for each in own], pulled)


class _LeftOut(Struct, frozen=True, gc=False):
    """What measurements say beyond all others.

    Attributes:
        weight: S⁻¹ y, shape (m,).
        own: Diagonal of S⁻¹: one over the variance of the next.
        alone: Innovation of each given all others.
        squares: Of these by their variances.
        farthest: The greatest of them; 0 if there is none.
    """

    weight: Floats
    own: list[float]
    alone: list[float]
    squares: list[float]
    farthest: float


def _left_out(s: Floats, y: Floats) -> _LeftOut:
    if not len(y):
        return _LeftOut(y, [], [], [], 0.0)
    white = whitening(s)
    inverse = white.T.dot(white)
    weight = inverse.dot(y)
    weights = weight.tolist()
    own: list[float] = inverse.diagonal().tolist()
    if min(own) < LEAST_OWN:
        own = [max(each, LEAST_OWN) for each in own]
    alone = [*map(truediv, weights, own)]
    squares = [*map(mul, weights, alone)]
    return _LeftOut(weight, own, alone, squares, max(squares))
