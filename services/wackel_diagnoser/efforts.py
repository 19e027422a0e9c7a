"""What the motors need, and whether they are on: what kinematics cannot see.

A wheel without torque rolls consistently with all others. Its motor tells: torque is off, or hardly
any current flows while the others work. The same current tells a wheel that is really blocked from
one whose sensor only says so.
"""

import math
from operator import mul
from typing import NamedTuple

import numpy as np

from wackel_diagnoser.torque import TorqueWatch
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats, cofactors
from wackel_schemas.bus import BusState

LONG_S = 20.0
"""For what is usual."""
LEAST = 0.005
"""A, or share of the greatest load: resolution of the reading."""
_LEAST_SQUARE = LEAST**2
STALE_NS = 100_000_000
"""A current that is older is that of a servo that does not answer."""
MOST = 1e3
"""A, or share of load; more is no reading."""
LEARNT_S = 5.0
"""Of driving, from which on it is known what is usual."""
SAME_S = 0.5
"""For so long wheels push each other much the same: the rest of it tells of friction no more."""
UNKNOWN = 1e-6
"""Information of who has never driven; who goes on evenly forgets what hastening needs."""
TURNING = 0.5
"""Share of the mass by which turning the robot may need less than driving it, or more: where wheels
stand at the rim of a disc, half."""

_PRODUCTS = (0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2), (0, 3), (1, 3), (2, 3)
"""Of speed, acceleration, that of turning, and current: what the upper triangle of the normal
equations sums, row by row, then their right side."""


class Needs(NamedTuple):
    """What driving needs, as learnt.

    Attributes:
        friction: By speed, A s/m (or share of load instead of A, as all of these).
        mass: By acceleration, A s²/m.
        turning: The same by that part of it that is for the robot's turning: what that needs more
            than driving does; mostly less than nothing.
        unsure: Standard deviation of the friction. What wheels push each other at low speed is
            taken for it, until the robot has driven faster.
    """

    friction: float
    mass: float
    turning: float
    unsure: float


class Rolling(NamedTuple):
    """The rolling motors.

    Attributes:
        current: Of each, A; NaN if unknown.
        needs: What driving needs.
        usual: Mean square of what each needs beyond that, A².
    """

    current: list[float]
    needs: Needs
    usual: list[float]


class Efforts:
    """Follows the motors that roll and steer the wheels.

    What driving itself needs is taken off: a share of speed (friction) and shares of acceleration
    (mass, and how much less of it turns), all learnt. What is left is what a wheel works against
    others or against an obstacle.
    """

    def __init__(self, layout: Layout) -> None:
        rolls = layout.drive.roll_wheels.tolist()
        joints = [*(layout.rolling[i] for i in rolls), *layout.steering]
        self._rolls = len(rolls)
        self._by_bus: dict[str, dict[int, tuple[int, int]]] = {}
        for at, joint in enumerate(joints):
            if joint is not None:
                places = self._by_bus.setdefault(joint.servo.bus, {})
                places[joint.servo.id] = at, joint.sign
        self._current = [math.nan] * len(joints)
        self._read = [0] * len(joints)
        self._newest = 0
        # A motor that rolls the robot alone is held against those that steer.
        self._watched = self._rolls if self._rolls > 1 else len(joints)
        self._torque = TorqueWatch(self._watched)
        self._unknown: Floats = np.full(len(joints), np.nan)
        self._usual = [math.nan] * len(joints)
        self._before: tuple[list[float], list[float]] | None = None  # speeds, and of turning
        # Normal equations of current = friction × speed + mass × acceleration + turning × that of
        # turning, for all wheels.
        self._sums = [0.0] * len(_PRODUCTS)
        self._needs = Needs(0.0, 0.0, 0.0, 0.0)
        self._learnt_s = 0.0

    def bus_state(self, bus: str, state: BusState) -> None:
        """Takes in what the servos of a bus said."""
        places = self._by_bus.get(bus)
        if places is None:
            return
        stamp, current, read = state.stamp, self._current, self._read
        for servo in state.servos:
            place = places.get(servo.id)
            if place is None:
                continue
            at, sign = place
            effort = servo.current
            if effort is None:
                effort = servo.load
            # What is read now and then, as temperatures are, says nothing of it.
            if effort is not None or servo.position is not None or servo.velocity is not None:
                if effort is None or not abs(effort) < MOST:
                    effort = math.nan
                current[at] = sign * effort
                read[at] = self._newest = stamp
            if servo.torque_enabled is not None and at < self._watched:
                self._torque.read(at, on=servo.torque_enabled, stamp=stamp)

    @property
    def off(self) -> list[bool]:
        """Which rolling motors are switched off while others are on."""
        return self._torque.off[: self._rolls]

    def step(
        self,
        seconds: float,
        speeds: list[float],
        turning: list[float],
        learnt_s: float,
        *,
        needed: bool,
    ) -> Floats:
        """A step has passed.

        Args:
            seconds: Its length.
            speeds: What each roll row should have rolled at, m/s.
            turning: How much of that was for the robot's turning, m/s.
            learnt_s: For how much driving without a fault it stands; 0: nothing can be learnt.
            needed: Whether the result is.

        Returns:
            Squares of what each motor needs beyond driving, by what that usually is; rolling motors
            in the order of the roll rows, then steering motors of all wheels; NaN where unknown.
        """
        before = self._before
        if not (needed or learnt_s) or before is None:
            self._before = speeds, turning
            return self._unknown
        beyond = self._current.copy()
        if learnt_s:
            self._learn(seconds, speeds, turning, learnt_s)
        if math.isfinite(sum(speeds) + sum(before[0])):
            beyond[: self._rolls] = self._pushes(seconds, speeds, turning)
        self._before = speeds, turning
        squares = [amperes * amperes for amperes in beyond]
        if learnt_s:
            self._learnt_s = min(self._learnt_s + learnt_s, LONG_S)
            share = learnt_s / self._learnt_s
            self._usual = [
                _towards(mean, square, share)
                for mean, square in zip(self._usual, squares, strict=True)
            ]
        if self._learnt_s < LEARNT_S:
            return self._unknown
        return np.array(
            [
                square / (_LEAST_SQUARE if usual < _LEAST_SQUARE else usual)
                for square, usual in zip(squares, self._usual, strict=True)
            ]
        )

    def _learn(
        self, seconds: float, speeds: list[float], turning: list[float], learnt_s: float
    ) -> None:
        """What driving needs, from a moment in which nothing is wrong."""
        before, turned = self._before or (speeds, turning)
        seen = (
            speeds,
            [(now - then) / seconds for now, then in zip(speeds, before, strict=True)],
            [(turns - did) / seconds for turns, did in zip(turning, turned, strict=True)],
            self._current[: self._rolls],
        )
        told = [sum(map(mul, seen[a], seen[b])) for a, b in _PRODUCTS]
        if not math.isfinite(sum(told)):
            return
        fade = 1.0 - learnt_s / LONG_S
        self._sums = [fade * total + new for total, new in zip(self._sums, told, strict=True)]
        # The first time, it is not known yet: NaN, which is no greater.
        pushed = max(LEAST**2, sum(self._usual[: self._rolls]) / self._rolls)
        # Until the robot has turned and driven, it is a guess that both need alike.
        alike = pushed / max((TURNING * self._needs.mass) ** 2, 1e-12)
        a, b, c, d, e, f, x, y, z = self._sums
        known = a + UNKNOWN, b, c, d + UNKNOWN, e, f + alike
        (p, q, r, s, t, u), determinant = cofactors(known)
        if not (determinant > 0.0 and p >= 0.0):  # as rounding may make them of nonsense
            return
        self._needs = Needs(
            friction=(p * x + q * y + r * z) / determinant,
            mass=(q * x + s * y + t * z) / determinant,
            turning=(r * x + t * y + u * z) / determinant,
            unsure=math.sqrt(pushed * p / determinant * max(SAME_S / learnt_s, 1.0)),
        )

    @property
    def currents(self) -> list[float]:
        """Of the rolling motors, as last read, A or share of load; NaN if unknown."""
        return self._current[: self._rolls]

    def _pushes(self, seconds: float, speeds: list[float], turning: list[float]) -> list[float]:
        """What each rolling motor pushes beyond what driving needs; NaN if unknown."""
        # Single numbers: for some motors, Python is faster with them than numpy.
        friction, mass, more, _ = self._needs
        mass, more = mass / seconds, more / seconds
        before, turned = self._before or (speeds, turning)
        return [
            amperes - friction * now - mass * (now - then) - more * (turns - did)
            for amperes, now, then, turns, did in zip(
                self._current, speeds, before, turning, turned, strict=False
            )
        ]

    def rolling(self) -> Rolling | None:
        """The rolling motors now; ``None`` until it is well known what is usual: by what few
        manoeuvres show, motors that push pass for idle."""
        if self._learnt_s < LONG_S:
            return None
        rolls = self._rolls
        current = [
            amperes if self._newest - read <= STALE_NS else math.nan
            for amperes, read in zip(self._current[:rolls], self._read[:rolls], strict=True)
        ]
        return Rolling(current, self._needs, self._usual[:rolls])


def _towards(mean: float, value: float, share: float) -> float:
    """A mean moved towards a value by a share; it begins with the first value that is known."""
    moved = mean + share * (value - mean)
    if math.isfinite(moved):
        return moved
    return mean if math.isfinite(mean) else value
