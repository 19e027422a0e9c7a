"""`wackel play` as a process in the gateway's place."""

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.conftest import Rendezvous, wait_until
from wackel_node.config import RobotConfig, dump
from wackel_node.link import Link
from wackel_node.listen import header_of
from wackel_node.node import Node
from wackel_recording.about import About
from wackel_recording.writer import RecordingWriter
from wackel_schemas import wire
from wackel_schemas.bus import BusState
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.keys import FAULT, STATE

START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
COUNT = 100


@pytest.fixture
def recording(tmp_path: Path, robot_config: RobotConfig) -> Path:
    """One second of states of another robot at 100 Hz, with a conclusion in the middle."""
    path = tmp_path / "run.mcap"
    about = About(
        robot="other", config=dump(robot_config), version="1", started_ns=START_NS, session="a"
    )
    writer = RecordingWriter(path, about)

    def add(key: str, at_ns: int, payload: bytes) -> None:
        writer.add(key, at_ns, payload, header_of(key, payload))

    for number in range(COUNT):
        at_ns = START_NS + number * STEP_NS
        state = BusState(stamp=at_ns - 500, boot=7, seq=number, servos=[])
        add("bus/main/state", at_ns, wire.encode(state))
        if number == COUNT // 2:
            add("bus/main/state", at_ns, b"\xc1 garbage as it was")
            report = FaultReport(
                stamp=at_ns,
                code="noise",
                component="bus/main",
                status="active",
                confidence=1.0,
                message="",
                remedy="",
                evidence=Evidence(summary=""),
                since=at_ns,
            )
            add("fault/classifier", at_ns, wire.encode(report))
    writer.close()
    return path


@contextmanager
def playback(
    config: RobotConfig, path: Path, *arguments: str, stdin: int = subprocess.DEVNULL
) -> Iterator[subprocess.Popen[str]]:
    robot_toml = path.parent / "robot.toml"
    robot_toml.write_text(dump(config))
    process = subprocess.Popen(
        [sys.executable, "-m", "wackel_cli", "play", path, "--config", robot_toml, *arguments],
        stdin=stdin,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


class Listener:
    """What arrives on the bus topics."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.payloads: list[bytes] = []
        self.times_s: list[float] = []
        self.faults = 0
        link.subscribe_raw(STATE, self._on_state)
        link.subscribe_raw(FAULT, self._on_fault)

    def _on_state(self, key: str, payload: bytes) -> None:
        assert key == "bus/main/state"
        self.payloads.append(payload)
        self.times_s.append(time.monotonic())

    def _on_fault(self, key: str, payload: bytes) -> None:
        self.faults += 1

    def until_end_of(self, process: subprocess.Popen[str]) -> None:
        wait_until(lambda: process.poll() is not None, 20, meanwhile=lambda: self.link.pump(0.05))
        self.link.pump(0.1)


def expected_payloads() -> list[bytes]:
    states = [
        wire.encode(BusState(stamp=START_NS + n * STEP_NS - 500, boot=7, seq=n, servos=[]))
        for n in range(COUNT)
    ]
    return [*states[: COUNT // 2 + 1], b"\xc1 garbage as it was", *states[COUNT // 2 + 1 :]]


@pytest.mark.process
def test_every_input_arrives_unchanged_in_order_and_in_time(
    rendezvous: Rendezvous, recording: Path
) -> None:
    with (
        Link(rendezvous.config, "peer") as link,
        playback(rendezvous.config, recording) as process,
    ):
        listener = Listener(link)
        listener.until_end_of(process)
    assert process.returncode == 0
    assert listener.payloads == expected_payloads()
    assert listener.faults == 0
    assert listener.times_s[-1] - listener.times_s[0] > 0.9 * COUNT * STEP_NS / 1e9


@pytest.mark.process
def test_that_a_recording_is_of_another_robot_is_told(
    rendezvous: Rendezvous, recording: Path
) -> None:
    with playback(rendezvous.config, recording, "--to", "0.1") as process:
        _, errors = process.communicate(timeout=20)
    assert "run.mcap is of robot 'other', the configuration of 'testbot'" in errors


@pytest.mark.process
def test_at_high_speed_and_in_a_loop_nothing_is_lost(
    rendezvous: Rendezvous, recording: Path
) -> None:
    arguments = ("--speed", "100", "--loop", "--all", "--from", "0.2", "--to", "0.79")
    with (
        Link(rendezvous.config, "peer") as link,
        playback(rendezvous.config, recording, *arguments) as process,
    ):
        listener = Listener(link)
        wait_until(lambda: listener.faults >= 5, 20, meanwhile=lambda: link.pump(0.01))
        process.send_signal(signal.SIGINT)
        listener.until_end_of(process)
    assert process.returncode == 0
    once = expected_payloads()[20:81]
    rounds = len(listener.payloads) // len(once)
    assert listener.payloads[: rounds * len(once)] == rounds * once


@pytest.mark.process
def test_keys_on_a_terminal_pause_and_quit(rendezvous: Rendezvous, recording: Path) -> None:
    terminal, side = pty.openpty()
    with (
        Link(rendezvous.config, "peer") as link,
        playback(rendezvous.config, recording, "--paused", "--loop", stdin=side) as process,
    ):
        listener = Listener(link)
        alive: list[str] = []
        link.watch_alive(lambda name, there: alive.append(name))
        wait_until(lambda: "playback/main" in alive, meanwhile=lambda: link.pump(0.05))
        assert listener.payloads == []
        os.write(terminal, b" ")
        wait_until(lambda: len(listener.payloads) > 10, meanwhile=lambda: link.pump(0.05))
        os.write(terminal, b"q")
        listener.until_end_of(process)
    os.close(terminal)
    os.close(side)
    assert process.returncode == 0


@pytest.mark.process
def test_it_refuses_to_play_over_a_live_robot(rendezvous: Rendezvous, recording: Path) -> None:
    with (
        Node("gateway", "main", rendezvous.config),
        playback(rendezvous.config, recording) as process,
    ):
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    assert errors.startswith("wackel play: gateway/main of robot testbot runs at tcp/")


@pytest.mark.process
def test_it_gives_way_to_a_gateway_that_comes_up(rendezvous: Rendezvous, recording: Path) -> None:
    with (
        Link(rendezvous.config, "peer") as link,
        playback(rendezvous.config, recording, "--loop") as process,
    ):
        listener = Listener(link)
        wait_until(lambda: bool(listener.payloads), meanwhile=lambda: link.pump(0.05))
        with Node("gateway", "main", rendezvous.config):
            _, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    assert "gateway/main of robot testbot runs" in errors


@pytest.mark.process
@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (("--from", "5"), 1, "nothing to play there"),
        (("--speed", "0"), 2, "--speed"),
        (("--from", "nan"), 2, "--from"),
    ],
)
def test_what_cannot_be_played_is_told(
    rendezvous: Rendezvous, recording: Path, arguments: tuple[str, ...], code: int, reason: str
) -> None:
    with playback(rendezvous.config, recording, *arguments) as process:
        _, errors = process.communicate(timeout=20)
    assert process.returncode == code
    assert reason in errors
    assert "Traceback" not in errors


@pytest.mark.process
def test_without_a_rendezvous_it_says_so(robot_config: RobotConfig, recording: Path) -> None:
    with playback(robot_config, recording) as process:
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 3
    assert errors.startswith("wackel play: no robot at tcp/")
    assert "`wackel up --play FILE`" in errors  # plain `wackel up` would be in the way
