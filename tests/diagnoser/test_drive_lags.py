"""Lags of drives, from what they are told and what they show."""

import math

import pytest

from wackel_diagnoser.drive_lags import LAGS_S, DriveLags

STEP_S = 0.01
MOST_RAD = 0.03
"""A step; each turn below is held up by it at first."""
BOTH = (True, True)


@pytest.mark.parametrize("lag_s", [0.02, 0.057, 0.1])
@pytest.mark.parametrize("every", [1, 3, 8, 20])
def test_the_lag_of_a_steering_that_turns_no_faster_than_it_can_is_learnt(
    lag_s: float, every: int
) -> None:
    lags, at = DriveLags(1, 1), 0.0
    lags.begin([at, 0.0])
    for step in range(4000):
        begin, goal = at, 0.3 * (-1) ** (step // 37)
        at += min(max((at - goal) * math.expm1(-STEP_S / lag_s), -MOST_RAD), MOST_RAD)
        held = abs(at - begin) >= MOST_RAD
        middle = 0.5 * (begin + at) if held else goal - lag_s / STEP_S * (at - begin)
        lags.follow([goal, 0.0], STEP_S, MOST_RAD)
        if step % every == 0:
            lags.learn([middle, 0.0], every * STEP_S, BOTH, slowed=False)
            lags.choose([at, 0.0])
    steering_s, _ = lags.used_s
    assert steering_s == pytest.approx(lag_s, rel=0.1)


def test_what_is_not_known_teaches_nothing() -> None:
    lags = DriveLags(1, 1)
    before = list(lags.used_s)
    for _ in range(1000):
        lags.follow([1.0, 1.0], STEP_S, MOST_RAD)
        lags.learn([math.nan, 1.0], STEP_S, BOTH, slowed=False)
        assert lags.choose([0.0, 0.0]) == [0.0, 0.0]
    assert lags.used_s == before


def test_a_lag_lies_within_those_that_are_tried() -> None:
    lags = DriveLags(1, 1)
    lags.begin([0.0, 0.0])
    for turn in range(200):
        goal = 0.3 * (-1) ** turn
        for _ in range(10):  # it never moves
            lags.follow([goal, goal], STEP_S, MOST_RAD)
            lags.learn([0.0, 0.0], STEP_S, BOTH, slowed=False)
            lags.choose([0.0, 0.0])
    assert lags.used_s == [LAGS_S[-1], LAGS_S[-1]]


def test_what_has_arrived_teaches_no_lag() -> None:
    lags = DriveLags(1, 1)
    before = lags.used_s[0]
    for turn in range(200):
        goal = 0.3 * (-1) ** turn
        for _ in range(10):  # neither moves, but one of them has nothing to do but what is rounded
            lags.follow([0.0005, goal], STEP_S, MOST_RAD)
            lags.learn([0.0, 0.0], STEP_S, (False, True), slowed=False)
            lags.choose([0.0, 0.0])
    assert lags.used_s == [before, LAGS_S[-1]]
