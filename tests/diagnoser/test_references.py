"""Steering whose zero is wrong: how it forces the robot aside, and that it is named."""

import math

import numpy as np
import pytest

from tests.diagnoser.rig import Rig
from tests.odometry.simulation import steered_drive
from wackel_diagnoser.forced import ForcedMotion
from wackel_drive.layout import Layout
from wackel_kinematics.inverse import inverse

ERROR_RAD = 0.15


@pytest.mark.parametrize("count", [3, 4, 6])
def test_wheels_that_agree_are_forced_to_nothing(count: int) -> None:
    layout = Layout(steered_drive(count))
    drive = layout.drive
    motion = inverse(drive, np.array([0.4, 0.1, 0.5]), drive.steering(np.zeros(count)))
    speed = drive.roll_radius * motion.wheel_rate
    yaw, rolled = ForcedMotion(layout).predict(motion.steering[None, :], speed, np.zeros(3))
    assert yaw == pytest.approx([0.5], abs=1e-4)
    assert rolled[0] == pytest.approx(speed, abs=1e-4)


def test_a_wheel_that_stands_off_turns_the_robot_and_slows_it_on_both_sides_alike() -> None:
    layout = Layout(steered_drive(4))
    drive = layout.drive
    motion = inverse(drive, np.array([0.5, 0.0, 0.0]), drive.steering(np.zeros(4)))
    cases = np.tile(motion.steering, (2, 1))
    cases[0, 0] += ERROR_RAD  # front left, and
    cases[1, 3] -= ERROR_RAD  # front right, mirrored
    speed = drive.roll_radius * motion.wheel_rate
    yaw, rolled = ForcedMotion(layout).predict(cases, speed, np.zeros(3))
    assert abs(yaw[0]) > 0.01
    assert yaw[0] == pytest.approx(-yaw[1], rel=1e-6)
    assert np.abs(rolled).sum(axis=1) == pytest.approx(np.abs(rolled).sum(axis=1)[::-1])
    assert np.abs(rolled).sum() < 2 * np.abs(speed).sum()


@pytest.mark.parametrize("count", [3, 4])
def test_a_wrong_zero_is_named_with_its_angle_and_excluded(count: int) -> None:
    rig = Rig.of("tune/zero", count)
    rig.drive(10.0)
    assert rig.reports == []
    rig.inject("steering_reference_error", "w1", ERROR_RAD)
    for _ in range(20):
        rig.drive(1.0)
        if rig.active() == [("steering_reference", "wheel/w1/steering")]:
            break
    assert rig.active() == [("steering_reference", "wheel/w1/steering")]
    angle = rig.diagnoser.active()[0].evidence.values["angle_rad"]
    assert isinstance(angle, float)
    assert angle == pytest.approx(ERROR_RAD, abs=math.radians(5))
    assert rig.exclusions is not None
    assert [each.component for each in rig.exclusions.excluded] == ["wheel/w1/steering"]
