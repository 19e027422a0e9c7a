"""Whether the robot is still there, pure: buses that say nothing any more."""

from collections.abc import Mapping

LOOK_S = 0.25
QUIET_S = 2.0
"""A gateway that was killed is back sooner: `wackel up` restarts it after 0.2 s."""
_QUIET_CYCLES = 4


class Hearing:
    """What was heard of each bus, looked at every :data:`LOOK_S`.

    Looks are counted instead of seconds: a pilot that was itself held up has heard nothing either,
    and that is not the robot's silence.

    Args:
        rates: Of each bus, cycles per second; a slow one may be silent for longer.
    """

    def __init__(self, rates: Mapping[str, float]) -> None:
        self._limits = {
            bus: max(QUIET_S, _QUIET_CYCLES / rate) / LOOK_S for bus, rate in rates.items()
        }
        self._looks = dict.fromkeys(rates, 0)

    def heard(self, bus: str) -> None:
        """A bus has said something."""
        self._looks[bus] = 0

    def look(self) -> list[str]:
        """The buses that have been silent for too long."""
        for bus in self._looks:
            self._looks[bus] += 1
        return [bus for bus, looks in self._looks.items() if looks > self._limits[bus]]
