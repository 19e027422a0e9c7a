"""Wheels that stand though they are told to roll."""

from collections.abc import Sequence

import pytest

from wackel_diagnoser.standing import STANDS_S, Standing, stand

STEP_S = 0.01
STANDS_STEPS = round(STANDS_S / STEP_S) + 1


def standing(
    told: Sequence[float], rolled: Sequence[float], present: Sequence[bool] = (True,) * 3
) -> Standing:
    """After just long enough."""
    wheels = Standing(len(told))
    for _ in range(STANDS_STEPS):
        wheels.step(told, rolled, STEP_S, present)
    return wheels


def test_a_wheel_stands_if_it_does_not_follow_for_some_time() -> None:
    wheels = Standing(3)
    for _ in range(STANDS_STEPS - 2):
        wheels.step((0.5, 0.5, 0.5), (0.5, 0.0, 0.5), STEP_S, (True,) * 3)
        assert wheels.rows() == []
    wheels.step((0.5, 0.5, 0.5), (0.5, 0.0, 0.5), STEP_S, (True,) * 3)
    wheels.step((0.5, 0.5, 0.5), (0.5, 0.0, 0.5), STEP_S, (True,) * 3)
    assert wheels.rows() == [1]
    wheels.step((0.5, 0.5, 0.5), (0.5, 0.4, 0.5), STEP_S, (True,) * 3)
    assert wheels.rows() == []


@pytest.mark.parametrize(
    ("told", "rolled", "present"),
    [
        ((0.5, 0.5, 0.5), (0.0, 0.0, 0.0), (True, True, True)),
        ((0.5, 0.01, 0.5), (0.5, 0.0, 0.5), (True, True, True)),
        ((0.5, 0.5, 0.5), (0.5, 0.0, 0.5), (True, False, True)),
        ((0.5, float("nan"), 0.5), (0.5, 0.0, 0.5), (True, True, True)),
    ],
    ids=["all stand, as after an emergency stop", "hardly told to roll", "not heard", "unknown"],
)
def test_nothing_is_claimed_where_it_cannot_be_told(
    told: Sequence[float], rolled: Sequence[float], present: Sequence[bool]
) -> None:
    assert standing(told, rolled, present).rows() == []


def test_where_one_wheel_holds_all_the_others_are_not_counted_as_standing() -> None:
    wheels = standing((0.2, 0.2, 0.2), (0.0, 0.0, 0.0))
    for _ in range(STANDS_STEPS // 2):
        wheels.step((0.5, 0.5, 0.5), (0.0, 0.0, 0.5), STEP_S, (True,) * 3)
    assert wheels.rows() == []


def test_how_a_wheel_came_to_rest_is_no_evidence_when_it_rolls_again() -> None:
    wheels = standing((0.5, 0.5, 0.5), (0.5, 0.0, 0.5))
    assert wheels.rows() == [1]
    wheels.step((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), STEP_S, (True,) * 3)
    assert wheels.rows() == []


def test_a_wheel_follows_that_loses_no_more_than_a_motor_under_load() -> None:
    wheels = standing((0.5, -0.5, 0.5), (0.45, -0.45, 0.3))
    assert [wheels.follows(roll) for roll in range(3)] == [True, True, False]


def test_a_wheel_has_stood_that_rolls_again_but_not_one_that_turned_round() -> None:
    wheels = Standing(3)
    wheels.step((0.5, 0.5, 0.5), (0.0, 0.5, 0.5), STEP_S, (True,) * 3)
    for _ in range(5):
        wheels.step((0.5, 0.5, 0.5), (0.5, 0.0, 0.5), STEP_S, (True,) * 3)
    for _ in range(100):
        wheels.step((0.5, 0.5, 0.5), (0.5, 0.5, 0.5), STEP_S, (True,) * 3)
    assert [wheels.stood(roll) for roll in range(3)] == [False, True, False]


def test_nothing_is_known_of_a_wheel_at_the_beginning() -> None:
    wheels = standing((0.5, 0.5, 0.5), (0.5, 0.0, 0.5))
    wheels.begin()
    assert wheels.rows() == []
    assert not any(wheels.follows(roll) or wheels.stood(roll) for roll in range(3))


def test_of_those_that_are_told_to_roll_some_stand_now() -> None:
    told, rolled = (0.5, -0.5, 0.01, 0.5, float("nan")), (0.02, -0.4, 0.0, 0.0, 0.0)
    assert stand(told, rolled, (True, True, True, False, True)) == {0: True, 1: False}
