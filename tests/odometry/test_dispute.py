"""Who is right where the gyros contradict all wheels."""

import pytest

from wackel_odometry.dispute import FORGOTTEN, MOST_RAD_S2, SKIDS_S, Dispute

STEP_S = 0.01


def lasts(dispute: Dispute, seconds: float, off: float = 0.5, *, dragged: bool = False) -> float:
    """For how long wheels are held to be wrong, s."""
    steps = range(round(seconds / STEP_S))
    return STEP_S * sum(dispute.skids([False], [off], STEP_S, dragged=dragged) for _ in steps)


def agree(dispute: Dispute, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        assert not dispute.skids([True], [0.0], STEP_S, dragged=True)


def test_the_gyro_is_believed_for_as_long_as_something_may_push() -> None:
    assert lasts(Dispute(), 0.3) == pytest.approx(0.3)
    assert lasts(Dispute(), 3.0) == pytest.approx(SKIDS_S, abs=2 * STEP_S)


def test_one_that_contradicts_again_and_again_is_not_believed_for_ever() -> None:
    dispute = Dispute()
    lasts(dispute, 2 * SKIDS_S)
    agree(dispute, 1.0)
    assert lasts(dispute, 1.0) < SKIDS_S / 2
    agree(dispute, 2 / FORGOTTEN)
    assert lasts(dispute, 1.0) == pytest.approx(SKIDS_S, abs=2 * STEP_S)


def test_a_gyro_that_jumps_as_no_robot_does_is_not_believed() -> None:
    assert lasts(Dispute(), 0.3, 0.9 * MOST_RAD_S2 * STEP_S) == pytest.approx(0.3)
    assert lasts(Dispute(), 0.3, 1.1 * MOST_RAD_S2 * STEP_S) == 0.0


def test_while_a_wheel_drags_the_others_the_gyro_is_believed_throughout() -> None:
    assert lasts(Dispute(), 10.0, dragged=True) == pytest.approx(10.0)


def test_wheels_are_not_wrong_while_one_of_the_gyros_agrees_or_there_is_none() -> None:
    dispute = Dispute()
    assert not dispute.skids([False, True], [0.5, 0.0], STEP_S, dragged=True)
    assert not dispute.skids([], [], STEP_S, dragged=True)
    assert dispute.skids([False, False], [0.5, 0.6], STEP_S, dragged=False)
