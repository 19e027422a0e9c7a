"""How a servo's shaft moves: first order towards its goal, with limited velocity.

Units: rad, rad/s, A, °C, s. Enough for a diagnosis to see plausible values, no more: the masses
that a robot has are not modelled.
"""

from math import exp
from typing import Literal

TIME_CONSTANT_S = 0.05
"""Of position and velocity control: a servo without load settles within some tenths of a second."""
FRICTION_A = 0.15
"""Current at full velocity."""
AMBIENT_C = 30.0
HEATING_C_PER_A2 = 25.0
HEATING_S = 300.0
"""Time constant of the case: minutes."""
STANDBY_A = 0.04
"""Standby current (e-manual, XM430-W210, "Specifications")."""
AT_REST = 1e-5
"""rad and rad/s, two orders of magnitude below the resolution of the sensors."""

Drive = Literal["off", "position", "velocity"]


class Motion:
    """State of the shaft at the time of the last :meth:`advance`.

    Attributes:
        position: rad.
        velocity: rad/s.
        temperature: °C.
        load: Current that holds what hangs on the shaft, A.
        limit: Greatest velocity, rad/s.
    """

    def __init__(self, position: float, load: float, limit: float) -> None:
        self.position = position
        self.velocity = 0.0
        self.temperature = AMBIENT_C
        self.load = load
        self.limit = limit
        self._drive: Drive = "off"
        self._goal = 0.0
        self._allowed = limit
        self._moving = False
        self._at_ns = 0
        self._heated_ns = 0

    def drive(self, drive: Drive, goal: float, allowed: float, at_ns: int) -> None:
        """Go for a goal from now on, at most as fast as ``allowed``."""
        self.advance(at_ns)
        self._drive, self._goal = drive, goal
        self._allowed = min(allowed, self.limit)
        self._moving = True

    def advance(self, at_ns: int) -> None:
        """Move on to this time."""
        passed = (at_ns - self._at_ns) / 1e9
        if passed <= 0.0:
            return
        self._at_ns = at_ns
        if not self._moving:
            return
        if self._drive == "position":
            self._approach(passed)
        else:
            goal = self._goal if self._drive == "velocity" else 0.0
            goal = max(-self._allowed, min(self._allowed, goal))
            decay = exp(-passed / TIME_CONSTANT_S)
            excess = self.velocity - goal
            self.position += goal * passed + excess * TIME_CONSTANT_S * (1.0 - decay)
            self.velocity = goal + excess * decay
            self._moving = bool(goal) or abs(self.velocity) > AT_REST

    @property
    def current(self) -> float:
        """Motor current, A."""
        held = 0.0 if self._drive == "off" else self.load
        return held + FRICTION_A * self.velocity / self.limit

    @property
    def arrived(self) -> bool:
        """Whether the shaft is where it should be."""
        return not self._moving

    def unwind(self, turn: float) -> None:
        """Forget whole turns, rad."""
        half = turn / 2
        self.position = (self.position + half) % turn - half

    def warm(self, at_ns: int) -> float:
        """The temperature at this time."""
        passed = (at_ns - self._heated_ns) / 1e9
        if passed > 0.0:
            self._heated_ns = at_ns
            final = AMBIENT_C + HEATING_C_PER_A2 * self.current**2
            self.temperature = final + (self.temperature - final) * exp(-passed / HEATING_S)
        return self.temperature

    def _approach(self, passed: float) -> None:
        error = self._goal - self.position
        sign = 1.0 if error > 0 else -1.0
        # At full velocity as long as first order would ask for more.
        far = abs(error) - self._allowed * TIME_CONSTANT_S
        if far > 0.0:
            straight = min(passed, far / self._allowed) if self._allowed > 0.0 else passed
            self.position += sign * self._allowed * straight
            self.velocity = sign * self._allowed
            passed -= straight
            if passed <= 0.0:
                return
            error = self._goal - self.position
        error *= exp(-passed / TIME_CONSTANT_S)
        self.position = self._goal - error
        self.velocity = error / TIME_CONSTANT_S
        if abs(error) < AT_REST:
            self.position, self.velocity, self._moving = self._goal, 0.0, False
