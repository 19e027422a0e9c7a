"""``wackel config`` prints what is in force."""

import json
from pathlib import Path

import pytest

from wackel_cli.config import main
from wackel_node.config import RobotConfig, parse

TEXT = '[buses.main]\nport = "/dev/ttyUSB0"\nservos = [{id = 3}]\n'


def test_the_defaults_alone_are_a_file_to_start_from(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    assert parse(capsys.readouterr().out) == RobotConfig()


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


def test_programs_get_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(TEXT)
    assert main([str(path), "--json"]) == 0
    config = json.loads(capsys.readouterr().out)
    assert config["buses"]["main"]["servos"][0]["id"] == 3
