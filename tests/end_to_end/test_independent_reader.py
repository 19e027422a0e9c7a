"""A program that knows nothing of wackel's code reads its topics."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests import robot as robots
from tests.end_to_end.command import LIMIT_S, read_until, wackel

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "read_health.py"


def test_the_example_needs_nothing_of_ours() -> None:
    imported = [line for line in EXAMPLE.read_text().splitlines() if "import " in line]
    assert imported == ["import sys", "import msgpack", "import zenoh"]


def test_health_and_faults_are_read_with_zenoh_and_msgpack_alone(tmp_path: Path) -> None:
    config = robots.chain(tmp_path, 6)
    readme = ROOT.joinpath("README.md").read_text().split("```python\n")[1].split("```")[0]
    assert "tcp/127.0.0.1:7447" in readme
    readme = readme.replace("tcp/127.0.0.1:7447", config.zenoh.endpoint)
    with robots.running(config, tmp_path) as robot:
        robot.wait(robot.ready, LIMIT_S)
        with reader("-c", readme) as shortest, reader(EXAMPLE, config.zenoh.endpoint) as example:
            for process in (shortest, example):
                # All well, unless this computer is late just now: as who knows our code reads it.
                told = read_until(process, "ok ").splitlines()[-1]
                robot.wait(lambda told=told: told in summaries(robot))  # type: ignore[misc]
            inject = ("virtual", "inject", "break", "--servo", "4")
            assert wackel(*inject, "--config", tmp_path / "robot.toml").returncode == 0
            told = read_until(example, "cable_break bus/main/cable/3-4")
            assert "fault The cable between servo 3 and servo 4 on bus main" in told
            assert "exchange the cable" in read_until(example, "→")
            read_until(shortest, "fault The cable between servo 3 and servo 4 on bus main")


def summaries(robot: robots.Robot) -> set[str]:
    """Level and summary of every health so far."""
    return {f"{health.level} {health.summary}" for _, health in robot.heard}


@contextmanager
def reader(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    """A Python program, killed with the block."""
    command = [sys.executable, "-u", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()
