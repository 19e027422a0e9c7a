"""What one sensor said about an angle, over time: a servo's position and velocity, or a gyro.

Between two samples the angle is taken to change evenly. A servo's counter shows a wheel's angle
only up to whole turns (it wraps, and starts anew with the servo), so differences are taken to the
nearest turn that the velocity allows.
"""

import math
from bisect import bisect_left, bisect_right
from itertools import pairwise
from operator import itemgetter
from typing import Literal

Arrival = Literal["kept", "reordered", "repeated", "late", "flood"]
Sample = tuple[int, float | None, float | None]
"""Stamp, angle, rate."""
_STAMP = itemgetter(0)

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
        self._samples: list[Sample] = []

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
        samples = self._samples
        newest = self.newest
        if newest is None or stamp > newest:
            if len(samples) >= MOST:
                return "flood"
            self.newest = stamp
            self.present = True
            samples.append((stamp, angle, rate))
            return "kept"
        at = bisect_left(samples, (stamp,))
        if at < len(samples) and samples[at][0] == stamp:
            return "repeated"
        if stamp <= done:
            return "late"
        if len(samples) >= MOST:
            return "flood"
        samples.insert(at, (stamp, angle, rate))
        return "reordered"

    def after(self, stamp: int) -> int | None:
        """Stamp of the first sample at or after a time; ``None`` if there is none."""
        at = bisect_left(self._samples, (stamp,))
        return self._samples[at][0] if at < len(self._samples) else None

    def turned(self, begin: int, end: int) -> float | None:
        """Angle turned between two times, rad; ``None`` where samples do not cover them."""
        samples = self._samples
        if len(samples) > 1:
            before, after = samples[0], samples[1]
            if before[0] == begin and after[0] == end:
                return _between(before, after)
        first = self._at_or_before(begin)
        last = bisect_left(samples, (end,))
        if first < 0 or last >= len(samples):
            return None
        total = 0.0
        for before, after in pairwise(samples[first : last + 1]):
            turned = _between(before, after)
            if turned is None:
                return None
            low, high = before[0], after[0]
            if low < begin or high > end:
                turned *= (min(high, end) - max(low, begin)) / (high - low)
            total += turned
        return total

    def angle(self, at: int) -> float | None:
        """The angle at a time, rad, up to whole turns; ``None`` where samples do not cover it."""
        samples = self._samples
        if samples and samples[0][0] == at:
            return samples[0][1]
        k = self._at_or_before(at)
        if k < 0:
            return None
        stamp, angle, _ = samples[k]
        if angle is None or stamp == at:
            return angle
        turned = self.turned(stamp, at)
        return None if turned is None else angle + turned

    def forget(self, before: int) -> None:
        """Drops samples that times from ``before`` on do not need."""
        samples = self._samples
        if len(samples) > 1 and samples[1][0] <= before:
            del samples[: self._at_or_before(before)]

    def clear(self) -> None:
        """Drops all: the next sample is an offset, not a motion."""
        self.newest = None
        self.present = False
        self._samples.clear()

    def _at_or_before(self, at: int) -> int:
        """Number of the last sample that is not after a time, -1 if there is none."""
        return bisect_right(self._samples, at, key=_STAMP) - 1


def _between(before: Sample, after: Sample) -> float | None:
    """Angle turned from one sample to the next."""
    stamp, angle, rate = before
    next_stamp, next_angle, next_rate = after
    ns = next_stamp - stamp
    if ns > LONGEST_GAP_NS:
        return None
    told = None if rate is None or next_rate is None else (rate + next_rate) * 0.5e-9 * ns
    if angle is None or next_angle is None:
        return told
    change = next_angle - angle
    return change - TURN * round((change - (told or 0.0)) / TURN)
