"""Kinds of driving, as commanded twists: what a fault looks like depends on the motion.

Each kind is a way of drawing legs: a twist, how long the command takes to reach it, and for how
long it then holds. Every kind begins and ends at rest, so that courses can be driven in turn.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from tests.odometry.simulation import random_path
from wackel_kinematics.array import Floats

RATE = 100.0
REST = (0.0, 0.0, 0.0)
USUAL_FRICTION = 0.8
"""For which accelerations are given."""
HARD = 0.8 * 9.81 * USUAL_FRICTION
"""m/s², four fifths of what tyres hold."""
AWAY_M = 0.3
"""Of the wheels from the middle."""


class Leg(NamedTuple):
    """A part of a course.

    Attributes:
        ramp_s: In which the command goes evenly from the last twist to this one; 0: it jumps.
        hold_s: For which it then stays.
        twist: m/s, m/s, rad/s.
    """

    ramp_s: float
    hold_s: float
    twist: tuple[float, float, float]


def _along(speed: float, direction: float, omega: float = 0.0) -> tuple[float, float, float]:
    return speed * math.cos(direction), speed * math.sin(direction), omega


class _Draws:
    """Of one course: random numbers, whether the drive can go sideways, and what its tyres hold."""

    def __init__(self, rng: np.random.Generator, *, sideways: bool, friction: float) -> None:
        self.between = rng.uniform
        self.hold = friction / USUAL_FRICTION
        self._sideways = sideways

    def direction(self) -> float:
        """Of travel, rad."""
        return self.between(-math.pi, math.pi) if self._sideways else math.acos(self.either())

    def either(self) -> float:
        """1 or -1."""
        return math.copysign(1.0, self.between(-1.0, 1.0))


def _circles(draws: _Draws) -> Iterator[Leg]:
    """An even speed on a circle for half a minute."""
    speed, radius = draws.between(0.2, 0.8), draws.between(0.4, 2.0)
    yield Leg(1.0, 30.0, _along(speed, draws.direction(), draws.either() * speed / radius))
    yield Leg(1.0, 1.0, REST)


def _lines(draws: _Draws) -> Iterator[Leg]:
    """Straight on for long, then a turn on the spot."""
    yield Leg(1.0, draws.between(5.0, 20.0), _along(draws.between(0.3, 1.0), draws.direction()))
    yield Leg(0.7, 0.5, REST)
    yield Leg(0.5, 1.0, (0.0, 0.0, draws.either()))
    yield Leg(0.5, 0.5, REST)


def _stop_and_go(draws: _Draws) -> Iterator[Leg]:
    """Off and at rest again every few seconds, three times the same way."""
    speed, direction = draws.between(0.2, 0.8), draws.direction()
    for _ in range(3):
        ramp_s = draws.between(0.3, 1.0)
        yield Leg(ramp_s, draws.between(0.5, 3.0), _along(speed, direction, draws.between(-1, 1)))
        yield Leg(ramp_s, draws.between(0.3, 2.0), REST)


def _shuttle(draws: _Draws) -> Iterator[Leg]:
    """Back and forth without a halt."""
    speed, direction = draws.between(0.2, 0.8), draws.direction()
    omega = draws.between(-0.5, 0.5)
    for sign in (1.0, -1.0) * 4:
        twist = _along(sign * speed, direction, sign * omega)
        yield Leg(draws.between(0.5, 1.5), draws.between(0.5, 4.0), twist)
    yield Leg(0.5, 0.5, REST)


def _on_the_spot(draws: _Draws) -> Iterator[Leg]:
    """Turning about the centre."""
    yield Leg(0.5, draws.between(1.0, 5.0), (0.0, 0.0, draws.either() * draws.between(0.5, 2.5)))
    yield Leg(0.5, draws.between(0.0, 1.0), REST)


def _hard(draws: _Draws) -> Iterator[Leg]:
    """Curves and brakes at up to four fifths of what tyres hold."""
    direction, before = draws.direction(), (0.0, 0.0)
    for _ in range(4):
        speed, across = draws.between(0.6, 1.5), draws.between(2.0, 5.0) * draws.hold
        omega = draws.either() * min(across / speed, 4.0)
        ramp_s = speed / (draws.between(2.0, 4.0) * draws.hold)
        ramp_s = max(ramp_s, _least_s(before, (speed, omega), HARD * draws.hold))
        yield Leg(ramp_s, draws.between(0.3, 1.5), _along(speed, direction, omega))
        before = speed, omega
    yield Leg(max(0.4, _least_s(before, (0.0, 0.0), HARD * draws.hold)), 0.5, REST)


def _least_s(before: tuple[float, float], after: tuple[float, float], most: float) -> float:
    """In which a robot can change from one speed and yaw rate to others, m/s and rad/s, with so
    much acceleration, m/s², of a wheel that has its share of the mass on it."""
    change = math.hypot(after[0] - before[0], AWAY_M * (after[1] - before[1]))
    across = max(abs(speed * omega) for speed, omega in (before, after))
    return change / math.sqrt(most**2 - across**2)


def _jumps(draws: _Draws) -> Iterator[Leg]:
    """Commands that jump, which no steering can follow."""
    for _ in range(4):
        twist = _along(draws.between(0.0, 0.6), draws.direction(), draws.between(-1.0, 1.0))
        yield Leg(0.0, draws.between(0.4, 3.0), twist)
    yield Leg(0.0, 0.5, REST)


DRIVING: dict[str, Callable[[_Draws], Iterator[Leg]]] = {
    "circles": _circles,
    "lines": _lines,
    "stop and go": _stop_and_go,
    "shuttle": _shuttle,
    "on the spot": _on_the_spot,
    "hard": _hard,
    "jumps": _jumps,
}
"""Beside ``random``, which is a path without legs."""


def course(
    kind: str,
    rng: np.random.Generator,
    seconds: float = 120.0,
    *,
    sideways: bool = True,
    friction: float = USUAL_FRICTION,
) -> Floats:
    """Twists of so many seconds or a little more, one a cycle, shape (m, 3).

    Args:
        kind: A key of :data:`DRIVING`, or ``random``.
        rng: Of all that is drawn.
        seconds: See above.
        sideways: Whether the drive can go there.
        friction: Coefficient of its tyres.
    """
    if kind == "random":
        return random_path(rng, 0.5 * seconds, sideways=sideways)
    draws = _Draws(rng, sideways=sideways, friction=friction)
    twists: list[Floats] = [np.zeros((round(RATE), 3))]
    cycles, now = 0, np.zeros(3)
    while cycles < seconds * RATE:
        for ramp_s, hold_s, twist in DRIVING[kind](draws):
            aim = np.array(twist)
            ramp = np.linspace(now, aim, round(ramp_s * RATE) + 1)[1:]
            hold = np.tile(aim, (max(round(hold_s * RATE), 1), 1))
            twists += [ramp, hold]
            cycles += len(ramp) + len(hold)
            now = aim
    return np.concatenate(twists)
