"""A robot that is not quite as configured drives, is recorded, and is calibrated from that."""

import json
from pathlib import Path

import msgspec
import pytest

from tests import robot as robots
from tests.end_to_end.command import wackel
from tests.odometry.simulation import steered_drive
from wackel_node.config import RecorderConfig, ServoConfig

pytestmark = pytest.mark.process

DRIVEN_S = "15"


def test_the_measures_of_a_virtual_robot_are_found_from_its_true_path(tmp_path: Path) -> None:
    config = robots.chain(tmp_path, 0, return_delay_us=0)
    servos = [ServoConfig(id=i) for i in (0, 100, 1, 101, 2, 102)]
    config = msgspec.structs.replace(
        config,
        buses={"main": msgspec.structs.replace(config.buses["main"], servos=servos)},
        drive=steered_drive(3, steering_error=0.02),  # drawn for the true robot as large as that
        recorder=RecorderConfig(directory=str(tmp_path / "recordings")),
    )
    path, truth = robots.write(config, tmp_path), tmp_path / "path.csv"
    virtual = ("wackel_virtual", "--config", str(path), "--seed", "2", "--truth", str(truth))
    with (
        robots.process(*virtual, log=tmp_path / "virtual.log"),
        robots.running(config, tmp_path, "--record", virtual=False) as robot,
    ):
        robot.wait(robot.ready, 60.0)
        drive = ("pilot", "--config", str(path), "--path", "eight", "--for", DRIVEN_S)
        done = wackel(*drive, "--radius", "0.5", "--speed", "0.5", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    calibrate = ("calibrate", str(tmp_path / "recordings"), "--truth", str(truth), "--json")
    done = wackel(*calibrate, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["verdict"] == "confirmed"
    assert told["calibrated"]["position_m"] < 0.5 * told["configured"]["position_m"]
