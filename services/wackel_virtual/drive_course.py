"""When drive faults begin and end, and what chance adds to them. Time is an argument, in s."""

from dataclasses import dataclass, field
from math import atan2, cos, hypot, inf, pi, sin
from random import Random

from wackel_drive.layout import Layout
from wackel_schemas.virtual import Injection
from wackel_virtual.body import InPlane
from wackel_virtual.drive_faults import Moment, checked_drive
from wackel_virtual.faults import matches

JAM_MEAN_S = 0.3
"""How long a wheel that jams now and then is jammed, on average: something turns with it."""
PATCH_RADIUS_M = 0.3
STANDING_M_S = 0.01


@dataclass(eq=False)
class _Fault:
    """An injected fault; ``next_s`` is when it begins, toggles or ends next."""

    injection: Injection
    start_s: float
    end_s: float
    random: Random
    next_s: float
    active: bool = False
    moment: Moment = field(default_factory=Moment)


class DriveCourse:
    """The faults of one drive over time.

    Args:
        layout: Of the drive.
        seed: Of everything random.
    """

    def __init__(self, layout: Layout, seed: int | str) -> None:
        self._layout = layout
        self._seed = seed
        self._count = 0
        self._faults: list[_Fault] = []
        self._next_s = inf

    def inject(self, injection: Injection, now_s: float) -> Injection:
        """Have a fault begin ``start_s`` from now; returns it with its defaults filled in.

        Raises:
            InjectionError: Unknown kind, or a place or value that it cannot have.
        """
        injection = checked_drive(injection, self._layout)
        start = now_s + injection.start_s
        end = inf if injection.duration_s is None else start + injection.duration_s
        # A generator of its own: what chance adds does not depend on other faults.
        random = Random(f"{self._seed}/fault/{self._count}")
        self._count += 1
        self._faults.append(_Fault(injection, start, end, random, start))
        self._next_s = min(self._next_s, start)
        return injection

    def heal(self, kind: str, wheel: str | None) -> list[Injection]:
        """End faults now, scheduled ones too; returns those that it concerned."""
        healed = [
            fault
            for fault in self._faults
            if matches(fault.injection, kind, None) and wheel in (None, fault.injection.wheel)
        ]
        self._faults = [fault for fault in self._faults if fault not in healed]
        if healed:
            self._next_s = 0.0
        return [fault.injection for fault in healed]

    def active(self) -> list[tuple[Injection, Moment]]:
        """The faults that act now, in the order in which they were injected."""
        return [(fault.injection, fault.moment) for fault in self._faults if fault.active]

    def advance(self, now_s: float, pose: InPlane, twist: InPlane) -> bool:
        """Go on to this time; the robot's pose and twist say where a patch of ice is laid.

        Returns:
            Whether anything begins, changes or ends.
        """
        if now_s < self._next_s:
            return False
        for fault in self._faults:
            while fault.next_s <= now_s < fault.end_s:
                self._go_on(fault, pose, twist)
        self._faults = [fault for fault in self._faults if now_s < fault.end_s]
        self._next_s = min((min(fault.next_s, fault.end_s) for fault in self._faults), default=inf)
        return True

    def _go_on(self, fault: _Fault, pose: InPlane, twist: InPlane) -> None:
        """Begin, or jam and come free in turns."""
        random, moment = fault.random, fault.moment
        if not fault.active:
            fault.active = True
            moment.angle = random.uniform(-pi, pi)
            moment.lever = random.uniform(-1.0, 1.0)
            if fault.injection.kind == "ice_patch" and fault.injection.wheel is None:
                moment.patch = self._ahead(pose, twist)
        else:
            moment.jammed = not moment.jammed
        if fault.injection.kind != "wheel_temporarily_blocked":
            fault.next_s = inf
            return
        share = fault.injection.value or 0.0
        mean = JAM_MEAN_S if moment.jammed else JAM_MEAN_S * (1.0 - share) / share
        fault.next_s += random.expovariate(1.0 / mean)

    def _ahead(self, pose: InPlane, twist: InPlane) -> tuple[float, float]:
        """Centre of a patch of ice that the robot is about to touch."""
        x, y, heading = pose
        vx, vy, _ = twist
        speed = hypot(vx, vy)
        direction = heading + (atan2(vy, vx) if speed > STANDING_M_S else 0.0)
        distance = self._layout.drive.length_m + PATCH_RADIUS_M
        return x + distance * cos(direction), y + distance * sin(direction)
