"""How long steps usually are: one of another length may not have taken as long as stamps say."""

from wackel_drive.alignment import UNCERTAIN_S

EVENS = 0.02
"""Share of a step in the mean of its length, once there are some."""


class Pace:
    """Learns it."""

    def __init__(self) -> None:
        self._usual_s, self._steps = 0.0, 0

    def off_s(self, seconds: float) -> float:
        """Takes in a step; by how much it is longer than most, as far as stamps may be wrong, s."""
        usual = self._usual_s or seconds
        off = max(min(seconds - usual, UNCERTAIN_S), -UNCERTAIN_S)
        self._steps += 1
        self._usual_s = usual + max(EVENS, 1.0 / self._steps) * off
        return off
