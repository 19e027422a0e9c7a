import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.geometry import moving_drives, ring, steering_of, twists
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.inverse import STANDSTILL_M_S, inverse, steering_rate, wheel_goals
from wackel_kinematics.layouts import ackermann
from wackel_kinematics.planar import instantaneous_centre

TWIST = np.array([0.5, -0.2, 0.8])


@settings(max_examples=50)
@given(moving_drives(), st.data())
def test_no_wheel_ever_turns_by_more_than_a_quarter(
    moving: tuple[Drive, Floats], data: st.DataObject
) -> None:
    drive, twist = moving
    now = data.draw(steering_of(drive))
    motion = inverse(drive, twist, now)
    assert np.abs(motion.steering - now).max() <= math.pi / 2 + 1e-12


@settings(max_examples=50)
@given(moving_drives(), st.data())
def test_a_wheel_that_stands_right_stays_put(
    moving: tuple[Drive, Floats], data: st.DataObject
) -> None:
    drive, twist = moving
    first = inverse(drive, twist, data.draw(steering_of(drive)))
    second = inverse(drive, twist, first.steering)
    np.testing.assert_allclose(second.steering, first.steering, atol=1e-12)


@settings(max_examples=50)
@given(moving_drives(), st.data())
def test_goals_of_one_twist_are_those_of_many(
    moving: tuple[Drive, Floats], data: st.DataObject
) -> None:
    drive, (vx, vy, omega) = moving
    now = data.draw(steering_of(drive))
    many = inverse(drive, np.array([[vx, vy, omega]]), now)
    heading, rate = wheel_goals(drive, (vx, vy, omega), drive.heading(now).tolist())
    np.testing.assert_allclose(heading, drive.heading(many.steering)[0], atol=1e-9)
    np.testing.assert_allclose(rate, many.wheel_rate[0], atol=1e-9)


def test_reversing_turns_the_wheels_backward_and_steers_nothing() -> None:
    drive = ring(3)
    ahead = inverse(drive, TWIST, np.zeros(3))
    back = inverse(drive, -TWIST, ahead.steering)
    np.testing.assert_allclose(back.steering, ahead.steering)
    np.testing.assert_allclose(back.wheel_rate, -ahead.wheel_rate)


def test_standstill_keeps_the_angles() -> None:
    drive = ring(4)
    now = np.array([0.1, -7.0, 3.0, 12.0])
    motion = inverse(drive, np.zeros(3), now)
    np.testing.assert_array_equal(motion.steering, now)
    np.testing.assert_array_equal(motion.wheel_rate, 0)


def test_rounding_at_rest_steers_nothing() -> None:
    drive = ring(4)
    now = np.array([0.1, -7.0, 3.0, 12.0])
    crawl = np.array([0.0, STANDSTILL_M_S / 2, 0.0])
    np.testing.assert_array_equal(inverse(drive, crawl, now).steering, now)


def test_a_wheel_at_the_centre_of_rotation_keeps_its_angle_while_the_others_steer() -> None:
    drive = ring(3)
    x, y = drive.xy[0]
    now = np.array([0.4, 0.4, 0.4])
    motion = inverse(drive, np.array([y, -x, 1.0]), now)
    assert motion.steering[0] == now[0]
    assert motion.wheel_rate[0] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(motion.slip, 0, atol=1e-12)
    assert np.abs(motion.wheel_rate[1:]).min() > 1


def test_steering_is_continuous_over_many_turns_of_the_direction() -> None:
    drive = ring(4)
    steering = inverse(drive, np.array([1.0, 0.0, 0.0]), np.zeros(4)).steering
    begin = steering
    directions = np.linspace(0, 6 * math.pi, 2000)
    for direction in directions:
        motion = inverse(drive, np.array([np.cos(direction), np.sin(direction), 0.0]), steering)
        assert np.abs(motion.steering - steering).max() < 0.01
        steering = motion.steering
    np.testing.assert_allclose(steering - begin, 6 * math.pi)


def test_a_centre_of_rotation_that_passes_a_contact_makes_no_jump() -> None:
    """Straight through the contact, where the velocity of the wheel flips by π."""
    drive = ring(3)
    x, y = drive.xy[0]
    steering = inverse(drive, np.array([y + 0.2, -x, 1.0]), np.zeros(3)).steering
    rates = []
    for offset in np.linspace(0.2, -0.2, 401):
        motion = inverse(drive, np.array([y + offset, -x, 1.0]), steering)
        assert np.abs(motion.steering - steering).max() < 0.01
        steering = motion.steering
        rates.append(motion.wheel_rate[0])
    assert np.abs(np.diff(rates)).max() < 0.025
    assert rates[0] * rates[-1] < 0


def test_a_limited_step_is_kept_and_leads_there_in_the_end() -> None:
    drive = ring(3)
    target = inverse(drive, TWIST, np.zeros(3)).steering
    steering = np.zeros(3)
    for _ in range(40):
        motion = inverse(drive, TWIST, steering, max_step_rad=0.05)
        assert np.abs(motion.steering - steering).max() <= 0.05 + 1e-12
        steering = motion.steering
    np.testing.assert_allclose(steering, target)


def test_a_wheel_not_yet_turned_rolls_at_the_projection_and_owns_up_to_the_slip() -> None:
    drive = ring(3)
    now = inverse(drive, np.array([1.0, 0.0, 0.0]), np.zeros(3)).steering
    motion = inverse(drive, np.array([1.0, 1.0, 0.0]), now, max_step_rad=0.0)
    np.testing.assert_allclose(np.abs(motion.wheel_rate) * 0.05, 1.0)
    np.testing.assert_allclose(np.abs(motion.slip), 1.0)


@settings(max_examples=100)
@given(moving_drives(), twists, st.data())
def test_feed_forward_is_the_slope_of_the_steering(
    moving: tuple[Drive, Floats], rate: Floats, data: st.DataObject
) -> None:
    drive, twist = moving
    now = inverse(drive, twist, data.draw(steering_of(drive))).steering
    step = 1e-6
    slope = (
        inverse(drive, twist + step * rate, now).steering
        - inverse(drive, twist - step * rate, now).steering
    ) / (2 * step)
    np.testing.assert_allclose(steering_rate(drive, twist, rate), slope, rtol=1e-4, atol=1e-4)


def test_feed_forward_is_zero_at_rest_and_for_a_constant_twist() -> None:
    drive = ring(3)
    np.testing.assert_array_equal(steering_rate(drive, np.zeros(3), np.ones(3)), 0)
    np.testing.assert_array_equal(steering_rate(drive, TWIST, np.zeros(3)), 0)


def test_feed_forward_is_zero_for_wheels_that_do_not_steer() -> None:
    drive = ackermann(wheelbase_m=0.5, track_m=0.4, radius_m=0.1)
    rate = steering_rate(drive, np.array([0.7, 0.0, 0.9]), np.array([0.0, 0.1, 0.5]))
    assert (rate != 0).tolist() == [True, True, False, False]


@settings(max_examples=50)
@given(moving_drives().filter(lambda moving: bool(abs(moving[1][2]) > 0.01)))
def test_every_axle_passes_through_the_instantaneous_centre(moving: tuple[Drive, Floats]) -> None:
    drive, twist = moving
    motion = inverse(drive, twist, np.zeros(drive.n))
    axle = drive.alpha + motion.steering
    to_centre = instantaneous_centre(twist) - drive.xy
    beside = np.cos(axle) * to_centre[:, 1] - np.sin(axle) * to_centre[:, 0]
    np.testing.assert_allclose(beside, 0, atol=1e-9)


def test_a_recording_gives_what_its_samples_give() -> None:
    drive = ring(4)
    path = np.linspace([1.0, -1.0, 0.5], [-1.0, 0.5, 2.0], 5)
    now = np.linspace(-3, 3, 20).reshape(5, 4)
    together = inverse(drive, path, now)
    rates = steering_rate(drive, path, path[::-1])
    for i in range(5):
        for whole, alone in zip(together, inverse(drive, path[i], now[i]), strict=True):
            np.testing.assert_array_equal(whole[i], alone)
        np.testing.assert_array_equal(rates[i], steering_rate(drive, path[i], path[4 - i]))


def test_one_steering_serves_a_batch_of_twists() -> None:
    drive = ring(3)
    assert inverse(drive, np.ones((7, 3)), np.zeros(3)).steering.shape == (7, 3)
    assert inverse(drive, np.ones(3), np.zeros((7, 3))).wheel_rate.shape == (7, 3)


@pytest.mark.parametrize("step", [-0.1, math.nan])
def test_a_limit_that_is_none_is_rejected(step: float) -> None:
    with pytest.raises(ValueError, match="max_step_rad is"):
        inverse(ring(3), TWIST, np.zeros(3), max_step_rad=step)


def test_a_twist_of_the_wrong_size_is_rejected() -> None:
    drive = ring(3)
    with pytest.raises(ValueError, match="twist has shape"):
        inverse(drive, np.ones(2), np.zeros(3))
    with pytest.raises(ValueError, match="twist rate has shape"):
        steering_rate(drive, np.ones(3), np.ones(4))
