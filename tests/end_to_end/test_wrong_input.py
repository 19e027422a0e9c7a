"""What a person gets wrong: one line that says what and where, and an exit code for scripts."""

import re
from pathlib import Path

import msgspec
import pytest

from tests import robot as robots
from tests.end_to_end.command import LIMIT_S, wackel

pytestmark = pytest.mark.process

CONFIGS = {
    "absent": (None, "no such file"),
    "a directory": ("", "cannot be read"),
    "not text": (b"\xff\xfe\x00", "cannot be read"),
    "not TOML": (b"[buses", "not TOML"),
    "an unknown key": (b"[buses.main]\nprot = '/dev/ttyUSB0'\n", "buses.main.prot"),
    "a wrong type": (b"[buses.main]\nport = 7\n", "buses.main.port"),
    "a wrong value": (b"[buses.main]\nport = 'a'\nbaud_rate = 12345\n", "buses.main.baud_rate"),
}
COMMANDS = [
    ("up", "{}"),
    ("config", "{}"),
    ("doctor", "{}"),
    ("top", "--once", "--config", "{}"),
    ("gateway", "--config", "{}"),
]


def explained(name: str, code: int, error: str, *words: str) -> None:
    """One line, of this command, with these words, and no traceback."""
    assert error.startswith(f"wackel {name}: "), error
    assert error.count("\n") == 1, error
    assert all(word in error for word in words), error
    assert code in (1, 2)


@pytest.mark.parametrize("what", CONFIGS)
def test_a_wrong_configuration_is_explained_by_whatever_reads_it(tmp_path: Path, what: str) -> None:
    content, words = CONFIGS[what]
    path = tmp_path / "robot.toml"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        path.mkdir()
    for command in COMMANDS:
        done = wackel(*(each.format(path) for each in command), cwd=tmp_path)
        explained(command[0], done.returncode, done.stderr, "robot.toml", words)
        assert done.returncode == 2


@pytest.mark.parametrize("command", ["play", "replay"])
@pytest.mark.parametrize("content", [None, b"", b"MCAP, almost", b"\x89MCAP0\r\n" + bytes(99)])
def test_a_wrong_recording_is_explained(
    tmp_path: Path, command: str, content: bytes | None
) -> None:
    path = tmp_path / "run.mcap"
    if content is not None:
        path.write_bytes(content)
    done = wackel(command, path, cwd=tmp_path)
    explained(command, done.returncode, done.stderr, "run.mcap")


@pytest.mark.parametrize("port", ["absent", "a file", "a directory"])
def test_a_scan_of_what_is_no_port_is_explained(tmp_path: Path, port: str) -> None:
    path = tmp_path / "port"
    if port == "a file":
        path.write_text("")
    elif port == "a directory":
        path.mkdir()
    done = wackel("scan", "--port", path, cwd=tmp_path)
    explained("scan", done.returncode, done.stderr, str(path))
    assert done.returncode == 1


@pytest.mark.parametrize("port", ["absent", "a file"])
def test_a_robot_whose_port_cannot_be_opened_runs_and_says_so_in_health(
    tmp_path: Path, port: str
) -> None:
    if port == "a file":
        (tmp_path / "bus").write_text("")
    config = robots.chain(tmp_path, 3)
    with robots.running(config, tmp_path, virtual=False) as robot:
        robot.wait(lambda: robot.confirmed("adapter_unplugged", "bus/main/adapter"), LIMIT_S)
        robot.wait(lambda: robot.status("gateway/main") == "ready", LIMIT_S)
        assert robot.health.capabilities["can_command"] is False
    if port == "a file":
        assert (tmp_path / "bus").read_text() == ""


def test_a_robot_that_is_not_there_is_told_from_wrong_usage(tmp_path: Path) -> None:
    config = robots.chain(tmp_path, 3)
    path = robots.write(config, tmp_path)
    for command in (("top", "--once"), ("echo", "-n", "1"), ("virtual", "list")):
        done = wackel(*command, "--config", path)
        assert done.returncode == 3
        # The virtual robot may be asked directly, too.
        missing = f"wackel {command[0]}: no (virtual )?robot at tcp/127.0.0.1:"
        assert re.match(missing, done.stderr)


def test_commands_that_do_not_exist_are_guessed(tmp_path: Path) -> None:
    done = wackel("tpo", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "wackel: no command 'tpo'; did you mean top?\n")


def test_two_buses_on_one_port_are_refused_before_anything_starts(tmp_path: Path) -> None:
    config = robots.chain(tmp_path, 3)
    twice = msgspec.structs.replace(config, buses=dict.fromkeys("ab", config.buses["main"]))
    done = wackel("up", robots.write(twice, tmp_path), "--virtual")
    assert (done.returncode, done.stdout) == (2, "")
    explained("up", done.returncode, done.stderr, "bus a has it already")
