"""Who is right where the gyros contradict all wheels.

What pushes a robot, or drags one of its wheels, makes all wheels slip together. They then agree
with each other, and to the gate it looks as if the gyro were wrong. But tyres slip more often than
gyros fail: so it is the gyro that is believed, and the wheels are by as much less exact as they
contradict it. If it has done so for longer than anything pushes it was the gyro after all, and by
what the heading has followed it is turned back.
"""

from collections.abc import Sequence
from typing import Literal

SKIDS_S = 2.0
"""For how long wheels may skid at once: a robot that is pushed goes on turning until its tyres have
stopped it. The diagnoser, too, accuses a gyro no earlier where nothing else tells."""
FORGOTTEN = 0.1
"""Share of the time without contradiction that is taken off."""
MOST_RAD_S2 = 100.0
"""By which a robot turns faster from step to step at most: a wheel that runs into a wall at 1 m/s,
0.3 m off the middle, stops within 0.03 s. What changes more is a reading that is wrong."""


class Dispute:
    """Follows it.

    Attributes:
        open: Whether gyros are believed against the wheels.
        turned_rad: By how much the heading has followed them so far.
    """

    def __init__(self) -> None:
        self.open = False
        self.turned_rad = 0.0
        self._lasted_s = 0.0

    def settle(self, seconds: float) -> None:
        """Takes in a step in which a gyro agrees with the wheels, or there is none."""
        self.open, self.turned_rad = False, 0.0
        self._lasted_s = max(self._lasted_s - FORGOTTEN * seconds, 0.0)

    def step(
        self, against: Sequence[float], off: Sequence[float], seconds: float, *, dragged: bool
    ) -> Literal["", "wheels", "gyros"]:
        """Takes in a step in which all gyros contradict the wheels.

        Args:
            against: How far each is from what the wheels say, rad/s.
            off: And from what was predicted, rad/s.
            seconds: Of the step.
            dragged: Whether a wheel is known to drag the others.

        Returns:
            Who is wrong, beyond what the gate says; of the gyros only once, when it turns out.
        """
        if dragged:
            return "wheels"
        before = self._lasted_s
        self._lasted_s = min(before, SKIDS_S) + seconds
        self.open = self._lasted_s <= SKIDS_S and min(map(abs, off)) <= MOST_RAD_S2 * seconds
        if self.open:
            self.turned_rad += sum(against) / len(against) * seconds
            return "wheels"
        return "gyros" if before <= SKIDS_S < self._lasted_s else ""
