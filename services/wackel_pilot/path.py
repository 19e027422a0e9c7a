"""Paths as twists over time, pure: m/s, m/s and rad/s in the robot's own frame, time in s.

A robot starts from rest and gains speed evenly. Every path is smooth, so that wheels can follow
with their steering.
"""

import math
from collections.abc import Callable
from random import Random

Twist = tuple[float, float, float]
Path = Callable[[float], Twist]
"""Twist at a time since the start; at rest before."""

_BLEND = 0.1
"""Share of a loop over which its curvature passes into that of the next."""
_WAVES = 3
"""In each component of a random path."""


def circle(speed: float, radius: float, acceleration: float) -> Path:
    """Round and round, to the left; a negative radius goes to the right."""

    def at(time_s: float) -> Twist:
        now, _ = ramp(time_s, speed, acceleration)
        return now, 0.0, now / radius

    return at


def eight(speed: float, radius: float, acceleration: float) -> Path:
    """Loops to the left and to the right in turns."""
    loop = 2 * math.pi * abs(radius)

    def at(time_s: float) -> Twist:
        now, way = ramp(time_s, speed, acceleration)
        number, into = divmod(way / loop + 0.5 * _BLEND, 1.0)
        side = 1.0 if number % 2 == 0 else -1.0
        if number > 0 and into < _BLEND:
            side *= -math.cos(math.pi * into / _BLEND)
        return now, 0.0, side * now / radius

    return at


def wander(speed: float, radius: float, acceleration: float, seed: int) -> Path:
    """Never the same: mostly forward, also sideways where the drive can, with turns of radius or
    wider."""
    random = Random(f"{seed}/wander")
    along, across, turn = (_waves(random) for _ in range(3))

    def at(time_s: float) -> Twist:
        now, _ = ramp(time_s, speed, acceleration)
        return (
            now * (0.7 + 0.3 * along(time_s)),
            0.4 * now * across(time_s),
            now / radius * turn(time_s),
        )

    return at


def ramp(time_s: float, speed: float, acceleration: float) -> tuple[float, float]:
    """Speed and way after this time, from rest, at even acceleration until it is reached."""
    if time_s <= 0.0:
        return 0.0, 0.0
    full_s = abs(speed) / acceleration
    if time_s < full_s:
        now = speed * time_s / full_s
        return now, abs(now) * time_s / 2
    return speed, abs(speed) * (time_s - full_s / 2)


def _waves(random: Random) -> Callable[[float], float]:
    """Something smooth between -1 and 1 that does not repeat."""
    waves = [(random.uniform(0.3, 1.2), random.uniform(-math.pi, math.pi)) for _ in range(_WAVES)]

    def at(time_s: float) -> float:
        return sum(math.sin(rate * time_s + phase) for rate, phase in waves) / _WAVES

    return at
