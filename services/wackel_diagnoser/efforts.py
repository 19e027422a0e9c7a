"""What the motors need, and whether they are on: what kinematics cannot see.

A wheel without torque rolls consistently with all others. Its motor tells: torque is off, or hardly
any current flows while the others work. The same current tells a wheel that is really blocked from
one whose sensor only says so.
"""

import math

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_schemas.bus import BusState, ServoState

LONG_S = 20.0
"""For what is usual."""
LEAST = 0.005
"""A, or share of the greatest load: resolution of the reading."""
STALE_NS = 100_000_000
"""A current that is older is that of a servo that does not answer."""
LEARNT_S = 5.0
"""Of driving, from which on it is known what is usual."""


class Efforts:
    """Follows the motors that roll and steer the wheels.

    What driving itself needs is taken off: a share of speed (friction) and a share of acceleration
    (mass), both learnt. What is left is what a wheel works against others or against an obstacle.

    Attributes:
        off_s: For how long each rolling motor has been switched off while others are on.
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
        self._torque: list[bool | None] = [None] * self._rolls
        self.off_s = [0.0] * self._rolls
        self._unknown: Floats = np.full(len(joints), np.nan)
        self._usual = self._unknown
        self._speed: Floats | None = None
        # Normal equations of current = friction × speed + mass × acceleration, for all wheels.
        self._normal: Floats = np.diag([1e-6, 1e-6])
        self._right = np.zeros(2)
        self._needs: Floats = np.zeros(2)
        self._learnt_s = 0.0

    def bus_state(self, bus: str, state: BusState) -> None:
        """Takes in what the servos of a bus said."""
        places = self._by_bus.get(bus)
        if places is None:
            return
        for servo in state.servos:
            place = places.get(servo.id)
            if place is not None:
                at, sign = place
                self._current[at] = sign * _effort(servo)
                self._read[at] = self._newest = state.stamp
                if servo.torque_enabled is not None and at < self._rolls:
                    self._torque[at] = servo.torque_enabled

    def step(self, seconds: float, speed: Floats, learnt_s: float, *, needed: bool) -> Floats:
        """A step has passed.

        Args:
            seconds: Its length.
            speed: What each roll row should have rolled at, m/s.
            learnt_s: For how much driving without a fault it stands; 0: nothing can be learnt.
            needed: Whether the result is.

        Returns:
            Squares of what each motor needs beyond driving, by what that usually is; rolling motors
            in the order of the roll rows, then steering motors of all wheels; NaN where unknown.
        """
        self._watch_torque(seconds)
        before, self._speed = self._speed, speed
        if not (needed or learnt_s) or before is None:
            return self._unknown
        rolls = self._rolls
        current = np.array(self._current)
        causes = np.array([speed, (speed - before) / seconds])
        by_driving = self._needs.dot(causes)
        if math.isfinite(float(by_driving.sum())):
            if learnt_s and math.isfinite(float(current[:rolls].sum())):
                fade = 1.0 - learnt_s / LONG_S
                self._normal = fade * self._normal + causes.dot(causes.T)
                self._right = fade * self._right + causes.dot(current[:rolls])
                (a, b), (_, c) = self._normal.tolist()
                r, s = self._right.tolist()
                self._needs = np.array((c * r - b * s, a * s - b * r)) / (a * c - b * b)
            current[:rolls] -= by_driving
        squares: Floats = current * current
        if learnt_s:
            self._learnt_s = min(self._learnt_s + learnt_s, LONG_S)
            self._usual = _towards(self._usual, squares, learnt_s / self._learnt_s)
        if self._learnt_s < LEARNT_S:
            return self._unknown
        ratio: Floats = squares / np.maximum(self._usual, LEAST**2)
        return ratio

    @property
    def currents(self) -> list[float]:
        """Of the rolling motors, as last read, A or share of load; NaN if unknown."""
        return self._current[: self._rolls]

    def rolling(self) -> tuple[Floats, Floats, Floats] | None:
        """Currents of the rolling motors, what driving needs by speed and by acceleration, and the
        mean square of what is left; ``None`` until that is known."""
        if self._learnt_s < LEARNT_S:
            return None
        rolls = self._rolls
        current = [
            amperes if self._newest - read <= STALE_NS else math.nan
            for amperes, read in zip(self._current[:rolls], self._read[:rolls], strict=True)
        ]
        return np.array(current), self._needs, self._usual[:rolls]

    def _watch_torque(self, seconds: float) -> None:
        torque = self._torque
        some_on = any(torque)
        self.off_s = [
            off_s + seconds if some_on and on is False else 0.0
            for on, off_s in zip(torque, self.off_s, strict=True)
        ]


def _towards(mean: Floats, value: Floats, share: float) -> Floats:
    """A mean moved towards a value by a share; it begins with the first value that is known."""
    moved = mean + share * (value - mean)
    if math.isfinite(float(moved.sum())):
        return moved
    return np.where(np.isfinite(moved), moved, np.where(np.isfinite(mean), mean, value))


def _effort(servo: ServoState) -> float:
    """Current, or where there is none the load; NaN if neither is told, or makes no sense."""
    value = servo.current if servo.current is not None else servo.load
    return value if value is not None and abs(value) < 1e3 else math.nan
