"""Goals are taken back when nobody renews them, and only those."""

from math import inf, nan

import pytest

from wackel_gateway.commands import Refused
from wackel_gateway.lapse import Lapse
from wackel_schemas.bus import BusCommand, ServoGoal

S = 1_000_000_000


def command(*goals: ServoGoal, holds_s: float | None = 0.5) -> BusCommand:
    return BusCommand(stamp=0, goals=list(goals), holds_s=holds_s)


def test_a_motor_is_told_to_stand_a_few_times_once_nobody_commands_it() -> None:
    lapse = Lapse()
    lapse.commanded(command(ServoGoal(id=1, velocity=2.0, position=1.0)), S)
    assert lapse.due_ns == 1_500_000_000
    assert lapse.taken_back(1_499_999_999) == []
    told = []
    while lapse.due_ns is not None:
        told.append(lapse.taken_back(lapse.due_ns))
    assert told == [[ServoGoal(id=1, velocity=0.0)]] * 3
    assert lapse.count == 1


def test_what_is_renewed_goes_on() -> None:
    lapse = Lapse()
    for tenth in range(100):
        now_ns = tenth * S // 10
        assert lapse.taken_back(now_ns) == []
        lapse.commanded(command(ServoGoal(id=1, velocity=2.0)), now_ns)
    assert lapse.count == 0


def test_a_command_while_it_is_told_to_stand_counts() -> None:
    lapse = Lapse()
    lapse.commanded(command(ServoGoal(id=1, velocity=2.0)), 0)
    assert lapse.taken_back(S) != []
    lapse.commanded(command(ServoGoal(id=1, velocity=1.0), holds_s=None), S)
    assert (lapse.due_ns, lapse.taken_back(9 * S)) == (None, [])


@pytest.mark.parametrize(
    "goal",
    [ServoGoal(id=1, position=1.0), ServoGoal(id=1, torque_enabled=True)],
    ids=["position", "torque"],
)
def test_each_goal_has_its_own_time(goal: ServoGoal) -> None:
    lapse = Lapse()
    moving = command(ServoGoal(id=1, current=0.3), ServoGoal(id=2, pwm=-0.1), holds_s=1.0)
    lapse.commanded(moving, 0)
    lapse.commanded(command(goal), S // 2)
    lapse.commanded(command(ServoGoal(id=2, pwm=0.2), holds_s=2.0), S // 2)
    assert lapse.taken_back(S) == [ServoGoal(id=1, current=0.0)]
    assert lapse.taken_back(3 * S)[-1] == ServoGoal(id=2, pwm=0.0)


def test_at_the_end_all_that_hold_for_a_time_are_taken_back() -> None:
    lapse = Lapse()
    lapse.commanded(command(ServoGoal(id=1, velocity=2.0), ServoGoal(id=2, pwm=0.1)), 0)
    lapse.commanded(command(ServoGoal(id=3, velocity=2.0), holds_s=None), 0)
    assert lapse.all_back() == [ServoGoal(id=1, velocity=0.0), ServoGoal(id=2, pwm=0.0)]
    assert (lapse.due_ns, lapse.all_back()) == (None, [])


def test_what_stands_need_not_be_stopped() -> None:
    lapse = Lapse()
    lapse.commanded(command(ServoGoal(id=1, velocity=2.0)), 0)
    lapse.commanded(command(ServoGoal(id=1, velocity=0.0)), 0)
    assert lapse.due_ns is None


@pytest.mark.parametrize("holds_s", [0.0, -1.0, 3601.0, 1e300, nan, inf, -inf])
def test_what_is_no_time_is_refused_and_changes_nothing(holds_s: float) -> None:
    lapse = Lapse()
    lapse.commanded(command(ServoGoal(id=1, velocity=2.0)), 0)
    with pytest.raises(Refused, match="no time to hold"):
        lapse.commanded(command(ServoGoal(id=1, velocity=3.0), holds_s=holds_s), 0)
    assert lapse.due_ns == S // 2
