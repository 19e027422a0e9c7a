"""A program that knows nothing of wackel's code reads its topics."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests import robot as robots
from tests.end_to_end.command import LIMIT_S, read_until, wackel

pytestmark = pytest.mark.process

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "read_health.py"


def test_the_example_needs_nothing_of_ours() -> None:
    imported = [line for line in EXAMPLE.read_text().splitlines() if "import " in line]
    assert imported == ["import sys", "import msgpack", "import zenoh"]


def test_health_and_faults_are_read_with_zenoh_and_msgpack_alone(tmp_path: Path) -> None:
    config = robots.chain(tmp_path, 6)
    with robots.running(config, tmp_path) as robot:
        robot.wait(robot.ready, LIMIT_S)
        command = [sys.executable, str(EXAMPLE), config.zenoh.endpoint]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as reader:
            try:
                assert "ok All well" in read_until(reader, "All well")
                inject = ("virtual", "inject", "break", "--servo", "4")
                assert wackel(*inject, "--config", tmp_path / "robot.toml").returncode == 0
                told = read_until(reader, "cable_break bus/main/cable/3-4")
                assert "fault The cable between servo 3 and servo 4 on bus main" in told
                assert "exchange the cable" in read_until(reader, "→")
            finally:
                reader.kill()
