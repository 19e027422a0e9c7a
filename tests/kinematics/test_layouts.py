"""The textbook formulas of common drives."""

import numpy as np
import pytest

from wackel_kinematics.forward import forward
from wackel_kinematics.inverse import inverse
from wackel_kinematics.layouts import (
    ackermann,
    differential,
    mecanum_rectangle,
    omni_circle,
    tricycle,
)

VX, VY, OMEGA = 0.7, -0.3, 0.9
TWIST = np.array([VX, VY, OMEGA])
ALONG = np.array([VX, 0.0, OMEGA])


def test_a_differential_drive_turns_by_the_difference_of_its_wheels() -> None:
    drive = differential(track_m=0.4, radius_m=0.1, castor_x_m=-0.3)
    twist, rank = forward(drive, np.zeros(3), np.array([2.0, 5.0, 0.0]))
    assert rank == 3
    np.testing.assert_allclose(twist, [(0.2 + 0.5) / 2, 0.0, (0.5 - 0.2) / 0.4], atol=1e-12)


def test_a_differential_drive_says_that_it_cannot_go_sideways() -> None:
    drive = differential(track_m=0.4, radius_m=0.1, castor_x_m=-0.3)
    motion = inverse(drive, TWIST, np.zeros(3))
    np.testing.assert_allclose(np.abs(motion.slip), [abs(VY), abs(VY), 0.0])
    np.testing.assert_allclose(
        motion.wheel_rate, [(VX - 0.2 * OMEGA) / 0.1, (VX + 0.2 * OMEGA) / 0.1, 0.0]
    )


def test_a_tricycle_steers_by_its_front_wheel_alone() -> None:
    drive = tricycle(wheelbase_m=0.5, track_m=0.4, radius_m=0.1)
    motion = inverse(drive, ALONG, drive.steering(np.zeros(3)))
    heading = np.arctan2(0.5 * OMEGA, VX)
    assert drive.heading(motion.steering)[0] == pytest.approx(heading)
    np.testing.assert_allclose(motion.wheel_rate, [np.hypot(VX, 0.5 * OMEGA) / 0.1, 0, 0])
    np.testing.assert_allclose(motion.slip, 0, atol=1e-12)
    twist, rank = forward(drive, motion.steering, motion.wheel_rate)
    assert rank == 3
    np.testing.assert_allclose(twist, ALONG, atol=1e-12)


def test_an_ackermann_drive_turns_the_inner_wheel_further() -> None:
    drive = ackermann(wheelbase_m=0.5, track_m=0.4, radius_m=0.1)
    motion = inverse(drive, ALONG, drive.steering(np.zeros(4)))
    inner, outer = drive.heading(motion.steering)[:2]
    centre_y = VX / OMEGA
    assert inner == pytest.approx(np.arctan2(0.5, centre_y - 0.2))
    assert outer == pytest.approx(np.arctan2(0.5, centre_y + 0.2))
    twist, rank = forward(drive, motion.steering, motion.wheel_rate)
    assert rank == 3
    np.testing.assert_allclose(twist, ALONG, atol=1e-12)


def test_a_mecanum_drive_mixes_all_three_velocities() -> None:
    drive = mecanum_rectangle(wheelbase_m=0.6, track_m=0.4, radius_m=0.1)
    motion = inverse(drive, TWIST, np.zeros(4))
    turn = (0.3 + 0.2) * OMEGA
    expected = [VX - VY - turn, VX + VY + turn, VX + VY - turn, VX - VY + turn]
    np.testing.assert_allclose(motion.wheel_rate, np.array(expected) / 0.1)
    np.testing.assert_array_equal(motion.slip, 0)
    twist, rank = forward(drive, np.zeros(4), motion.wheel_rate)
    assert rank == 3
    np.testing.assert_allclose(twist, TWIST, atol=1e-12)


@pytest.mark.parametrize("count", [3, 4, 6])
def test_an_omni_drive_rolls_tangentially(count: int) -> None:
    drive = omni_circle(count, l_m=0.25, radius_m=0.05)
    motion = inverse(drive, TWIST, np.zeros(count))
    angle = 2 * np.pi * np.arange(count) / count
    expected = (-np.sin(angle) * VX + np.cos(angle) * VY + 0.25 * OMEGA) / 0.05
    np.testing.assert_allclose(motion.wheel_rate, expected, atol=1e-12)
    twist, rank = forward(drive, np.zeros(count), motion.wheel_rate)
    assert rank == 3
    np.testing.assert_allclose(twist, TWIST, atol=1e-12)
