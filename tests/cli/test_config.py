"""``wackel config`` prints what is in force."""

import json
import re
from pathlib import Path

import pytest

from wackel_cli.config import main
from wackel_node.config import RobotConfig, dump, parse

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
ROBOTS = ["two-wheels", "mecanum", "steered-wheels"]
TEXT = '[buses.main]\nport = "/dev/ttyUSB0"\nservos = [{id = 3}]\n'


def test_the_defaults_alone_are_a_file_to_start_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    assert parse(capsys.readouterr().out) == RobotConfig()


@pytest.mark.parametrize("name", ROBOTS)
def test_the_robots_to_copy_from_are_right(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(EXAMPLES / f"{name}.toml")]) == 0
    config = parse(capsys.readouterr().out)
    assert config.robot == name
    assert config.drive is not None
    listed = {(bus, servo.id) for bus in config.buses for servo in config.buses[bus].servos}
    assert {servo for wheel in config.drive.wheels for servo in wheel.servos()} == listed


def test_the_robot_of_this_directory_is_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("robot.toml").write_text(TEXT)
    assert main([]) == 0
    assert parse(capsys.readouterr().out) == parse(TEXT)


def test_what_is_in_force_is_printed_with_every_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(TEXT)
    assert main([str(path)]) == 0
    text = capsys.readouterr().out
    assert parse(text) == parse(TEXT)
    assert "baud_rate = 1000000" in text
    assert "# nominal_voltage is absent" in text


def test_every_setting_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--explain"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    heads = [line for line in lines if line.startswith("[")]
    assert {"[buses.NAME]", "[[buses.NAME.servos]]", "[[drive.wheels]]"} <= {*heads}
    assert len(heads) == len({*heads})
    assert "  baud_rate             Bit/s. (default: 1000000)" in lines
    assert "  radius                Of the wheel, m." in lines
    settings = [line.split(maxsplit=1) for line in lines if re.match(r"  \w", line)]
    for name in dump(RobotConfig()).splitlines():
        key = name.removeprefix("# ").partition(" ")[0]
        if key and not key.startswith("["):
            assert any(setting[0] == key or f"[{key}]" in heads for setting in settings), key
    assert all(len(setting) == 2 and setting[1][0] != "(" for setting in settings)


def test_programs_get_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(TEXT)
    assert main([str(path), "--json"]) == 0
    config = json.loads(capsys.readouterr().out)
    assert config["buses"]["main"]["servos"][0]["id"] == 3
