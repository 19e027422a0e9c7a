"""The paper's four steps, on its own robot and numbers (n = 3)."""

import math
from collections.abc import Sequence
from operator import and_

import numpy as np
import pytest

from tests.odometry.simulation import steered_drive
from wackel_diagnoser.steps import Judgement, PaperSteps
from wackel_drive.layout import Layout
from wackel_kinematics.inverse import inverse

CIRCLE = (1.5, 0.0, 1.5)
"""The paper's: 1.5 m/s on a circle of 1 m."""


def judged(
    *,
    rate_of_3: float = 1.0,
    others: float = 1.0,
    beta_off: float = 0.0,
    yaw: float = 1.5,
    command: Sequence[float] = CIRCLE,
    motion: Sequence[float] = CIRCLE,
) -> Judgement:
    layout = Layout(steered_drive(3))
    drive = layout.drive
    told = inverse(drive, np.array(motion), drive.steering(np.zeros(3)))
    rate = told.wheel_rate * np.array([others, others, rate_of_3])
    beta = told.steering + np.array([0.0, 0.0, beta_off])
    goal = drive.heading(told.steering).tolist()
    return PaperSteps(layout).judge(drive.heading(beta).tolist(), rate.tolist(), goal, command, yaw)


def test_nothing_wrong_gives_the_signature_of_zeros() -> None:
    found = judged()
    assert PaperSteps.signature(found) == "000000"
    assert found.redundancy == []
    assert found.components == []
    assert "agree with the command" in found.texts["II"]


def test_the_oscillating_rate_of_wheel_3_gives_the_papers_signature() -> None:
    found = judged(rate_of_3=0.7)
    assert PaperSteps.signature(found) == "000101"
    assert found.components == ["wheel/w2/drive"]
    assert found.fault == "sensor"  # all others and the gyro match the command
    named = {step.step: step.components for step in PaperSteps.steps(found)}
    assert named == {"I": []} | {step: ["wheel/w2/drive"] for step in ("II", "III", "IV")}


def test_wheel_3_blocked_spoils_all_candidates_and_step_3_names_it() -> None:
    found = judged(rate_of_3=0.0, others=0.7, yaw=0.06)
    assert PaperSteps.signature(found) == "111111"
    assert found.components == ["wheel/w2/drive"]
    assert found.fault == "actuator"
    assert "drive of wheel w2" in found.texts["III"]
    conditions = {each.component: (each.agree, each.apart) for each in found.redundancy}
    assert len(conditions) == 6
    assert conditions["wheel/w2/drive"] == (True, True)
    assert list(conditions.values()).count((True, True)) == 1
    # The signature of all candidates is no component's, so Step II names none.
    assert [each.components for each in PaperSteps.steps(found)[:2]] == [[], []]


def test_a_robot_that_is_too_slow_as_a_whole_accuses_no_component() -> None:
    # Straight ahead some axles coincide, and all candidates that are left share one steering.
    ahead = (0.5, 0.0, 0.0)
    found = judged(rate_of_3=0.8, others=0.8, yaw=0.0, command=ahead, motion=ahead)
    assert any(found.coincident)
    assert found.matched == ["wheel/w1/steering"]
    assert "agree with each other" in found.texts["III"]
    assert (found.components, found.fault) == ([], "")
    assert "IV" not in found.texts


def test_a_steering_that_stands_off_gives_its_signature() -> None:
    found = judged(beta_off=math.radians(10))
    assert PaperSteps.signature(found) == "001111"
    assert found.components == ["wheel/w2/steering"]


def test_a_pair_whose_axles_coincide_is_left_out() -> None:
    layout = Layout(steered_drive(4))
    drive = layout.drive
    ahead = (0.5, 0.0, 0.0)
    motion = inverse(drive, np.array(ahead), drive.steering(np.zeros(4)))
    steps = PaperSteps(layout)
    heading = drive.heading(motion.steering).tolist()
    found = steps.judge(heading, motion.wheel_rate.tolist(), heading, ahead, 0.0)
    assert any(found.coincident)
    assert not any(map(and_, found.deviates, found.coincident))
    assert "(B)" in found.texts["I"]
    shown = steps.candidates(found)
    assert {each.singular for each in shown} == {"", "B"}


def test_without_a_command_nothing_is_said_of_it() -> None:
    found = judged(command=(math.nan,) * 3)
    assert found.components == []
    assert "No command" in found.texts["II"]


@pytest.mark.parametrize("yaw", [math.nan])
def test_without_a_gyro_step_4_says_so(yaw: float) -> None:
    assert "No gyro" in judged(rate_of_3=0.5, yaw=yaw).texts["IV"]
