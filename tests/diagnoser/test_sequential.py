"""When the diagnoser speaks up: not for an outlier, but as soon as what is clear may be said."""

import numpy as np
import pytest

from tests.diagnoser.rig import GYRO
from tests.odometry.simulation import differential_drive, steered_drive
from wackel_diagnoser.core import RATE
from wackel_diagnoser.hypotheses import SINGLE, Hypotheses
from wackel_diagnoser.sequential import Sequential, threshold
from wackel_drive.layout import Layout
from wackel_node.config_drive import DriveConfig, GyroConfig

STEP_S = 1 / RATE
CLEAR = 1e3
DRIVES = [differential_drive(), steered_drive(3), steered_drive(4), steered_drive(8)]


def healthy(config: DriveConfig) -> tuple[Sequential, int, int]:
    """After ten seconds without a fault; and numbers of a gyro's hypothesis and its explanation."""
    hypotheses = Hypotheses(Layout(config), {GYRO: GyroConfig()})
    limit = threshold(len(hypotheses), RATE)
    sequential = Sequential(hypotheses.prior, hypotheses.explanation, limit)
    sound = np.full(len(hypotheses), -CLEAR)
    sound[0] = 0.0
    for _ in range(1000):
        sequential.step(sound, STEP_S)
    explanation = hypotheses.explanations.index((f"gyro/{GYRO}",))
    (number,) = hypotheses.members[explanation]
    assert hypotheses.prior[number] == SINGLE
    return sequential, int(number), explanation


@pytest.mark.parametrize("config", DRIVES)
def test_three_outliers_raise_no_alarm_and_a_fourth_step_names_what_is_clear(
    config: DriveConfig,
) -> None:
    sequential, number, explanation = healthy(config)
    faulty = np.full(len(sequential.sums), -CLEAR)
    faulty[number] = 0.0
    for _ in range(3):
        sequential.step(faulty, STEP_S)
        assert sequential.alarm < 1.0
        assert sequential.proposal() is None
    sequential.step(faulty, STEP_S)
    assert sequential.proposal() == explanation


def test_a_look_stands_for_the_steps_that_were_passed_over() -> None:
    each, once = (healthy(steered_drive(4))[0] for _ in range(2))
    likelihood = np.zeros(len(each.sums))
    likelihood[1] = 2.0
    for _ in range(4):
        each.step(likelihood, STEP_S)
    once.step(likelihood, 4 * STEP_S, 4)
    assert once.sums == pytest.approx(each.sums)
    assert not once.at_rest


def test_a_look_that_stands_for_many_steps_is_one_outlier_at_most() -> None:
    sequential, number, _ = healthy(steered_drive(4))
    faulty = np.full(len(sequential.sums), -CLEAR)
    faulty[number] = 0.0
    for _ in range(3):
        sequential.step(faulty, 4 * STEP_S, 4)
        assert sequential.alarm < 1.0
