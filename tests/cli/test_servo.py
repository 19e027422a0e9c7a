"""``wackel servo`` against a running robot."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import robot
from tests.conftest import wait_until
from wackel_cli.servo import main
from wackel_node.errors import Explained
from wackel_node.session import NotReached

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """robot.toml of a robot that runs."""
    directory = tmp_path_factory.mktemp("servo")
    config = robot.chain(directory, 3)
    with robot.running(config, directory) as running:
        running.wait(running.ready)
        yield directory / "robot.toml"


def test_a_servo_is_pinged_read_written_and_rebooted(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = ["--config", str(path)]
    assert main(["ping", "2", *config]) == 0
    assert "model number 1030" in capsys.readouterr().out
    assert main(["write", "2", "led", "1", *config]) == 0
    assert main(["read", "2", "led", "--json", *config]) == 0
    assert json.loads(capsys.readouterr().out.partition("\n")[2])["value"] == 1
    assert main(["reboot", "2", *config]) == 0
    assert "rebooted" in capsys.readouterr().out


def test_several_servos_are_asked_one_after_the_other(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = ["--config", str(path)]
    wait_until(lambda: main(["ping", "all", *config]) == 0)  # one may have been rebooted
    capsys.readouterr()
    assert main(["reboot", "all", *config]) == 0
    assert capsys.readouterr().out.count("rebooted") == 3
    wait_until(lambda: main(["ping", "all", *config]) == 0)
    capsys.readouterr()
    assert main(["read", "1-2,3", "id", "--json", *config]) == 0
    assert [reply["value"] for reply in json.loads(capsys.readouterr().out)] == [1, 2, 3]
    assert main(["ping", "2,9,3", *config]) == 1
    told = capsys.readouterr()
    assert (told.out.count("model number"), told.err) == (2, "servo 9: no answer\n")


def test_who_is_not_there_is_told_and_gives_exit_code_1(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ping", "9", "--config", str(path)]) == 1
    assert capsys.readouterr().err == "servo 9: no answer\n"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["ping", "2", "--bus", "left"], "there is no bus 'left'; known are main"),
        (["factory-reset", "2"], "say so with --yes"),
        (["write", "2", "id", "3"], "id 3 is taken"),
        (["write", "all", "id", "9"], "for one servo only"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_sent(
    path: Path, arguments: list[str], text: str
) -> None:
    with pytest.raises(Explained, match=text) as refused:
        main([*arguments, "--config", str(path)])
    assert refused.value.exit_code == 2


def test_no_robot_is_told_as_such(tmp_path: Path) -> None:
    path = robot.write(robot.chain(tmp_path, 1), tmp_path)
    with pytest.raises(NotReached, match="no robot at"):
        main(["ping", "1", "--config", str(path)])
