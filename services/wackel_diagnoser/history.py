"""The last seconds of each wheel, to call a fault by its row of the paper's table 1."""

import math
from struct import Struct

import numpy as np

from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import Measured
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
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


class History:
    """The last :data:`MOST_STEPS` steps, as numbers side by side.

    The lists that steps bring would take eight times the memory. What lives for seconds pushes out
    of the processor's nearest memory what the next step needs.

    What it is asked is of the steps that ended at a stamp ``since``, UTC ns, or after it; wheels
    and roll rows are numbered as the drive's.

    Args:
        layout: The drive.
    """

    def __init__(self, layout: Layout) -> None:
        n, rolls = layout.drive.n, len(layout.drive.roll_wheels)
        # The first column of each kind, after the stamp.
        self._heading, self._told, self._speed = 1, 1 + n, 1 + 2 * n
        self._rolled = self._speed + rolls
        step = Struct(f"{1 + 2 * n + 2 * rolls}d")
        self._pack_into, self._size = step.pack_into, step.size
        # Those that have not been yet ended before all others.
        self._buffer, self._at = bytearray(np.full((MOST_STEPS, step.size // 8), -math.inf)), 0

    def add(self, step: Step, target: Target, measured: Measured) -> None:
        """The newest.

        Args:
            step: What the sensors said.
            target: What the wheels should have done.
            measured: The rows of that.
        """
        self._pack_into(
            self._buffer,
            self._at,
            step.end,  # as a number it is off by less than a microsecond
            *step.heading,
            *target.heading,
            *target.speed,
            *measured.rolled,
        )
        self._at = (self._at + self._size) % len(self._buffer)

    def standing_share(self, roll: int, since: int) -> float | None:
        """Share of the time in which a wheel stood though it should roll; ``None``: unknown."""
        speed, rolled = self._since(since, self._speed + roll, self._rolled + roll)
        should = np.abs(speed)
        driven = should > DRIVING_M_S
        count = np.count_nonzero(driven)
        if not count:
            return None
        stood = driven & (np.abs(rolled) < STANDING * should)
        return np.count_nonzero(stood) / count

    def steering_frozen(self, wheel: int, since: int) -> bool:
        """Whether a steering stood although it was told to move."""
        heading, told = self._since(since, self._heading + wheel, self._told + wheel)
        moved, followed = _spread(told), _spread(heading)
        return moved > MOVED_RAD and followed < min(FROZEN_RAD, 0.3 * moved)

    def off(self, wheel: int, since: int) -> float:
        """Mean of how far a steering stands off its reference, rad; 0 if unknown."""
        heading, told = self._since(since, self._heading + wheel, self._told + wheel)
        apart = _known(heading - told)
        return float(apart.mean()) if len(apart) else 0.0

    def _since(self, since: int, *columns: int) -> list[Floats]:
        """Of the k steps that ended at a stamp or after it, in no order, shape (k,) each."""
        steps = np.frombuffer(self._buffer).reshape(MOST_STEPS, -1)
        late = steps[:, 0] >= since
        return [steps[:, column][late] for column in columns]


def _known(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def _spread(values: Floats) -> float:
    known = _known(values)
    return float(np.ptp(known)) if len(known) else 0.0
