"""The chain of cables: who is connected with whom, who has power, and at which voltage.

Servos are numbered by their position, 0 next to the adapter. Cable ``k`` leads to servo ``k``, from
servo ``k - 1`` or, for ``k = 0``, from the adapter. Every cable carries data and power.
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import accumulate
from operator import mul
from typing import Literal

Feed = Literal["adapter", "far", "both"]

CABLE_OHM = 0.05
"""Of one cable: 2 x 0.2 m of 0.3 mm² copper (0.02 Ω) and four crimp contacts of some 8 mΩ."""
OPEN_OHM = 1e9
"""Of a cable that does not connect."""


class Chain:
    """Which cables are open, and what follows from it.

    Attributes:
        size: Servos.
        feed: Where supply enters.
        near: Servos before this position are connected with the adapter.
        powered: For each servo whether supply reaches it.
    """

    def __init__(self, size: int, feed: Feed) -> None:
        self.size = size
        self.feed: Feed = feed
        self._open: frozenset[int] = frozenset()
        self.near = size
        self.powered = [True] * size

    def set(self, open_cables: Collection[int], *, supplied: bool) -> None:
        """Take over the state of the cables and of the supply."""
        self._open = frozenset(open_cables)
        self.near = min(self._open, default=self.size)
        last = max(self._open, default=0)
        self.powered = [
            supplied
            and (
                (self.feed != "far" and position < self.near)
                or (self.feed != "adapter" and position >= last)
            )
            for position in range(self.size)
        ]

    def joined(self, one: int, other: int) -> bool:
        """Whether two servos hear each other."""
        if not self._open:
            return True
        first, last = min(one, other), max(one, other)
        return not any(first < cable <= last for cable in self._open)

    def answering(self) -> bool:
        """Whether any servo that the adapter is connected with has power."""
        return any(self.powered[: self.near])


def voltages(
    supply: float, feed: Feed, currents: Sequence[float], extra_ohm: Mapping[int, float]
) -> list[float]:
    """Voltage at each servo.

    Args:
        supply: V where it enters.
        feed: Where it enters.
        currents: What each servo draws, A.
        extra_ohm: Contact resistance of cables beyond :data:`CABLE_OHM`, by position.

    Returns:
        V, by position. Kirchhoff's rules on a ladder of resistors.
    """
    ohms = [CABLE_OHM + extra_ohm.get(cable, 0.0) for cable in range(len(currents))] + [CABLE_OHM]
    taken = list(accumulate(currents, initial=0.0))  # by the servos before each cable
    if feed == "adapter":
        entering = taken[-1]
    elif feed == "far":
        entering = 0.0
    else:
        # Both ends have the same voltage: the drops from one to the other cancel out.
        entering = sum(map(mul, ohms, taken)) / sum(ohms)
    # Through a cable flows what enters at the adapter less what the servos before it have taken.
    drops = [ohm * (entering - before) for ohm, before in zip(ohms, taken, strict=True)]
    start = supply + sum(drops) if feed == "far" else supply
    return [start - drop for drop in accumulate(drops[:-1])]
