"""The last seconds of each wheel, to call a fault by its row of the paper's table 1."""

import math
from collections import deque
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from wackel_diagnoser.constants import Shown
from wackel_diagnoser.rows import Rows
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


class _Kept(msgspec.Struct, frozen=True, gc=False):
    """What is looked at of a step: all of it for seconds would be more than a cache holds, and to
    let go of it then takes long.

    Attributes:
        end: Stamp, UTC ns.
        heading: Which wheels showed, rad.
        told: And should have had.
        speed: At which they should have rolled, m/s, of each roll row.
        z: What rows measured, shape (M,).
    """

    end: int
    heading: list[float]
    told: list[float]
    speed: list[float]
    z: Floats


class History:
    """The last :data:`MOST_STEPS` steps.

    Args:
        rows: How their measurements are numbered.
    """

    def __init__(self, rows: Rows) -> None:
        self._first_roll = rows.rolls.start
        self._steps: deque[_Kept] = deque(maxlen=MOST_STEPS)

    def add(self, shown: Shown) -> None:
        """The newest."""
        step, target = shown.step, shown.target
        kept = _Kept(step.end, step.heading, target.heading, target.speed, shown.measured.z)
        self._steps.append(kept)

    def standing_share(self, roll: int, since: int) -> float | None:
        """Share of the time in which a wheel stood though it should roll; ``None``: unknown."""
        driven = stood = 0
        for each in self._since(since):
            should = abs(each.speed[roll])
            if should > DRIVING_M_S:
                driven += 1
                stood += abs(float(each.z[self._first_roll + roll])) < STANDING * should
        return stood / driven if driven else None

    def steering_frozen(self, wheel: int, since: int) -> bool:
        """Whether a steering stood although it was told to move."""
        told = [each.told[wheel] for each in self._since(since)]
        shown = [each.heading[wheel] for each in self._since(since)]
        if not told:
            return False
        moved, followed = _spread(told), _spread(shown)
        return moved > MOVED_RAD and followed < min(FROZEN_RAD, 0.3 * moved)

    def off(self, wheel: int, since: int) -> float:
        """Mean of how far a steering stands off its reference, rad; 0 if unknown."""
        apart = [each.heading[wheel] - each.told[wheel] for each in self._since(since)]
        known = [each for each in apart if math.isfinite(each)]
        return sum(known) / len(known) if known else 0.0

    def _since(self, since: int) -> Iterator[_Kept]:
        """Those that ended at a stamp or after it."""
        return (each for each in self._steps if each.end >= since)


def _spread(values: Sequence[float]) -> float:
    series = np.array(values)
    series = series[np.isfinite(series)]
    return float(np.ptp(series)) if len(series) else 0.0
