"""Who is right where the gyros contradict all wheels."""

import pytest

from wackel_odometry.dispute import FORGOTTEN, MOST_RAD_S2, SKIDS_S, Dispute

STEP_S = 0.01


def said(dispute: Dispute, seconds: float, off: float = 0.5, *, dragged: bool = False) -> list[str]:
    """Who is wrong while a gyro contradicts, step by step."""
    steps = range(round(seconds / STEP_S))
    return [dispute.step([0.5], [off], STEP_S, dragged=dragged) for _ in steps]


def agree(dispute: Dispute, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        dispute.settle(STEP_S)


def test_the_gyro_is_believed_for_as_long_as_wheels_may_skid() -> None:
    dispute = Dispute()
    assert set(said(dispute, 0.3)) == {"wheels"}
    assert dispute.open
    assert dispute.turned_rad == pytest.approx(0.5 * 0.3)
    agree(dispute, STEP_S)
    assert not dispute.open
    assert dispute.turned_rad == 0.0


def test_after_that_it_turns_out_once_that_it_was_the_gyro() -> None:
    dispute = Dispute()
    found = said(dispute, 2 * SKIDS_S)
    assert found.count("gyros") == 1
    assert found.index("gyros") == pytest.approx(SKIDS_S / STEP_S, abs=1)
    assert set(found[found.index("gyros") + 1 :]) == {""}
    assert dispute.turned_rad == pytest.approx(0.5 * SKIDS_S, rel=0.01)
    assert not dispute.open


def test_one_that_contradicts_again_and_again_is_believed_for_shorter() -> None:
    dispute = Dispute()
    said(dispute, SKIDS_S / 2)
    agree(dispute, 1.0)
    assert said(dispute, 2 * SKIDS_S).count("wheels") * STEP_S < 0.6 * SKIDS_S
    agree(dispute, 1.1 * SKIDS_S / FORGOTTEN)
    assert said(dispute, 2 * SKIDS_S).count("wheels") * STEP_S == pytest.approx(SKIDS_S, rel=0.02)


def test_a_gyro_that_jumps_as_no_robot_does_is_not_believed() -> None:
    assert set(said(Dispute(), 0.3, 0.9 * MOST_RAD_S2 * STEP_S)) == {"wheels"}
    assert set(said(Dispute(), 0.3, 1.1 * MOST_RAD_S2 * STEP_S)) == {""}


def test_while_a_wheel_drags_the_others_the_gyro_is_believed_throughout() -> None:
    dispute = Dispute()
    assert set(said(dispute, 3 * SKIDS_S, dragged=True)) == {"wheels"}
    assert dispute.turned_rad == 0.0
