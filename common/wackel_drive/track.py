"""What one sensor said about an angle, over time: a servo's position and velocity, or a gyro.

Between two samples the angle is taken to change evenly. A servo's counter shows a wheel's angle
only up to whole turns (it wraps, and starts anew with the servo), so differences are taken to the
nearest turn that the velocity allows.
"""

import math
from bisect import bisect_left, bisect_right
from typing import Literal

Arrival = Literal["kept", "reordered", "repeated", "late", "flood"]

TURN = 2 * math.pi
LONGEST_GAP_NS = 250_000_000
"""Between samples further apart nothing is known: a wheel may have been reversed meanwhile."""
MOST = 1024
"""Samples that wait for a step; a gyro at 1 kHz leaves 50 in the longest wait."""


class Track:
    """Samples of one angle that are still needed, by stamp.

    Attributes:
        newest: Stamp of the newest sample; ``None`` before the first.
        present: Whether a sample is worth waiting for: false until the first, and, set by who has
            waited in vain, until the next.
    """

    def __init__(self) -> None:
        self.newest: int | None = None
        self.present = False
        self._stamps: list[int] = []
        self._angles: list[float | None] = []
        self._rates: list[float | None] = []

    def add(self, stamp: int, angle: float | None, rate: float | None, done: int) -> Arrival:
        """Takes in a sample.

        Args:
            stamp: ns.
            angle: rad, up to whole turns; ``None`` where only a rate is measured.
            rate: rad/s.
            done: Up to where steps have been made, ns.

        Returns:
            ``kept``; ``reordered``: kept, though a newer one was there already; not kept:
            ``repeated``: one of this stamp is there; ``late``: the steps that it belongs to have
            been made; ``flood``: too many wait.
        """
        stamps = self._stamps
        newest = self.newest
        if newest is None or stamp > newest:
            if len(stamps) >= MOST:
                return "flood"
            self.newest = stamp
            self.present = True
            stamps.append(stamp)
            self._angles.append(angle)
            self._rates.append(rate)
            return "kept"
        at = bisect_left(stamps, stamp)
        if at < len(stamps) and stamps[at] == stamp:
            return "repeated"
        if stamp <= done:
            return "late"
        if len(stamps) >= MOST:
            return "flood"
        stamps.insert(at, stamp)
        self._angles.insert(at, angle)
        self._rates.insert(at, rate)
        return "reordered"

    def after(self, stamp: int) -> int | None:
        """Stamp of the first sample at or after a time; ``None`` if there is none."""
        at = bisect_left(self._stamps, stamp)
        return self._stamps[at] if at < len(self._stamps) else None

    def turned(self, begin: int, end: int) -> float | None:
        """Angle turned between two times, rad; ``None`` where samples do not cover them."""
        stamps = self._stamps
        if len(stamps) > 1 and stamps[0] == begin and stamps[1] == end:
            return self._between(0, end - begin)
        first = bisect_right(stamps, begin) - 1
        last = bisect_left(stamps, end)
        if first < 0 or last >= len(stamps):
            return None
        total = 0.0
        for k in range(first, last):
            low, high = stamps[k], stamps[k + 1]
            turned = self._between(k, high - low)
            if turned is None:
                return None
            if low < begin or high > end:
                turned *= (min(high, end) - max(low, begin)) / (high - low)
            total += turned
        return total

    def angle(self, at: int) -> float | None:
        """The angle at a time, rad, up to whole turns; ``None`` where samples do not cover it."""
        stamps = self._stamps
        if stamps and stamps[0] == at:
            return self._angles[0]
        k = bisect_right(stamps, at) - 1
        if k < 0:
            return None
        angle = self._angles[k]
        if angle is None or stamps[k] == at:
            return angle
        turned = self.turned(stamps[k], at)
        return None if turned is None else angle + turned

    def forget(self, before: int) -> None:
        """Drops samples that times from ``before`` on do not need."""
        stamps = self._stamps
        if len(stamps) > 1 and stamps[1] <= before:
            needless = bisect_right(stamps, before) - 1
            del self._stamps[:needless], self._angles[:needless], self._rates[:needless]

    def clear(self) -> None:
        """Drops all: the next sample is an offset, not a motion."""
        self.newest = None
        self.present = False
        self._stamps.clear()
        self._angles.clear()
        self._rates.clear()

    def _between(self, k: int, ns: int) -> float | None:
        """Angle turned from sample k to the next."""
        if ns > LONGEST_GAP_NS:
            return None
        rate, next_rate = self._rates[k], self._rates[k + 1]
        told = None if rate is None or next_rate is None else (rate + next_rate) * 0.5e-9 * ns
        angle, next_angle = self._angles[k], self._angles[k + 1]
        if angle is None or next_angle is None:
            return told
        change = next_angle - angle
        return change - TURN * round((change - (told or 0.0)) / TURN)
