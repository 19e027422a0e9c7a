"""Servos that come back: while one is not heard, it is not told anything either.

It has gone on with its last goals and now makes up for what it missed; or it was without power, and
has to be switched on again. Until then it shows something else than it is told through no fault of
its own, so it counts as absent.
"""

import math

from msgspec.structs import replace

from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Ints
from wackel_schemas import component

MISSED_NS = 60_000_000
"""Who was silent for less has missed no more than drives lag anyway. One state that is lost or
refused is less, down to 20 cycles per second."""
BACK_NS = 1_500_000_000
"""A second until whoever drives the robot sees that a servo has to be switched on, and what a
steering takes for half a turn then."""
READ_NS = 1_000_000_000
"""How old what is known of its torque may be beyond that: its register is read once a second."""


class Absences:
    """Follows which servos are heard.

    Args:
        layout: The drive.

    Attributes:
        absent: Paths of those that are not, or have just come back.
    """

    def __init__(self, layout: Layout) -> None:
        self.absent: list[str] = []
        self._n, names = layout.drive.n, layout.names
        self._paths = [*map(component.wheel_drive, names), *map(component.wheel_steering, names)]
        self._rolls = [i for i, joint in enumerate(layout.rolling) if joint is not None]
        self._steers = [i for i, joint in enumerate(layout.steering) if joint is not None]
        # Servos by number of their wheel; steerings, n more.
        self._since: dict[int, int] = {}
        """Stamp since which one has been silent."""
        self._until: dict[int, int] = {}
        """Stamp up to which one counts as absent. Kept until its torque is known again, too."""

    def all_back(self, now: int) -> None:
        """Nobody was heard until now."""
        servos = (*self._rolls, *(self._n + i for i in self._steers))
        self._until = dict.fromkeys(servos, now + BACK_NS)

    def step(self, step: Step) -> Step:
        """Takes in a step; returns it without what servos say that have just come back."""
        # One sum tells whether anything is missing, rare where all wheels are driven and steered.
        if self._since or not math.isfinite(sum(step.wheel_rate) + sum(step.heading)):
            self._miss(step)
        return self._without(step) if self._until else step

    def _miss(self, step: Step) -> None:
        """Follows who is silent, and for how long."""
        rates, headings = step.wheel_rate, step.heading
        silent = [i for i in self._rolls if math.isnan(rates[i])]
        silent += [self._n + i for i in self._steers if math.isnan(headings[i])]
        self._since = {servo: self._since.get(servo, step.begin) for servo in silent}
        for servo, since in self._since.items():
            if step.end - since >= MISSED_NS:
                self._until[servo] = step.end + BACK_NS

    def lasting(self, wheels: Ints, off: list[bool]) -> list[bool]:
        """Which of the rolling servos of these wheels are off, but not just for having come back.

        Args:
            wheels: Their numbers.
            off: Which of them are off.
        """
        if not (self._until and any(off)):
            return off
        pairs = zip(wheels.tolist(), off, strict=True)
        return [is_off and wheel not in self._until for wheel, is_off in pairs]

    def _without(self, step: Step) -> Step:
        heading, steered, wheel_rate = (
            step.heading.copy(),
            step.steered.copy(),
            step.wheel_rate.copy(),
        )
        self.absent = []
        for servo, until in list(self._until.items()):
            left = until - step.end
            if not -READ_NS < left <= BACK_NS:
                del self._until[servo]
            elif left > 0:
                self.absent.append(self._paths[servo])
                if servo < self._n:
                    wheel_rate[servo] = math.nan
                else:
                    heading[servo - self._n] = steered[servo - self._n] = math.nan
        return replace(step, heading=heading, steered=steered, wheel_rate=wheel_rate)
