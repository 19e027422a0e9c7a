"""How much wheels may slip, though nothing is wrong."""

import math

import numpy as np
import pytest

from tests.odometry.simulation import differential_drive, steered_drive
from wackel_drive.layout import Layout
from wackel_odometry.slip import CREEP_S, MOST_M_S2, PULLED, SETTLING_S, STEERING_S, Slip

STEP_S = 0.01
ROLLS = [0.5] * 4
STRAIGHT = [0.0] * 4


def creep(speed: float, omega: float, hastens: float) -> float:
    """Standard deviation at a speed, a yaw rate and an acceleration straight on, m/s."""
    slip = Slip(Layout(steered_drive(4)))
    found = 0.0
    for number in range(200):
        twist = np.array([speed + hastens * number * STEP_S, 0.0, omega])
        found = math.sqrt(slip.creep(twist, STEP_S))
    return found


def test_tyres_creep_by_what_hastens_the_robot() -> None:
    assert creep(0.5, 0.0, 0.0) == pytest.approx(0.0, abs=1e-6)
    assert creep(0.5, 0.0, 0.4) == pytest.approx(CREEP_S * 0.4, rel=0.01)


def test_and_by_what_keeps_it_on_a_circle() -> None:
    assert creep(0.5, 2.0, 0.0) == pytest.approx(CREEP_S * 1.0, rel=0.01)


def test_but_by_no_more_than_before_they_skid() -> None:
    assert creep(0.5, 0.0, 1000.0) == pytest.approx(CREEP_S * MOST_M_S2)


def test_wheels_that_turn_pull_each_other_and_for_a_while_after() -> None:
    slip = Slip(Layout(steered_drive(4)))
    assert slip.pull(ROLLS, STRAIGHT, STEP_S) == 0.0
    turned = slip.pull(ROLLS, [0.02] * 4, STEP_S)
    assert math.sqrt(turned) == pytest.approx(PULLED * 0.5 * STEERING_S * 2.0)
    later = slip.pull(ROLLS, STRAIGHT, STEP_S)
    assert math.sqrt(later / turned) == pytest.approx(math.exp(-STEP_S / SETTLING_S))


def test_a_steering_that_is_not_heard_of_goes_on_settling() -> None:
    slip = Slip(Layout(steered_drive(4)))
    slip.pull(ROLLS, [0.02] * 4, STEP_S)
    assert 0.0 < slip.pull(ROLLS, [math.nan] * 4, STEP_S) < math.inf


def test_wheels_that_do_not_steer_do_not_pull_each_other() -> None:
    slip = Slip(Layout(differential_drive()))
    assert slip.pull([0.5, 0.5], [math.nan, math.nan], STEP_S) == 0.0
