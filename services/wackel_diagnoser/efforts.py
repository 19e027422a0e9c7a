"""What the motors need, and whether they are on: what kinematics cannot see.

A wheel without torque rolls consistently with all others. Its motor tells: torque is off, or hardly
any current flows while the others work. The same current tells a wheel that is really blocked from
one whose sensor only says so.
"""

import math
from collections.abc import Mapping

import numpy as np

from wackel_drive.layout import Layout, Servo
from wackel_kinematics.array import Floats
from wackel_schemas.bus import BusState, ServoState

SHORT_S = 0.15
"""Some cycles: noise and single readings do not count, a fault shows at once."""
LONG_S = 20.0
"""For what is usual."""
LEARNT_S = 5.0
"""Of driving, from which on it is known what is usual."""


class Efforts:
    """Follows the motors that roll and steer the wheels.

    Attributes:
        short: Mean square of each motor's current (A) or load (share) lately, rolling motors in
            the order of the roll rows, then steering motors of all wheels; NaN where none is told.
        usual: The same of driving without a fault.
    """

    def __init__(self, layout: Layout) -> None:
        rolls = layout.drive.roll_wheels.tolist()
        joints = [*(layout.rolling[i] for i in rolls), *layout.steering]
        self._rolls = len(rolls)
        self._at: Mapping[Servo, int] = {
            joint.servo: i for i, joint in enumerate(joints) if joint is not None
        }
        self._by_bus: dict[str, dict[int, int]] = {}
        for servo, at in self._at.items():
            self._by_bus.setdefault(servo.bus, {})[servo.id] = at
        self._current = [math.nan] * len(joints)
        self._torque: list[bool | None] = [None] * len(joints)
        self.short: Floats = np.full(len(joints), np.nan)
        self.usual: Floats = np.full(len(joints), np.nan)
        self._learnt_s = 0.0
        self._off_s = [0.0] * len(rolls)

    def bus_state(self, bus: str, state: BusState) -> None:
        """Takes in what the servos of a bus said."""
        places = self._by_bus.get(bus)
        if places is None:
            return
        for servo in state.servos:
            at = places.get(servo.id)
            if at is not None:
                self._current[at] = _effort(servo)
                if servo.torque_enabled is not None:
                    self._torque[at] = servo.torque_enabled

    def step(self, seconds: float, learn: bool) -> None:
        """A step has passed; ``learn``: the robot drives, and nothing is suspected."""
        squares = np.array(self._current)
        squares *= squares
        unknown = not math.isfinite(float(self.short.sum()))
        if unknown:
            self.short = np.where(np.isfinite(self.short), self.short, squares)
        self.short = self.short + min(seconds / SHORT_S, 1.0) * (squares - self.short)
        if learn:
            if unknown:
                self.usual = np.where(np.isfinite(self.usual), self.usual, squares)
            self._learnt_s = min(self._learnt_s + seconds, LONG_S)
            self.usual = self.usual + seconds / self._learnt_s * (squares - self.usual)

    @property
    def known(self) -> bool:
        """Whether it is known what is usual."""
        return self._learnt_s >= LEARNT_S

    def ratio(self) -> Floats:
        """Root mean square lately by what is usual, rolling motors first; NaN where unknown."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio: Floats = np.sqrt(self.short / self.usual)
        return ratio

    def off(self) -> list[bool]:
        """Which rolling motors are switched off while others are on."""
        rolling = self._torque[: self._rolls]
        return [torque is False and any(rolling) for torque in rolling]


def _effort(servo: ServoState) -> float:
    """Current, or where there is none the load; NaN if neither is told, or makes no sense."""
    value = servo.current if servo.current is not None else servo.load
    return value if value is not None and abs(value) < 1e3 else math.nan
