"""Goals are taken back when nobody renews them, and only those."""

from math import inf, nan

import pytest

from wackel_gateway.command_timeouts import CommandTimeouts
from wackel_gateway.commands import Refused
from wackel_schemas.bus import BusCommand, ServoGoal

S = 1_000_000_000


def command(*goals: ServoGoal, timeout_s: float | None = 0.5) -> BusCommand:
    return BusCommand(stamp=0, goals=list(goals), timeout_s=timeout_s)


def test_a_motor_is_told_to_stand_a_few_times_once_nobody_commands_it() -> None:
    timeouts = CommandTimeouts()
    timeouts.commanded(command(ServoGoal(id=1, velocity=2.0, position=1.0)), S)
    assert timeouts.due_ns == 1_500_000_000
    assert timeouts.taken_back(1_499_999_999) == []
    told = []
    while timeouts.due_ns is not None:
        told.append(timeouts.taken_back(timeouts.due_ns))
    assert told == [[ServoGoal(id=1, velocity=0.0)]] * 3
    assert timeouts.count == 1


def test_what_is_renewed_goes_on() -> None:
    timeouts = CommandTimeouts()
    for tenth in range(100):
        now_ns = tenth * S // 10
        assert timeouts.taken_back(now_ns) == []
        timeouts.commanded(command(ServoGoal(id=1, velocity=2.0)), now_ns)
    assert timeouts.count == 0


def test_a_command_while_it_is_told_to_stand_counts() -> None:
    timeouts = CommandTimeouts()
    timeouts.commanded(command(ServoGoal(id=1, velocity=2.0)), 0)
    assert timeouts.taken_back(S) != []
    timeouts.commanded(command(ServoGoal(id=1, velocity=1.0), timeout_s=None), S)
    assert (timeouts.due_ns, timeouts.taken_back(9 * S)) == (None, [])


@pytest.mark.parametrize(
    "goal",
    [ServoGoal(id=1, position=1.0), ServoGoal(id=1, torque_enabled=True)],
    ids=["position", "torque"],
)
def test_each_goal_has_its_own_time(goal: ServoGoal) -> None:
    timeouts = CommandTimeouts()
    moving = command(ServoGoal(id=1, current=0.3), ServoGoal(id=2, pwm=-0.1), timeout_s=1.0)
    timeouts.commanded(moving, 0)
    timeouts.commanded(command(goal), S // 2)
    timeouts.commanded(command(ServoGoal(id=2, pwm=0.2), timeout_s=2.0), S // 2)
    assert timeouts.taken_back(S) == [ServoGoal(id=1, current=0.0)]
    assert timeouts.taken_back(3 * S)[-1] == ServoGoal(id=2, pwm=0.0)


def test_at_the_end_all_that_hold_for_a_time_are_taken_back() -> None:
    timeouts = CommandTimeouts()
    timeouts.commanded(command(ServoGoal(id=1, velocity=2.0), ServoGoal(id=2, pwm=0.1)), 0)
    timeouts.commanded(command(ServoGoal(id=3, velocity=2.0), timeout_s=None), 0)
    assert timeouts.all_back() == [ServoGoal(id=1, velocity=0.0), ServoGoal(id=2, pwm=0.0)]
    assert (timeouts.due_ns, timeouts.all_back()) == (None, [])


def test_what_stands_need_not_be_stopped() -> None:
    timeouts = CommandTimeouts()
    timeouts.commanded(command(ServoGoal(id=1, velocity=2.0)), 0)
    timeouts.commanded(command(ServoGoal(id=1, velocity=0.0)), 0)
    assert timeouts.due_ns is None


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, 3601.0, 1e300, nan, inf, -inf])
def test_what_is_no_time_is_refused_and_changes_nothing(timeout_s: float) -> None:
    timeouts = CommandTimeouts()
    timeouts.commanded(command(ServoGoal(id=1, velocity=2.0)), 0)
    with pytest.raises(Refused, match="no timeout"):
        timeouts.commanded(command(ServoGoal(id=1, velocity=3.0), timeout_s=timeout_s), 0)
    assert timeouts.due_ns == S // 2
