"""What driving costs, and what is left for slip."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_diagnoser.slip_power import SlipPower
from wackel_kinematics.array import Floats

NEEDS = np.array([0.07, 0.09, -0.01, 0.005])
"""Friction by speed, mass, turning, friction."""
WHEELS = 4
NUMBERS = st.sampled_from([math.nan, math.inf, 0.0, 1.0])


def moments(count: int) -> Floats:
    rng = np.random.default_rng(1)
    speed = rng.uniform(0.0, 1.0, (count, WHEELS))
    changes = rng.normal(0.0, 0.5, (count, 2))
    return np.column_stack([(speed**2).sum(axis=1), changes, speed.sum(axis=1)])


def taught(seconds: float = 20.0) -> SlipPower:
    power = SlipPower()
    for causes in moments(round(10 * seconds)):
        power.learn(float(NEEDS.dot(causes)), causes, 0.1)
    return power


TAUGHT = taught()


def test_what_driving_needs_is_taken_off_and_the_rest_is_by_mass() -> None:
    power = taught()
    for causes in moments(5):
        by_driving = float(NEEDS.dot(causes))
        assert power.left(by_driving, causes, WHEELS) == pytest.approx(0.0, abs=0.01)
        slipping = by_driving + 0.09 * WHEELS * 0.2
        assert power.left(slipping, causes, WHEELS) == pytest.approx(0.2, abs=0.02)


def test_nothing_is_known_before_some_driving_nor_without_any_acceleration() -> None:
    causes = moments(1)[0]
    assert math.isnan(taught(5.0).left(0.1, causes, WHEELS))
    steady = SlipPower()
    rng = np.random.default_rng(2)
    for _ in range(400):
        steady.learn(0.07 + float(rng.normal(0.0, 0.01)), np.array([1.0, 0.0, 0.0, 2.0]), 0.1)
    assert math.isnan(steady.left(0.1, causes, WHEELS))


@given(power=NUMBERS, causes=st.lists(NUMBERS, min_size=4, max_size=4))
def test_nonsense_teaches_nothing(power: float, causes: list[float]) -> None:
    one = moments(1)[0]
    before = TAUGHT.left(0.1, one, WHEELS)
    if not math.isfinite(power + sum(causes)):
        TAUGHT.learn(power, np.array(causes), 0.1)
    assert TAUGHT.left(0.1, one, WHEELS) == before
