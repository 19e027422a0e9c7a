"""Where the diagnoser is part of a robot, and what it says of one beforehand."""

import json
import re
from pathlib import Path

import pytest

from tests.odometry.simulation import BUS, differential_drive, steered_drive
from wackel_aggregator.service import needed_services
from wackel_cli.up import robot_jobs
from wackel_diagnoser.explain import main
from wackel_node.config import BusConfig, ConfigError, RobotConfig, ServoConfig, dump
from wackel_node.config_drive import DriveConfig, GyroConfig

BUSES = {BUS: BusConfig(port="p")}


def names(config: RobotConfig) -> list[str]:
    return [job.name for job in robot_jobs(config, Path("robot.toml"))]


def robot(drive: DriveConfig, *, gyro: bool = True) -> RobotConfig:
    ids = sorted({servo for wheel in drive.wheels for _, servo in wheel.servos()})
    bus = BusConfig(port="p", servos=[ServoConfig(id=i) for i in ids])
    return RobotConfig(buses={BUS: bus}, drive=drive, gyros={"body": GyroConfig()} if gyro else {})


def explained(config: RobotConfig, directory: Path, *more: str) -> int:
    path = directory / "robot.toml"
    path.write_text(dump(config), encoding="utf-8")
    return main([str(path), *more])


def test_a_robot_with_wheels_runs_the_diagnoser_and_needs_it() -> None:
    config = RobotConfig(buses=BUSES, drive=differential_drive())
    assert "diagnoser/main" in names(config)
    assert "diagnoser/main" in needed_services(config)


def test_a_robot_without_wheels_does_without() -> None:
    assert "diagnoser/main" not in names(RobotConfig(buses=BUSES))
    assert "diagnoser/main" not in needed_services(RobotConfig(buses=BUSES))


def test_four_steered_wheels_and_a_gyro_tell_everything_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert explained(robot(steered_drive(4)), tmp_path, "--json") == 0
    faults = [json.loads(line) for line in _lines(capsys)]
    components = {
        *(f"wheel/w{i}/{part}" for i in range(4) for part in ("drive", "steering")),
        "gyro/body",
    }
    for commanded in (True, False):
        assert {f["component"] for f in faults if f["commanded"] is commanded} == components
    for fault in faults:
        motions = fault["motions"].values()
        assert any(seen["seen_s"] is not None and not seen["like"] for seen in motions)


def test_help_tells_what_each_key_of_the_json_means(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert explained(robot(differential_drive()), tmp_path, "--json") == 0
    fault = json.loads(_lines(capsys)[0])
    with pytest.raises(SystemExit):
        main(["--help"])
    words = re.findall(r"\w+", capsys.readouterr().out)
    for key in (*fault, *next(iter(fault["motions"].values()))):
        assert key in words


def test_two_wheels_look_alike_where_nobody_says_what_they_should_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert explained(robot(differential_drive()), tmp_path) == 0
    told, untold = "\n".join(_lines(capsys)).split("Where nobody publishes that:")
    assert "looks like" not in told
    assert (
        "The drive of wheel left\n    looks like the drive of wheel right in straight ahead"
    ) in untold
    assert "no motion tried would tell" in untold


def test_without_a_gyro_it_says_what_is_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert explained(robot(differential_drive(), gyro=False), tmp_path) == 0
    text = "\n".join(_lines(capsys))
    assert "without a gyro" in text
    assert "The drive of wheel left" in text
    assert "sideways" not in text  # it cannot go there


@pytest.mark.parametrize(("wheels", "told"), [(3, False), (4, True)])
def test_it_says_which_two_faults_at_once_cannot_be_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wheels: int, *, told: bool
) -> None:
    assert explained(robot(steered_drive(wheels)), tmp_path) == 0
    text = "\n".join(_lines(capsys))
    assert ("two faulty steerings leave too few measurements" in text) is not told
    assert "two faulty drives" not in text
    assert "a gyro that jumps is not accused beside a wheel" in text


def test_a_robot_without_wheels_cannot_be_explained(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no \\[drive\\]"):
        explained(RobotConfig(), tmp_path)


def _lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().out.splitlines()
