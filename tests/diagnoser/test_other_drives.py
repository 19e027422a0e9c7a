"""Drives that are not all of steered wheels: what each can tell, and that it tells no more."""

from random import Random

import pytest

from tests.diagnoser.fleet import COMPLAINTS
from tests.diagnoser.rig import SHORT_WARM_UP_S, WARM_UP_S, Rig
from tests.odometry.simulation import other_drives
from wackel_virtual.build import Build

DRIVES = other_drives()
ROLLS = {"tricycle": "w0", "ackermann": "w2", "mecanum": "w1", "omni": "w2"}


def rig(name: str, driving: str = "random") -> Rig:
    return Rig.of(f"tune/{name}", DRIVES[name], driving=driving)


@pytest.mark.parametrize("driving", ["jumps", "random"])
@pytest.mark.parametrize("name", DRIVES)
def test_a_sound_robot_that_skids_as_it_is_told_has_no_fault(name: str, driving: str) -> None:
    robot = rig(name, driving)
    robot.drive(40.0)
    assert [
        (report.code, report.component)
        for report in robot.reports
        if not report.code.startswith("command")
    ] == []


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        ("wheel_blocked", "wheel_blocked"),
        ("wheel_free", "wheel_free"),
        ("drive_sensor_stuck", "wheel_sensor"),
    ],
)
@pytest.mark.parametrize("name", DRIVES)
def test_a_faulty_drive_is_named_alone(name: str, kind: str, code: str) -> None:
    robot, wheel = rig(name), ROLLS[name]
    robot.drive(SHORT_WARM_UP_S)
    assert robot.reports == []
    robot.inject(kind, wheel)
    robot.drive(4.0)
    assert robot.active() == [(code, f"wheel/{wheel}/drive")]


@pytest.mark.parametrize("name", DRIVES)
def test_a_gyro_that_jumps_is_named(name: str) -> None:
    robot = rig(name)
    robot.drive(SHORT_WARM_UP_S)
    robot.inject("gyro_offset", value=0.3)
    robot.drive(4.0)
    assert robot.active() == [("gyro_deviates", "gyro/body")]


def test_a_robot_that_still_skids_when_its_gyro_seems_wrong_has_a_sound_one() -> None:
    seed = "2ecc0f6e053057ec/other/ackermann/5"
    robot = Rig.of(seed, DRIVES["ackermann"], driving="hard", build=Build.drawn(Random(seed)))
    robot.drive(15.0)
    assert "gyro_deviates" not in {report.code for report in robot.reports}


def test_one_wheel_that_drags_another_in_vain_is_no_fault_of_the_gyro() -> None:
    robot = rig("ackermann")
    robot.drive(SHORT_WARM_UP_S)
    robot.inject("wheel_blocked", "w3")
    robot.drive(8.0)
    assert robot.active() == [("wheel_blocked", "wheel/w3/drive")]


@pytest.mark.parametrize("name", ["omni", "mecanum"])
def test_beside_a_free_wheel_of_three_or_four_with_rollers_no_other_can_be_told(name: str) -> None:
    robot = rig(name)
    robot.drive(WARM_UP_S)
    robot.inject("wheel_loose", "w1")
    robot.drive(5.0)
    assert robot.active() == [("wheel_free", "wheel/w1/drive")]


def test_wheels_with_rollers_that_are_mounted_askew_are_no_fault_of_the_gyro() -> None:
    """They turn the robot in each direction otherwise, and no row shows their own."""
    rig = Rig.of("judge30/other/mecanum/4", other_drives()["mecanum"], driving="lines")
    rig.drive(80.0)
    assert rig.reports == []


@pytest.mark.parametrize(
    ("seed", "name", "driving", "seconds"),
    [
        ("a9fa1a40e910b998/other/omni/8", "omni", "circles", 37.0),  # about it, then another way
        ("x1/other/mecanum/33", "mecanum", "jumps", 8.0),
    ],
)
def test_of_a_wheel_that_has_hardly_rolled_it_is_not_known_how_it_follows(
    seed: str, name: str, driving: str, seconds: float
) -> None:
    robot = Rig.of(seed, DRIVES[name], driving=driving, build=Build.drawn(Random(seed)))
    robot.drive(seconds)
    assert {report.code for report in robot.reports} <= set(COMPLAINTS)
