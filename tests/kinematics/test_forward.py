import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.geometry import moving_drives, ring, steered_drives, steering_of
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.forward import forward, least_squares, residuals
from wackel_kinematics.inverse import inverse

TWIST = np.array([0.5, -0.2, 0.8])


@settings(max_examples=100)
@given(moving_drives(), st.data())
def test_forward_undoes_inverse_from_any_steering(
    moving: tuple[Drive, Floats], data: st.DataObject
) -> None:
    drive, twist = moving
    motion = inverse(drive, twist, data.draw(steering_of(drive)))
    estimate = forward(drive, motion.steering, motion.wheel_rate)
    assert estimate.rank == 3
    np.testing.assert_allclose(estimate.twist, twist, atol=1e-8)
    np.testing.assert_allclose(motion.slip, 0, atol=1e-12)


@settings(max_examples=50)
@given(st.data())
def test_no_other_twist_leaves_smaller_residuals(data: st.DataObject) -> None:
    drive = data.draw(steered_drives)
    rows = drive.rows(data.draw(steering_of(drive)))
    values = drive.values(data.draw(steering_of(drive)))
    weights = np.linspace(0.5, 2.0, 2 * drive.n)
    twist, rank = least_squares(rows, values, drive.length_m, weights)
    assert rank == 3
    rest = residuals(rows, values, twist)
    np.testing.assert_allclose(rows.T @ (weights * rest), 0, atol=1e-9)


def test_a_dropped_row_has_no_say() -> None:
    drive = ring(3)
    motion = inverse(drive, TWIST, np.zeros(3))
    lying = motion.wheel_rate + np.array([0.0, 0.0, 50.0])
    kept = np.array([1, 1, 1, 1, 1, 0.0])
    np.testing.assert_allclose(forward(drive, motion.steering, lying, kept).twist, TWIST)
    rest = residuals(drive.rows(motion.steering), drive.values(lying), TWIST)
    np.testing.assert_allclose(rest, [0, 0, 0, 0, 0, 50 * 0.05], atol=1e-12)


def test_what_no_row_sees_is_zero_and_not_counted() -> None:
    drive = ring(3)
    motion = inverse(drive, TWIST, np.zeros(3))
    only_slide = np.array([1, 1, 1, 0, 0, 0.0])
    estimate = forward(drive, motion.steering, motion.wheel_rate, only_slide)
    assert estimate.rank == 2
    np.testing.assert_allclose(estimate.twist, 0, atol=1e-12)
    nothing = forward(drive, motion.steering, motion.wheel_rate, np.zeros(6))
    assert nothing.rank == 0
    np.testing.assert_array_equal(nothing.twist, 0)


def test_rows_that_weigh_next_to_nothing_determine_nothing() -> None:
    drive = ring(3)
    motion = inverse(drive, TWIST, np.zeros(3))
    weights = np.array([1, 1, 1, 1e-14, 1e-14, 1e-14])
    assert forward(drive, motion.steering, motion.wheel_rate, weights).rank == 2


def test_a_recording_gives_what_its_samples_give() -> None:
    drive = ring(4)
    steering = np.linspace(-3, 3, 20).reshape(5, 4)
    rate = np.linspace(-5, 5, 20).reshape(5, 4)
    weights = np.linspace(0, 1, 40).reshape(5, 8)
    together = forward(drive, steering, rate, weights)
    for i in range(5):
        alone = forward(drive, steering[i], rate[i], weights[i])
        np.testing.assert_allclose(together.twist[i], alone.twist, atol=1e-12)
        assert together.rank[i] == alone.rank


def test_one_steering_serves_a_recording_of_wheel_rates() -> None:
    twist, rank = forward(ring(4), np.zeros(4), np.ones((5, 4)))
    assert twist.shape == (5, 3)
    assert rank.tolist() == [3] * 5


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_wheel_rates_that_are_no_numbers_are_rejected(bad: float) -> None:
    drive = ring(3)
    with pytest.raises(ValueError, match="must be finite"):
        forward(drive, np.zeros(3), np.array([1.0, bad, 1.0]))


def test_steering_and_weights_that_are_no_numbers_are_rejected() -> None:
    drive = ring(3)
    with pytest.raises(ValueError, match="must be finite"):
        forward(drive, np.array([np.nan, 0.0, 0.0]), np.ones(3))
    with pytest.raises(ValueError, match="must be finite"):
        forward(drive, np.zeros(3), np.ones(3), np.array([np.nan, 1, 1, 1, 1, 1]))


def test_negative_weights_are_rejected() -> None:
    with pytest.raises(ValueError, match="negative"):
        forward(ring(3), np.zeros(3), np.ones(3), np.array([-1.0, 1, 1, 1, 1, 1]))
