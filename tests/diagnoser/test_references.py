"""Steering whose zero is wrong: how it forces the robot aside, and that it is named."""

import math

import numpy as np
import pytest

from tests.diagnoser.rig import WARM_UP_S, Rig
from tests.odometry.simulation import steered_drive
from wackel_diagnoser.findings import UNSURE
from wackel_diagnoser.forced import GRIP_M_S2, ForcedMotion
from wackel_drive.layout import Layout
from wackel_kinematics.inverse import inverse
from wackel_virtual.build import Build
from wackel_virtual.drive_simulation import Cycle

ERROR_RAD = 0.15


@pytest.mark.parametrize("count", [3, 4, 6])
def test_wheels_that_agree_are_forced_to_nothing(count: int) -> None:
    layout = Layout(steered_drive(count))
    drive = layout.drive
    motion = inverse(drive, np.array([0.4, 0.1, 0.5]), drive.steering(np.zeros(count)))
    speed = drive.roll_radius * motion.wheel_rate
    heading = drive.heading(motion.steering)
    forced = ForcedMotion(layout).predict(heading[None, :], speed, np.zeros(3))
    assert forced.yaw == pytest.approx([0.5], abs=1e-4)
    assert forced.rolled[0] == pytest.approx(speed, abs=1e-4)
    assert np.vecdot(forced.force, forced.rolled) == pytest.approx([0.0], abs=1e-3)


def test_a_wheel_that_stands_off_turns_the_robot_and_slows_it_on_both_sides_alike() -> None:
    layout = Layout(steered_drive(4))
    drive = layout.drive
    motion = inverse(drive, np.array([0.5, 0.0, 0.0]), drive.steering(np.zeros(4)))
    cases = np.tile(drive.heading(motion.steering), (2, 1))
    cases[0, 0] += ERROR_RAD  # front left, and
    cases[1, 3] -= ERROR_RAD  # front right, mirrored
    speed = drive.roll_radius * motion.wheel_rate
    forced = ForcedMotion(layout).predict(cases, speed, np.zeros(3))
    yaw, rolled = forced.yaw, forced.rolled
    assert abs(yaw[0]) > 0.01
    assert yaw[0] == pytest.approx(-yaw[1], rel=1e-6)
    assert np.abs(rolled).sum(axis=1) == pytest.approx(np.abs(rolled).sum(axis=1)[::-1])
    assert np.abs(rolled).sum() < 2 * np.abs(speed).sum()


@pytest.mark.parametrize("wheel", range(4))
def test_the_motors_pay_for_what_one_wheel_slips(wheel: int) -> None:
    layout = Layout(steered_drive(4))
    drive = layout.drive
    motion = inverse(drive, np.array([0.5, 0.1, 0.4]), drive.steering(np.zeros(4)))
    speed = drive.roll_radius * motion.wheel_rate
    cases = drive.heading(motion.steering)[None, :]
    cases[0, wheel] += ERROR_RAD
    forced = ForcedMotion(layout).predict(cases, speed, np.zeros(3))
    slipped = GRIP_M_S2 / 4 * abs(speed[wheel]) * math.sin(ERROR_RAD)
    assert np.vecdot(forced.force, forced.rolled) == pytest.approx([slipped], rel=0.2)


def test_forces_of_a_moment_ago_lead_to_the_same_motion() -> None:
    layout = Layout(steered_drive(4))
    drive = layout.drive
    forced = ForcedMotion(layout)
    motion = inverse(drive, np.array([0.5, 0.0, 0.3]), drive.steering(np.zeros(4)))
    cases = drive.heading(motion.steering) + np.diag([ERROR_RAD] * 4)
    speed = drive.roll_radius * motion.wheel_rate
    before = forced.predict(cases, speed, np.zeros(3))
    now, anew = (
        forced.predict(cases + 0.02, 1.05 * speed, np.array([0.5, 0.0, 0.0]), start)
        for start in (before, None)
    )
    assert now.yaw == pytest.approx(anew.yaw, abs=0.01)
    assert now.rolled == pytest.approx(anew.rolled, abs=0.004)


def test_a_floor_on_which_all_wheels_roll_hard_is_no_wrong_zero() -> None:
    """A carpet costs each motor as much as a wheel that stands 9° off, by its speed."""
    rig = Rig.of("tune/carpet")
    rig.drive(12.0)
    simulate = rig.simulation.step

    def on_carpet(vx: float, vy: float, omega: float) -> Cycle:
        cycle = simulate(vx, vy, omega)
        for servo in cycle.state.servos[:4]:
            assert servo.current is not None
            assert servo.velocity is not None
            servo.current += math.copysign(0.03, servo.velocity)
        return cycle

    rig.simulation.step = on_carpet  # type: ignore[method-assign]
    rig.drive(8.0)
    assert rig.reports == []


def test_bad_calibration_that_deceives_for_as_long_as_a_motion_lasts_is_no_wrong_zero() -> None:
    rig = Rig.of("judge/mujoco/4/lines/0", 4, worse=3.0, physics="mujoco", driving="lines")
    rig.drive(23.0)
    assert rig.reports == []


def test_bad_calibration_at_which_two_wheels_pull_alike_is_no_wrong_zero() -> None:
    rig = Rig.of("alarms/501", 4, worse=3.0, physics="mujoco", build=Build(lag_s=0.0645))
    rig.drive(70.0)
    assert rig.reports == []


@pytest.mark.parametrize("count", [3, 4])
def test_a_wrong_zero_is_named_with_its_angle_and_excluded(count: int) -> None:
    rig = Rig.of("tune/zero", count)
    rig.drive(WARM_UP_S)
    assert rig.reports == []
    rig.inject("steering_reference_error", "w1", ERROR_RAD)
    for _ in range(25):
        rig.drive(1.0)
        if rig.active() == [("steering_reference", "wheel/w1/steering")]:
            break
    assert rig.active() == [("steering_reference", "wheel/w1/steering")]
    angle = rig.diagnoser.active()[0].evidence.values["angle_rad"]
    assert isinstance(angle, float)
    assert angle == pytest.approx(ERROR_RAD, abs=math.radians(5))
    assert rig.exclusions is not None
    assert [each.component for each in rig.exclusions.excluded] == ["wheel/w1/steering"]


def test_before_it_is_named_it_is_said_that_what_seems_wrong_may_be_a_zero() -> None:
    """At first three wheels whose readings agree seem to convict the gyro."""
    rig = Rig.of("z/0", 3)
    rig.drive(WARM_UP_S)
    rig.inject("steering_reference_error", "w2", -0.2)
    for _ in range(25):
        rig.drive(1.0)
        if rig.active() == [("steering_reference", "wheel/w2/steering")]:
            break
    told = [each for each in rig.reports if each.code == "gyro_deviates"]
    assert [each.status for each in told] == ["active"] * (len(told) - 1) + ["healed"]
    assert told[-1].suspects[0] == "wheel/w2/steering"
    assert told[-1].confidence <= UNSURE


def test_a_gyro_that_jumps_is_not_taken_for_a_zero() -> None:
    rig = Rig.of("tune/zero", 3)
    rig.drive(WARM_UP_S)
    rig.inject("gyro_offset", value=0.1)
    rig.drive(10.0)
    (report,) = rig.reports
    assert (report.code, report.suspects) == ("gyro_deviates", [])


def test_a_zero_that_was_wrong_from_the_start_is_not_learnt_as_usual() -> None:
    rig = Rig.of("tune22/fast/3/2", 3)
    rig.inject("steering_reference_error", "w0", math.radians(9))
    rig.drive(50.0)
    assert rig.active() == [("steering_reference", "wheel/w0/steering")]


def test_a_steering_whose_sensor_is_off_has_no_wrong_zero_as_well() -> None:
    rig = Rig.of("tune/long/fast/3/0", 3)
    rig.drive(20.0)
    rig.inject("steering_sensor_offset", "w1", math.radians(4))
    rig.drive(15.0)
    assert rig.active() == [("steering_sensor", "wheel/w1/steering")]
