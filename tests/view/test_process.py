"""``wackel view`` as a process, looked at by a viewer."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from tests.conftest import Rendezvous, wait_until
from tests.view.material import CONFIG, fault, health, odometry, residuals
from tests.view.viewer import Viewer
from wackel_node.config import RobotConfig, dump
from wackel_node.errors import FAILED, NOT_REACHED
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_view.core import HEALTH, LOG, ODOMETRY, PATH, ROBOT, TOPICS, TRANSFORMS, VELOCITY

pytestmark = pytest.mark.process


def start(config: RobotConfig, directory: Path, *more: str) -> subprocess.Popen[str]:
    path = directory / "robot.toml"
    path.write_text(dump(config), encoding="utf-8")
    command = [sys.executable, "-m", "wackel_cli", "view", "--config", str(path), *more]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    )


@pytest.fixture
def config(rendezvous: Rendezvous) -> RobotConfig:
    made: RobotConfig = msgspec.structs.replace(CONFIG, zenoh=rendezvous.config.zenoh)
    return made


@pytest.fixture
def port(config: RobotConfig, tmp_path: Path) -> Iterator[int]:
    process = start(config, tmp_path, "--port", "0")
    assert process.stdout is not None
    address = process.stdout.readline()
    try:
        yield int(address.rsplit(":", 1)[1])
    finally:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=5)
        assert process.returncode == 130
        assert "Traceback" not in errors


def test_a_viewer_sees_the_robot_and_its_health(port: int, config: RobotConfig) -> None:
    with Link(config) as link, Viewer(port) as viewer:
        while set(viewer.channels) != set(TOPICS):
            viewer.next()
        assert viewer.info["name"] == "wackel testbot"
        assert viewer.channels[ROBOT]["schemaName"] == "foxglove.SceneUpdate"
        assert viewer.channels[HEALTH]["encoding"] == "json"
        topics = [TRANSFORMS, ROBOT, PATH, VELOCITY, LOG, HEALTH, ODOMETRY]
        viewer.subscribe(*topics)
        publishers = {
            "odometry": link.publisher(keys.ODOMETRY),
            "residuals": link.publisher(keys.RESIDUALS),
            "health": link.publisher(keys.HEALTH),
        }
        seen: dict[str, list[bytes]] = {}
        told = iter(range(1000))

        def everything() -> bool:
            number = next(told)
            publishers["odometry"].put(odometry(number / 10, x=number / 10))  # type: ignore[arg-type]
            publishers["residuals"].put(residuals(number / 10))  # type: ignore[arg-type]
            wrong = fault(f"wheel_blocked_{number}", "wheel/w2/drive")
            publishers["health"].put(health(wrong))  # type: ignore[arg-type]
            message = viewer.next()
            while message is None:
                message = viewer.next()
            seen.setdefault(message.topic, []).append(message.payload)
            return set(seen) == set(topics)

        wait_until(everything, 20, meanwhile=lambda: link.pump(0.02))
        words = [json.loads(payload) for payload in seen[HEALTH]]
        assert any("wheel_blocked" in each["text"] for each in words)
        assert b"wheel w1" in seen[ROBOT][0]
        assert b"commanded" in seen[VELOCITY][-1]
        assert b"base" in b"".join(seen[TRANSFORMS])


def test_a_port_that_is_taken_is_told(config: RobotConfig, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        number = taken.getsockname()[1]
        process = start(config, tmp_path, "--port", str(number))
        _, errors = process.communicate(timeout=20)
    assert process.returncode == FAILED
    assert f"cannot serve viewers at 127.0.0.1:{number}" in errors
    assert "in use" in errors
    assert len(errors.splitlines()) == 1


def test_without_a_robot_there_is_nothing_to_see(robot_config: RobotConfig, tmp_path: Path) -> None:
    process = start(robot_config, tmp_path)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == NOT_REACHED
    assert "start it with `wackel up`" in errors
