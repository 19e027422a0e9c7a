"""Ctrl-C: every command that goes on ends soon, without a traceback, and says 0 to the shell."""

import contextlib
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import robot as robots
from tests.conftest import wait_until
from tests.end_to_end.command import LIMIT_S, read_until, started
from tests.robot import Robot
from wackel_node.config import RobotConfig
from wackel_node.session import session

pytestmark = pytest.mark.process

STOP_S = 10.0
"""A second is what is promised; the rest is for a computer that is busy with other tests."""


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("robot")


@pytest.fixture(scope="module")
def robot(directory: Path) -> Iterator[Robot]:
    with robots.running(robots.chain(directory, 3), directory) as running:
        running.wait(running.ready, LIMIT_S)
        yield running


def interrupted(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and last words after Ctrl-C."""
    process.send_signal(signal.SIGINT)
    words, _ = process.communicate(timeout=STOP_S)
    return process.returncode, words


@pytest.mark.parametrize(
    ("command", "sign"),
    [
        (("echo", "--config", "robot.toml"), "bus/main/"),
        (("echo", "health", "--json", "--config", "robot.toml"), "level"),
        (("echo", "--hz", "--config", "robot.toml"), "interval"),
        (("top", "--config", "robot.toml"), "bus main"),
        (("top", "--json", "--config", "robot.toml"), "health"),
        (("record", "-o", "run.mcap", "--config", "robot.toml"), "recording robot"),
    ],
    ids=lambda each: " ".join(each) if isinstance(each, tuple) else "",
)
def test_what_looks_at_a_robot(
    robot: Robot, directory: Path, command: tuple[str, ...], sign: str
) -> None:
    with started(*command, cwd=directory) as process:
        read_until(process, sign)
        code, words = interrupted(process)
    assert (code, "Traceback" in words) == (0, False)


@pytest.fixture
def config(tmp_path: Path) -> RobotConfig:
    """Of a robot of its own, as ``robot.toml`` where the command runs."""
    config = robots.chain(tmp_path, 3)
    robots.write(config, tmp_path)
    return config


@pytest.mark.parametrize(
    ("command", "sign"),
    [
        (("up", "--virtual"), "aggregator/main   ready"),
        (("virtual",), "ready"),
        (("virtual", "--no-zenoh", "--tap", "main=tap"), "ready"),
        (("gateway",), "ready"),
        (("classifier",), "ready"),
        (("aggregator",), "ready"),
    ],
    ids=lambda each: " ".join(each) if isinstance(each, tuple) else "",
)
def test_what_runs_a_robot(
    config: RobotConfig, tmp_path: Path, command: tuple[str, ...], sign: str
) -> None:
    alone = command[0] == "up" or "--no-zenoh" in command
    with contextlib.ExitStack() as stack:
        if not alone:
            stack.enter_context(session(config, "router"))
        process = stack.enter_context(started(*command, cwd=tmp_path))
        read_until(process, sign)
        code, words = interrupted(process)
    assert (code, "Traceback" in words) == (0, False)
    assert not (tmp_path / "bus").is_symlink()
    assert not (tmp_path / "tap").is_symlink()


def test_a_demo(tmp_path: Path) -> None:
    with started("demo", "--plain", cwd=tmp_path) as process:
        read_until(process, "someone pulls the cable")
        code, words = interrupted(process)
    assert (code, "Traceback" in words) == (0, False)


def test_a_playback(robot: Robot, directory: Path, config: RobotConfig, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with started("record", "-o", path, cwd=directory) as recorder:
        wait_until(lambda: path.exists() and path.stat().st_size > 10_000, LIMIT_S)
        assert interrupted(recorder)[0] == 0
    with session(config, "router"), started("play", path, "--loop", cwd=tmp_path) as process:
        read_until(process, "ready")
        code, words = interrupted(process)
    assert (code, "Traceback" in words) == (0, False)


def test_a_scan_says_that_it_was_interrupted(config: RobotConfig, tmp_path: Path) -> None:
    with started("virtual", "--no-zenoh", cwd=tmp_path) as bus:
        read_until(bus, "ready")
        port = tmp_path / "bus"
        with started("scan", "--port", port, cwd=tmp_path) as process:
            wait_until(lambda: is_open(process.pid, port.resolve()), LIMIT_S)
            code, words = interrupted(process)
    assert (code, "Traceback" in words) == (130, False)


def is_open(pid: int, path: Path) -> bool:
    """Whether a process has a file open."""
    with contextlib.suppress(FileNotFoundError):  # one may be closed while this looks
        return any(link.readlink() == path for link in Path(f"/proc/{pid}/fd").iterdir())
    return False
