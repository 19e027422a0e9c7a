"""Who is right where the gyros contradict all wheels.

What pushes a robot, or drags one of its wheels, makes all wheels slip together. They then agree
with each other, and to the gate it looks as if the gyro were wrong. But tyres slip more often than
gyros fail: so it is the gyro that is believed, until it has contradicted for longer than anything
pushes; and the wheels are by as much less exact as they contradict it.
"""

from collections.abc import Sequence

SKIDS_S = 0.5
"""For how long something pushes, see :mod:`wackel_diagnoser.verdicts`; a gyro that fails is named
there by then, and excluded."""
FORGOTTEN = 0.1
"""Share of the time without contradiction that is taken off."""
MOST_RAD_S2 = 100.0
"""By which a robot turns faster from step to step at most: a wheel that runs into a wall at 1 m/s,
0.3 m off the middle, stops within 0.03 s. What changes more is a reading that is wrong."""


class Dispute:
    """Follows it."""

    def __init__(self) -> None:
        self._lasted_s = 0.0

    def skids(
        self, believed: Sequence[bool], off: Sequence[float], seconds: float, *, dragged: bool
    ) -> bool:
        """Takes in a step; whether it is the wheels that are wrong.

        Args:
            believed: Whether the gate believes each gyro.
            off: How far each is from what was predicted, rad/s.
            seconds: Of the step.
            dragged: Whether a wheel is known to drag the others.
        """
        if not off or any(believed):
            self._lasted_s = max(self._lasted_s - FORGOTTEN * seconds, 0.0)
            return False
        if dragged:
            return True
        self._lasted_s += seconds
        return self._lasted_s <= SKIDS_S and min(map(abs, off)) <= MOST_RAD_S2 * seconds
