"""Lags of drives, from what they are told and what they show."""

import math
from random import Random

import pytest

from wackel_diagnoser.drive_lags import LAGS_S, DriveLags
from wackel_diagnoser.pace import Pace

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
        lags.follow([goal, 0.0], STEP_S, MOST_RAD, 0.0)
        if step % every == 0:
            lags.learn([middle, 0.0], every * STEP_S, BOTH, slowed=False)
            lags.choose([at, 0.0])
    steering_s, _ = lags.used_s
    assert steering_s == pytest.approx(lag_s, rel=0.1)


@pytest.mark.parametrize("seed", range(6))
def test_steps_that_took_another_time_than_stamps_say_do_not_hide_the_lag(seed: int) -> None:
    lags, random, lag_s = DriveLags(1, 1), Random(seed), 0.1
    pace, now, late_s = Pace(), 0.8, 0.0
    lags.begin([0.0, now])
    for step in range(200):  # it brakes, and one in four stamps is up to 2 ms late
        begin, goal = now, 0.8 - 0.005 * step
        now = goal + (begin - goal) * math.exp(-STEP_S / lag_s)
        middle = goal - lag_s / STEP_S * (now - begin)
        before_s, late_s = late_s, random.choice((0.0, 0.0, 0.0, random.uniform(0.0, 0.002)))
        seconds = STEP_S + late_s - before_s
        lags.follow([0.0, goal], seconds, MOST_RAD, pace.off_s(seconds))
        if step % 8 == 0:
            lags.learn([0.0, middle * STEP_S / seconds], 8 * STEP_S, (False, True), slowed=False)
            lags.choose([0.0, now])
    _, rolling_s = lags.used_s
    assert rolling_s == pytest.approx(lag_s, rel=0.05)


def test_what_is_not_known_teaches_nothing() -> None:
    lags = DriveLags(1, 1)
    before = list(lags.used_s)
    for _ in range(1000):
        lags.follow([1.0, 1.0], STEP_S, MOST_RAD, 0.0)
        lags.learn([math.nan, math.nan], STEP_S, BOTH, slowed=False)
        assert lags.choose([0.0, 0.0]) == [0.0, 0.0]
    assert lags.used_s == before
    assert lags.learnt == [False, False]


def test_servos_that_are_heard_teach_for_those_that_are_not() -> None:
    lags, lag_s, at = DriveLags(2, 1), 0.1, 0.0
    lags.begin([at, at, 0.0])
    for step in range(400):
        begin, goal = at, 0.3 * (-1) ** (step // 37)
        at += (at - goal) * math.expm1(-STEP_S / lag_s)
        lags.follow([goal, goal, 0.0], STEP_S, math.inf, 0.0)
        middle = goal - lag_s / STEP_S * (at - begin)
        lags.learn([math.nan, middle, math.nan], STEP_S, BOTH, slowed=False)
        lags.choose([at, at, 0.0])
    steering_s, _ = lags.used_s
    assert steering_s == pytest.approx(lag_s, rel=0.05)
    assert lags.learnt == [True, False]


def test_a_steering_that_is_not_known_does_not_begin_anew_and_is_learnt_even_so() -> None:
    """When it has turned faster than was known; another may have shown that."""
    lags, lag_s, at = DriveLags(1, 1), 0.02, 0.0
    lags.begin([at, 0.0])
    for step in range(400):
        begin, goal = at, 0.03 * (-1) ** (step // 37)
        at += (at - goal) * math.expm1(-STEP_S / lag_s)
        if step == 5:
            lags.turn_faster([math.nan])
        lags.follow([goal, 0.0], STEP_S, math.inf, 0.0)
        lags.learn([goal - lag_s / STEP_S * (at - begin), 0.0], STEP_S, BOTH, slowed=False)
        lags.choose([at, 0.0])
    assert lags.used_s[0] == pytest.approx(lag_s, rel=0.1)


def test_a_lag_lies_within_those_that_are_tried() -> None:
    lags = DriveLags(1, 1)
    lags.begin([0.0, 0.0])
    for turn in range(200):
        goal = 0.3 * (-1) ** turn
        for _ in range(10):  # it never moves
            lags.follow([goal, goal], STEP_S, MOST_RAD, 0.0)
            lags.learn([0.0, 0.0], STEP_S, BOTH, slowed=False)
            lags.choose([0.0, 0.0])
    assert lags.used_s == [LAGS_S[-1], LAGS_S[-1]]


def test_what_has_arrived_teaches_no_lag() -> None:
    lags = DriveLags(1, 1)
    before = lags.used_s[0]
    for turn in range(200):
        goal = 0.3 * (-1) ** turn
        for _ in range(10):  # neither moves, but one of them has nothing to do but what is rounded
            lags.follow([0.0005, goal], STEP_S, MOST_RAD, 0.0)
            lags.learn([0.0, 0.0], STEP_S, (False, True), slowed=False)
            lags.choose([0.0, 0.0])
    assert lags.used_s == [before, LAGS_S[-1]]
