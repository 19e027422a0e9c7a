"""The last seconds of each wheel, to call a fault by its row of the paper's table 1."""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wackel_diagnoser.reference import Target
from wackel_kinematics.array import Floats

STANDING = 0.1
"""Share of its commanded speed below which a wheel stands."""
DRIVING_M_S = 0.03
"""Commanded speed below which that cannot be told."""
BLOCKED = 0.93
"""Share of the time from which on a wheel is blocked for good."""
STICKING = 0.15
"""And now and then."""
FROZEN_RAD = 0.009
"""Half a degree: less than a steering that follows moves when the command moves by MOVED_RAD."""
MOVED_RAD = 0.02
MOST_STEPS = 300


class Moment(NamedTuple):
    """One step of all wheels.

    Attributes:
        end: Stamp.
        heading: Measured, rad, shape (n,).
        rolled: Measured, m/s, by roll row.
        target: What they should have done.
    """

    end: int
    heading: Floats
    rolled: Floats
    target: Target


class History:
    """The last :data:`MOST_STEPS` steps."""

    def __init__(self) -> None:
        self._moments: deque[Moment] = deque(maxlen=MOST_STEPS)

    def add(self, moment: Moment) -> None:
        """The newest."""
        self._moments.append(moment)

    def standing_share(self, roll: int, since: int) -> float | None:
        """Share of the time in which a wheel stood though it should roll; ``None``: unknown."""
        driven = stood = 0
        for moment in self._moments:
            should = abs(moment.target.speed[roll])
            if moment.end >= since and should > DRIVING_M_S:
                driven += 1
                stood += abs(float(moment.rolled[roll])) < STANDING * should
        return stood / driven if driven else None

    def steering_frozen(self, wheel: int, since: int) -> bool:
        """Whether a steering stood although it was told to move."""
        told = [m.target.heading[wheel] for m in self._moments if m.end >= since]
        shown = [float(m.heading[wheel]) for m in self._moments if m.end >= since]
        if not told:
            return False
        moved, followed = _spread(told), _spread(shown)
        return moved > MOVED_RAD and followed < min(FROZEN_RAD, 0.3 * moved)

    def off(self, wheel: int, since: int) -> float:
        """Mean of how far a steering stands off its reference, rad; 0 if unknown."""
        apart = [
            float(m.heading[wheel] - m.target.heading[wheel])
            for m in self._moments
            if m.end >= since
        ]
        known = [each for each in apart if math.isfinite(each)]
        return sum(known) / len(known) if known else 0.0


def _spread(values: Sequence[float]) -> float:
    series = np.array(values)
    series = series[np.isfinite(series)]
    return float(np.ptp(series)) if len(series) else 0.0
