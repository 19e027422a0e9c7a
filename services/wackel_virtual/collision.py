"""Two servos that answer at once: what a receiver makes of their bits."""

from bisect import bisect_right
from functools import lru_cache

BITS = 10
"""Of a byte on the wire: start, eight data bits from the lowest, stop."""
_NUDGE = 1e-6  # of a bit; what is just behind an edge


def superposed(first: bytes, second: bytes, later: float) -> bytes:
    """The bytes that a receiver reads from two senders on one line.

    Assumptions: a driver that pulls the line low wins over one that holds it high; the receiver
    samples each bit in its middle, and passes on a byte without stop bit, too.

    Args:
        first: Of the sender that begins.
        second: Of the other one.
        later: How much later that one begins, in bits; 0 or more.
    """
    line = _Line(first, second, later)
    received = bytearray()
    start = line.falls(-1.0)
    while start is not None:
        received.append(sum(line.high(start + 1.5 + bit) << bit for bit in range(8)))
        start = line.falls(start + BITS - 0.5)
    return bytes(received)


class _Line:
    """Levels over time, in bits."""

    def __init__(self, first: bytes, second: bytes, later: float) -> None:
        self._first = [level for byte in first for level in _levels(byte)]
        self._second = [level for byte in second for level in _levels(byte)]
        self._later = later
        own = range(len(self._first) + 1)
        others = (later + bit for bit in range(len(self._second) + 1))
        self._edges = sorted({*map(float, own), *others})

    def high(self, at: float) -> bool:
        """Whether neither pulls it low."""
        return _level(self._first, at) and _level(self._second, at - self._later)

    def falls(self, after: float) -> float | None:
        """When it next goes from high to low; None if it never does."""
        was_high = self.high(after)
        for edge in self._edges[bisect_right(self._edges, after) :]:
            high = self.high(edge + _NUDGE)
            if was_high and not high:
                return edge
            was_high = high
        return None


def _level(levels: list[bool], at: float) -> bool:
    return levels[int(at)] if 0 <= at < len(levels) else True


@lru_cache(maxsize=256)
def _levels(byte: int) -> tuple[bool, ...]:
    return (False, *(bool(byte >> bit & 1) for bit in range(8)), True)
