"""A robot's faults, recorded: diagnosed anew, and played in the robot's place."""

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from tests import robot as robots
from tests.conftest import free_port, wait_until
from tests.end_to_end.command import LIMIT_S, read_until, started, wackel
from tests.robot import Robot
from wackel_node.config import RecorderConfig, RobotConfig, ZenohConfig, load
from wackel_node.link import Link
from wackel_node.session import session
from wackel_schemas import keys
from wackel_schemas.health import Health

pytestmark = pytest.mark.process

FAULTS = [
    ("break", 4, "cable_break", "bus/main/cable/3-4"),
    ("silent", 3, "servo_silent", "bus/main/servo/3"),
    ("rhythmic_jammer", None, "rhythmic_jammer", "bus/main"),
]
NAMES = {(code, component) for _, _, code, component in FAULTS}


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recorded")


@pytest.fixture(scope="module")
def recording(directory: Path) -> Iterator[Path]:
    """What ``wackel up --record`` has kept of a robot with faults, from its start to its end.

    While the robot still lives, it is tried to play over it.
    """
    config = msgspec.structs.replace(
        robots.chain(directory, 6), recorder=RecorderConfig(directory=str(directory / "kept"))
    )
    with robots.running(config, directory, "--record") as robot:
        robot.wait(robot.ready, LIMIT_S)
        for kind, servo, code, component in FAULTS:
            suffer(robot, kind, servo, code, component)
        (path,) = (directory / "kept").glob("*.mcap")
        refused = wackel("play", path, "--config", directory / "robot.toml")
        assert refused.returncode == 1
        assert refused.stderr.startswith("wackel play: gateway/main of robot testbot runs at tcp/")
        assert "Traceback" not in refused.stderr
    yield path


def suffer(robot: Robot, kind: str, servo: int | None, code: str, component: str) -> None:
    robot.inject(kind, servo)
    robot.wait(lambda: robot.confirmed(code, component), LIMIT_S)
    robot.heal()
    robot.wait(lambda: not robot.confirmed(code, component), LIMIT_S)


def test_a_replay_concludes_what_the_live_services_concluded(recording: Path) -> None:
    done = wackel("replay", recording, "--compare")
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 differences from " in done.stderr
    assert all(code in done.stdout for code, _ in NAMES)


def test_two_replays_are_the_same_byte_for_byte(recording: Path, tmp_path: Path) -> None:
    outputs = []
    for name in ("first", "second"):
        done = wackel("replay", recording, "--json", "-o", tmp_path / name)
        assert done.returncode == 0
        outputs.append(done.stdout)
    assert outputs[0] == outputs[1] == (tmp_path / "first").read_text()
    assert (tmp_path / "first").read_bytes() == (tmp_path / "second").read_bytes()


@pytest.fixture
def desk(directory: Path, recording: Path, tmp_path: Path) -> Iterator[RobotConfig]:
    """A rendezvous, a classifier and an aggregator without any bus, as on a developer's desk."""
    config = msgspec.structs.replace(
        load(directory / "robot.toml"),
        zenoh=ZenohConfig(endpoint=f"tcp/127.0.0.1:{free_port()}"),
        state_directory=str(tmp_path / "state"),
    )
    path = robots.write(config, tmp_path)
    with contextlib.ExitStack() as stack:
        stack.enter_context(session(config, "router"))
        for service in ("classifier", "aggregator"):
            process = stack.enter_context(started(service, "--config", path))
            read_until(process, "ready")
        yield config


def test_a_played_recording_has_the_robots_faults_and_after_it_nothing_counts_as_healthy(
    recording: Path, desk: RobotConfig, tmp_path: Path
) -> None:
    named: set[tuple[str, str]] = set()
    health = Health(stamp=0, level="unknown", summary="nothing heard")

    def take(_: str, told: Health) -> None:
        nonlocal health
        health = told
        named.update((f.code, f.component) for f in told.faults if f.status == "confirmed")

    def status(service: str) -> str:
        return next((each.status for each in health.services if each.name == service), "")

    with (
        Link(desk) as link,
        started("play", recording, "--config", tmp_path / "robot.toml", "--speed", "2") as play,
    ):
        link.subscribe(keys.HEALTH, take)
        wait_until(lambda: play.poll() is not None, LIMIT_S, lambda: link.pump(0.05))
        assert play.returncode == 0
        wait_until(lambda: named >= NAMES, LIMIT_S, lambda: link.pump(0.05))
        wait_until(
            lambda: (
                status("playback/main") == "stopped"
                and health.level == "unknown"
                and not {(f.code, f.component) for f in health.faults if f.status == "confirmed"}
                & NAMES
            ),
            LIMIT_S,
            lambda: link.pump(0.05),
        )


def test_a_recorder_that_is_interrupted_leaves_a_whole_file(tmp_path: Path) -> None:
    config = robots.chain(tmp_path, 3)
    path = tmp_path / "run.mcap"
    with (
        robots.running(config, tmp_path) as robot,
        started("record", "-o", path, "--config", tmp_path / "robot.toml") as recorder,
    ):
        robot.wait(robot.ready, LIMIT_S)
        robot.wait(lambda: path.exists() and path.stat().st_size > 10_000, LIMIT_S)
        recorder.send_signal(signal.SIGINT)
        assert recorder.wait(LIMIT_S) == 0
    done = wackel("replay", path)
    assert done.returncode == 0
    assert "not finished" not in done.stderr
