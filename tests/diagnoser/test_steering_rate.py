"""How fast the steering can turn, from how fast it has."""

import math
from collections.abc import Container
from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_diagnoser.steering_rate import LEAST, MOST, SteeringRate

ENCODER_STEP = 2 * math.pi / 4096
STEP_S = 0.01


def turns(
    rate: float, seconds: float, late_s: list[float] | None = None, lost: Container[int] = ()
) -> SteeringRate:
    """One of two steerings turns, after a second of rest.

    Args:
        rate: rad/s.
        seconds: For how long.
        late_s: By how much stamps are later than readings, in turn.
        lost: Which readings are.
    """
    learnt = SteeringRate(2, ENCODER_STEP)
    late = late_s or [0.0]
    count = round((1.0 + seconds) / STEP_S)
    readings = [
        (
            i * STEP_S + late[i % len(late)],
            ENCODER_STEP * round(max(i * STEP_S - 1.0, 0.0) * rate / ENCODER_STEP),
        )
        for i in range(count + 1)
        if i not in lost
    ]
    for (begin, before), (end, after) in pairwise(readings):
        learnt.step([0.0, after - before], end - begin)
    return learnt


@pytest.mark.parametrize("rate", [-6.28, 2.5, 6.28, 15.0])
def test_it_is_known_before_a_quarter_turn_is_over(rate: float) -> None:
    assert turns(rate, math.pi / 2 / abs(rate)).now == pytest.approx(abs(rate), rel=0.01)


@given(
    rate=st.floats(3.0, 15.0),
    seed=st.integers(0, 2**32),
    most_s=st.floats(0.0, 0.0049),
    losses=st.floats(0.0, 0.1),
)
def test_late_stamps_and_lost_readings_do_not_make_it_faster(
    rate: float, seed: int, most_s: float, losses: float
) -> None:
    random = Random(seed)
    late = [random.choice((0.0, random.uniform(0.0, most_s))) for _ in range(97)]
    lost = {i for i in range(201) if random.random() < losses}
    assert turns(rate, 1.0, late, lost).now <= 1.005 * rate


@given(rate=st.floats(3.0, 15.0), seed=st.integers(0, 2**32))
def test_stamps_late_by_more_than_half_a_step_hardly_do(rate: float, seed: int) -> None:
    """The worst of 100 000 random robots: by 1.7 %."""
    random = Random(seed)
    late = [random.choice((0.0, random.uniform(0.0, 0.006))) for _ in range(97)]
    assert turns(rate, 1.0, late).now <= 1.05 * rate


def test_late_stamps_leave_it_known_to_a_twentieth() -> None:
    random = Random(1)
    late = [random.choice((0.0, random.uniform(0.0, 0.004))) for _ in range(97)]
    assert turns(6.28, 0.5, late).now > 0.95 * 6.28


def test_a_lost_reading_is_no_late_stamp() -> None:
    assert turns(6.28, 0.5, lost={90}).now == pytest.approx(6.28, rel=0.01)


@pytest.mark.parametrize("angle", [0.05, 0.15, 1.0, math.nan, math.inf])
def test_a_reading_that_jumps_is_no_turn(angle: float) -> None:
    learnt = turns(3.0, 0.5)
    before = learnt.now
    for turned in (0.03, angle, 0.03, 0.0, angle, -angle, angle, 0.0):
        learnt.step([0.0, turned], STEP_S)
    assert learnt.now <= before


def test_what_no_servo_reaches_is_no_turn() -> None:
    assert turns(1.5 * MOST, 0.5).now == LEAST


def test_a_servo_that_becomes_slower_is_followed() -> None:
    learnt = turns(6.0, 0.5)
    for _ in range(3600):
        learnt.step([0.0, 0.0], 0.5)
    assert LEAST <= learnt.now < 0.9 * 6.0
