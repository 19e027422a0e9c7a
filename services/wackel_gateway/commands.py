"""Goal values to sync writes: checked first, so that a command is carried out whole or not at all.

A half-done command moves one leg and not the other; a refused one is told with its reason.
"""

from collections.abc import Sequence
from math import isfinite

from wackel_gateway.roster import Roster
from wackel_protocols.dynamixel2.control_table import Model, Register
from wackel_protocols.dynamixel2.packet import sync_write
from wackel_schemas.bus import ServoGoal

# In the order of writing: a motor that is switched on holds where it is before it gets its goal.
_REGISTERS = {
    "torque_enabled": "torque_enable",
    "current": "goal_current",
    "pwm": "goal_pwm",
    "velocity": "goal_velocity",
    "position": "goal_position",
}


MOST_TOLD = 300
"""Characters: a request may be long, what is said of it not."""


class Refused(ValueError):
    """A command or request that is not carried out.

    Attributes:
        reason: Short and without values, to be counted by: ``unknown servo``.
    """

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(f"{reason}: {text}"[:MOST_TOLD])
        self.reason = reason


def writes(goals: Sequence[ServoGoal], roster: Roster) -> list[bytes]:
    """The instructions that carry out a command, one for each kind of goal and place of registers.

    Raises:
        Refused: At least one goal is not possible.
    """
    if not goals:
        raise Refused("empty command", "it has no goals")
    values: dict[tuple[int, int], dict[int, bytes]] = {}
    for field, name in _REGISTERS.items():
        for goal in goals:
            value: float | bool | None = getattr(goal, field)
            table = roster.model(goal.id)
            if table is None:
                raise Refused("unknown servo", f"{goal.id} is not on this bus")
            if value is None:
                continue
            register = _register(table, name, goal.id)
            group = values.setdefault((register.address, register.length), {})
            if goal.id in group:
                raise Refused("double goal", f"servo {goal.id} has two goals for {field}")
            group[goal.id] = _encoded(register, float(value), goal.id)
    if not values:
        raise Refused("empty command", "no goal has a value")
    return [sync_write(address, length, data) for (address, length), data in values.items()]


def _register(table: Model, name: str, servo_id: int) -> Register:
    register = table.registers.get(name)
    if register is None:
        raise Refused("no such register", f"servo {servo_id} ({table.name}) has no {name}")
    return register


def _encoded(register: Register, value: float, servo_id: int) -> bytes:
    if not isfinite(value):
        raise Refused("not a number", f"{register.name} of servo {servo_id} is {value}")
    try:
        return register.encode(register.from_si(value))
    except (ValueError, OverflowError) as error:
        raise Refused("out of range", f"servo {servo_id}: {error}") from error
