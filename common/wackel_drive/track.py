"""What one sensor said about an angle, over time: a servo's position and velocity, or a gyro.

Between two samples the angle is taken to change evenly. A servo's counter shows a wheel's angle
only up to whole turns (it wraps, and starts anew with the servo), so differences are taken to the
nearest turn that the velocity allows.
"""

import math
from bisect import bisect_left
from typing import Literal

Arrival = Literal["kept", "reordered", "repeated", "late", "flood"]
Sample = tuple[int, float | None, float | None]
"""Stamp, angle, rate."""

TURN = 2 * math.pi
_HALF = math.pi
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

    __slots__ = ("_samples", "newest", "present")

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
        samples = self._samples
        if not samples or samples[-1][0] < stamp:
            return None
        return samples[bisect_left(samples, (stamp,))][0]

    def pass_by(self, begin: int, end: int) -> tuple[float | None, float | None]:
        """A step passes; what none after it needs is dropped.

        Returns:
            The angle at its begin, up to whole turns, and what is turned until its end, rad;
            ``None`` where samples do not cover it, and for the angle where only rates are known.
        """
        samples = self._samples
        if len(samples) > 1 and samples[0][0] == begin:
            # Usual: the servo whose samples make the steps, and all that are read with it.
            if samples[1][0] == end:
                before = samples.pop(0)
                return before[1], _between(before, samples[0])
            if len(samples) > 2 and samples[2][0] == end:
                before, middle, after = samples[:3]
                one, other = _between(before, middle), _between(middle, after)
                if one is not None and other is not None:
                    del samples[:2]
                    return before[1], one + other
        at = bisect_left(samples, (begin + 1,)) - 1  # the last that is not after it
        if at < 0 or samples[-1][0] < end:
            self.forget(end)
            return None, None
        after = samples[at]
        angle, turned = after[1], 0.0
        while after[0] < end:
            at += 1
            before, after = after, samples[at]
            part = _between(before, after)
            if part is None:
                self.forget(end)
                return None, None
            low, high = before[0], after[0]
            if low < begin or high > end:
                if low < begin and angle is not None:
                    angle += part * ((begin - low) / (high - low))
                part *= (min(high, end) - max(low, begin)) / (high - low)
            turned += part
        del samples[: at if after[0] == end else at - 1]
        return angle, turned

    def forget(self, before: int) -> None:
        """Drops samples that times from ``before`` on do not need."""
        samples = self._samples
        if len(samples) > 1 and samples[1][0] <= before:
            del samples[: bisect_left(samples, (before + 1,)) - 1]  # to the last not after it

    def clear(self) -> None:
        """Drops all: the next sample is an offset, not a motion."""
        self.newest = None
        self.present = False
        self._samples.clear()


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
    off = change if told is None else change - told
    return change if -_HALF < off < _HALF else change - TURN * round(off / TURN)
