"""Goals become sync writes, or are refused as a whole with a reason."""

from math import inf, nan, pi

import pytest

from wackel_gateway.commands import Refused, writes
from wackel_gateway.roster import Roster
from wackel_node.config import ServoConfig
from wackel_protocols.dynamixel2.packet import sync_write
from wackel_schemas.bus import ServoGoal

ROSTER = Roster(
    [
        ServoConfig(id=1),
        ServoConfig(id=2),
        ServoConfig(id=3, model="PH54-200-S500"),
        ServoConfig(id=4, model="XL-320"),
    ]
)


def test_goals_of_one_kind_travel_in_one_instruction() -> None:
    goals = [ServoGoal(id=1, position=0.0), ServoGoal(id=2, position=pi / 2)]
    data = {1: (2048).to_bytes(4, "little"), 2: (3072).to_bytes(4, "little")}
    assert writes(goals, ROSTER) == [sync_write(116, 4, data)]


def test_torque_comes_before_goals_and_servos_with_other_registers_apart() -> None:
    goals = [
        ServoGoal(id=1, velocity=-1.0, torque_enabled=True),
        ServoGoal(id=3, torque_enabled=False),
    ]
    first, second, third = writes(goals, ROSTER)
    assert first == sync_write(64, 1, {1: b"\x01"})
    assert second == sync_write(512, 1, {3: b"\x00"})
    assert third == sync_write(104, 4, {1: (-42).to_bytes(4, "little", signed=True)})


@pytest.mark.parametrize(
    ("goals", "reason"),
    [
        ([], "empty command"),
        ([ServoGoal(id=1)], "empty command"),
        ([ServoGoal(id=9, position=0.0)], "unknown servo"),
        ([ServoGoal(id=1, position=nan)], "not a number"),
        ([ServoGoal(id=1, velocity=inf)], "not a number"),
        ([ServoGoal(id=1, position=1e300)], "out of range"),
        ([ServoGoal(id=4, position=3.0)], "out of range"),
        ([ServoGoal(id=4, current=0.1)], "no such register"),
        ([ServoGoal(id=1, position=0.0), ServoGoal(id=1, position=1.0)], "double goal"),
        ([ServoGoal(id=1, position=0.0), ServoGoal(id=2, position=nan)], "not a number"),
    ],
)
def test_what_is_not_possible_is_refused_with_a_reason(goals: list[ServoGoal], reason: str) -> None:
    with pytest.raises(Refused) as refusal:
        writes(goals, ROSTER)
    assert refusal.value.reason == reason
