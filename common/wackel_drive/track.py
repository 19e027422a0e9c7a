"""What one sensor said about an angle, over time: a servo's position and velocity, or a gyro.

Between two samples the angle is taken to change evenly. A servo's counter shows a wheel's angle
only up to whole turns (it wraps, and starts anew with the servo), so differences are taken to the
nearest turn that the velocity allows.
"""

import math
from bisect import bisect_left
from typing import Literal

Arrival = Literal["kept", "reordered", "repeated", "late", "flood"]
Sample = tuple[int, float | None, float | None, float | None]
"""Stamp, angle, rate, and what was turned since the sample before; ``None`` where not known.

The last is worked out once, on arrival, for two steps need it where a border of theirs lies between
the samples. Of the first sample of a track it means nothing."""

TURN = 2 * math.pi
_HALF = math.pi
LONGEST_GAP_NS = 250_000_000
"""Between samples further apart nothing is known: a wheel may have been reversed meanwhile."""
MOST = 1024
"""Samples that wait for a step; a gyro at 1 kHz leaves 50 in the longest wait."""


class Track:
    """Samples of one angle that are still needed, by stamp.

    Attributes:
        newest: Stamp of the newest sample; minus infinity before the first.
        awaited_from: Samples of later than this are worth waiting for. It is the newest stamp;
            infinity until the first, and, set by who has waited in vain, until the next.
    """

    __slots__ = ("_samples", "awaited_from", "newest")

    def __init__(self) -> None:
        self.newest = -math.inf
        self.awaited_from = math.inf
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
        if stamp > self.newest:
            if len(samples) >= MOST:
                return "flood"
            turned = _between(samples[-1], stamp, angle, rate) if samples else None
            samples.append((stamp, angle, rate, turned))
            self.newest = self.awaited_from = stamp
            return "kept"
        at = bisect_left(samples, (stamp,))
        after, next_angle, next_rate, _ = samples[at]
        if after == stamp:
            return "repeated"
        if stamp <= done:
            return "late"
        if len(samples) >= MOST:
            return "flood"
        turned = _between(samples[at - 1], stamp, angle, rate) if at else None
        sample = stamp, angle, rate, turned
        turned = _between(sample, after, next_angle, next_rate)
        samples[at : at + 1] = sample, (after, next_angle, next_rate, turned)
        return "reordered"

    def shows_angle(self, stamp: int) -> bool:
        """Whether a rate alone has nothing to add at a time, for angles come often enough."""
        if not self._samples:
            return False
        newest, angle = self._samples[-1][:2]
        return angle is not None and stamp - newest <= LONGEST_GAP_NS

    def after(self, stamp: int) -> int | None:
        """Stamp of the first sample at or after a time; ``None`` if there is none."""
        for sample in self._samples:  # It is among the first: steps drop what they have passed.
            if sample[0] >= stamp:
                return sample[0]
        return None

    def pass_by(self, begin: int, end: int) -> tuple[float | None, float | None]:
        """A step, which has some length, passes; what none after it needs is dropped.

        Returns:
            The angle at its begin, up to whole turns, and what is turned until its end, rad;
            ``None`` where samples do not cover it, and for the angle where only rates are known.
        """
        samples = self._samples
        if len(samples) > 1 and samples[0][0] == begin:
            # Usual: the servo whose samples make the steps, and all that are read with it.
            if samples[1][0] == end:
                return samples.pop(0)[1], samples[0][3]
            if len(samples) > 2 and samples[2][0] == end:
                one, other = samples[1][3], samples[2][3]
                if one is not None and other is not None:
                    angle = samples[0][1]
                    del samples[:2]
                    return angle, one + other
        low, angle, turned = begin, None, 0.0
        for at, (high, high_angle, _, part) in enumerate(samples):
            if high <= begin:
                low, angle = high, high_angle
                continue
            if not at or part is None:
                break
            if low < begin or high > end:
                if low < begin and angle is not None:
                    angle += part * ((begin - low) / (high - low))
                until, since = high if high < end else end, low if low > begin else begin
                turned += part * ((until - since) / (high - low))
            else:
                turned += part
            if high >= end:
                del samples[: at if high == end else at - 1]
                return angle, turned
            low = high
        self.forget(end)
        return None, None

    def forget(self, before: int) -> None:
        """Drops samples that times from ``before`` on do not need."""
        samples = self._samples
        if len(samples) > 1 and samples[1][0] <= before:
            del samples[: bisect_left(samples, (before + 1,)) - 1]  # to the last not after it

    def clear(self) -> None:
        """Drops all: the next sample is an offset, not a motion."""
        self.newest = -math.inf
        self.awaited_from = math.inf
        self._samples.clear()


def _between(before: Sample, stamp: int, angle: float | None, rate: float | None) -> float | None:
    """Angle turned from one sample to the next."""
    last, last_angle, last_rate, _ = before
    ns = stamp - last
    if ns > LONGEST_GAP_NS:
        return None
    told = None if last_rate is None or rate is None else (last_rate + rate) * 0.5e-9 * ns
    if last_angle is None or angle is None:
        return told
    change = angle - last_angle
    off = change if told is None else change - told
    return change if -_HALF < off < _HALF else change - TURN * round(off / TURN)
