"""Timeouts of commands, pure: who commands may die, and servos go on as last told."""

from dataclasses import dataclass

from wackel_gateway.commands import Refused
from wackel_schemas.bus import BusCommand, ServoGoal

LONGEST_S = 3600.0
"""A goal that holds for longer holds for good, and should say so."""
_MOVING = ("velocity", "current", "pwm")
"""Goals that keep a motor moving; one that holds a position stands."""
_TIMES, _AGAIN_NS = 3, 50_000_000
"""So often and so far apart a motor is told to stand: a write is not answered and may get lost."""


@dataclass(slots=True)
class _Held:
    """A goal that is to be taken back, ns; and how often that has been told already."""

    until_ns: int
    told: int = 0


class CommandTimeouts:
    """The goals that were commanded for a time, until others come or they are taken back.

    Attributes:
        due_ns: When :meth:`taken_back` has something to say next; absent: never, so far.
        count: Goals taken back so far.
    """

    def __init__(self) -> None:
        self.due_ns: int | None = None
        self.count = 0
        self._held: dict[tuple[int, str], _Held] = {}

    def commanded(self, command: BusCommand, now_ns: int) -> None:
        """Takes notice of a command, whose goals come instead of earlier ones.

        Args:
            command: One that is carried out.
            now_ns: Since when it holds, on the monotonic clock, as all times here.

        Raises:
            Refused: It cannot hold for so long. Nothing of it has been noticed.
        """
        timeout_s = command.timeout_s
        if timeout_s is not None and not 0 < timeout_s <= LONGEST_S:
            raise Refused("no timeout", f"timeout_s is {timeout_s}, not in 0 … {LONGEST_S:g}")
        for goal in command.goals:
            for field in _MOVING:
                value = getattr(goal, field)
                if value is None:
                    continue
                self._held.pop((goal.id, field), None)
                if value and timeout_s is not None:
                    self._held[goal.id, field] = _Held(now_ns + round(timeout_s * 1e9))
        self._look_ahead()

    def taken_back(self, now_ns: int) -> list[ServoGoal]:
        """Goals of 0 in place of those that nobody has renewed."""
        goals: list[ServoGoal] = []
        for (servo_id, field), held in list(self._held.items()):
            if held.until_ns > now_ns:
                continue
            goals.append(_stop(servo_id, field))
            self.count += not held.told
            held.told += 1
            held.until_ns = now_ns + _AGAIN_NS
            if held.told == _TIMES:
                del self._held[servo_id, field]
        self._look_ahead()
        return goals

    def all_back(self) -> list[ServoGoal]:
        """Goals of 0 in place of all that hold for a time: nobody will be there to take them back
        later."""
        goals = [_stop(servo_id, field) for servo_id, field in self._held]
        self._held.clear()
        self._look_ahead()
        return goals

    def _look_ahead(self) -> None:
        self.due_ns = min((held.until_ns for held in self._held.values()), default=None)


def _stop(servo_id: int, field: str) -> ServoGoal:
    goal = ServoGoal(id=servo_id)
    setattr(goal, field, 0.0)
    return goal
