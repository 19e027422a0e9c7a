"""The life of a service, seen from outside: real processes, real Zenoh."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

from tests.conftest import Rendezvous, wait_until
from wackel_node.config import RobotConfig, dump
from wackel_node.link import Link
from wackel_node.node import HEARTBEAT_S
from wackel_node.session import session
from wackel_schemas import keys, wire
from wackel_schemas.bus import BusCommand
from wackel_schemas.health import Health, HealthRequest, Heartbeat

pytestmark = pytest.mark.process

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(rendezvous: Rendezvous, tmp_path: Path) -> Iterator[Start]:
    """Starts a sample service; whatever is left of it is killed in the end."""
    path = tmp_path / "robot.toml"
    path.write_text(dump(rendezvous.config))
    started: list[subprocess.Popen[str]] = []

    def start(deed: str = "run", instance: str = "a", **environment: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.node.sample_service", str(path), instance, deed],
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment},
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        assert process.stderr is not None
        process.stderr.close()


class Witness:
    """What can be seen of services on the robot's topics."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.beats: list[Heartbeat] = []
        self.alive: dict[str, bool] = {}
        link.subscribe(keys.ALIVE, lambda _, beat: self.beats.append(beat))
        link.watch_alive(self.alive.__setitem__)

    def wait(self, condition: Callable[[], bool]) -> None:
        wait_until(condition, meanwhile=lambda: self.link.pump(0.05))

    def wait_for(self, state: str) -> Heartbeat:
        self.wait(lambda: any(beat.state == state for beat in self.beats))
        return next(beat for beat in self.beats if beat.state == state)


@pytest.fixture
def witness(rendezvous: Rendezvous) -> Iterator[Witness]:
    with Link(rendezvous.config) as link:
        yield Witness(link)


@pytest.mark.usefixtures("hangup_counts")
def test_a_service_is_alive_beats_and_stops_on_request(start: Start, witness: Witness) -> None:
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        process = start()
        beat = witness.wait_for("ready")
        assert beat.pid == process.pid
        assert witness.alive == {"sample/a": True}
        witness.wait(lambda: sum(beat.state == "ready" for beat in witness.beats) >= 3)
        process.send_signal(number)
        witness.wait_for("stopping")
        assert process.wait(10) == 0
        witness.wait(lambda: not witness.alive["sample/a"])
        witness.beats.clear()
        witness.alive.clear()


def test_with_nohup_it_survives_the_terminal(start: Start, witness: Witness) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # what is started inherits it
    process = start()
    signal.signal(signal.SIGHUP, before)
    witness.wait_for("ready")
    process.send_signal(signal.SIGHUP)
    witness.beats.clear()
    witness.wait(lambda: len(witness.beats) >= 3)
    assert {beat.state for beat in witness.beats} == {"ready"}


def test_heartbeats_are_numbered_within_a_boot(start: Start, witness: Witness) -> None:
    start()
    witness.wait(lambda: len(witness.beats) >= 3)
    assert len({beat.boot for beat in witness.beats}) == 1
    first = witness.beats[0].seq
    assert [beat.seq for beat in witness.beats[:3]] == [first, first + 1, first + 2]


@pytest.mark.parametrize(
    ("deed", "reason"),
    [
        ("crash", "ValueError: cannot do bus/main/command (sample_service.py:"),
        ("crash-early", "RuntimeError: no such thing (sample_service.py:"),
    ],
)
def test_a_crash_is_published_with_exception_and_place(
    start: Start, witness: Witness, deed: str, reason: str
) -> None:
    process = start(deed)
    if deed == "crash":
        witness.wait_for("ready")
        witness.link.publisher(keys.COMMAND, bus="main").put(BusCommand(stamp=1, goals=[]))
    assert witness.wait_for("crashed").reason.startswith(reason)
    assert process.wait(10) == 1
    _, log = process.communicate()
    assert "Traceback" in log


def test_an_expected_failure_is_published_in_its_own_words(start: Start, witness: Witness) -> None:
    process = start("give-up")
    assert witness.wait_for("crashed").reason == "robot.toml: no such wheel"
    assert process.wait(10) == 1


def test_a_killed_service_is_missed_at_once(start: Start, witness: Witness) -> None:
    process = start()
    witness.wait_for("ready")
    process.kill()
    witness.wait(lambda: witness.alive == {"sample/a": False})
    assert {beat.state for beat in witness.beats} <= {"starting", "ready"}


def test_a_hung_service_stays_alive_without_heartbeat(start: Start, witness: Witness) -> None:
    start("hang")
    witness.wait_for("ready")
    witness.link.publisher(keys.COMMAND, bus="main").put(BusCommand(stamp=1, goals=[]))
    limit = time.monotonic() + 3 * HEARTBEAT_S
    heard_late = 0
    while time.monotonic() < limit:
        late = time.monotonic() > limit - 2 * HEARTBEAT_S
        before = len(witness.beats)
        witness.link.pump(0.05)
        heard_late += late * (len(witness.beats) - before)
    assert heard_late == 0
    assert witness.alive == {"sample/a": True}


def test_lost_messages_are_counted_by_who_misses_them(
    start: Start, witness: Witness, rendezvous: Rendezvous
) -> None:
    start()
    witness.wait_for("ready")
    key = f"wackel/{rendezvous.config.robot}/bus/main/command"
    for seq in (0, 1, 5, 6, 2**62, 2**62 + 2):  # 2, 3, 4 are missing; then a stranger's numbers
        message = BusCommand(stamp=1, boot=7, seq=seq, goals=[])
        witness.link.session.put(key, wire.encode(message))
    witness.wait(lambda: any(beat.received == 6 for beat in witness.beats))
    assert witness.beats[-1].lost == 3 + 1


GARBAGE = [b"", b"\xff", b"\x80", b"\xc1" * 1000, b"\x91" * 100_000, b"{}", bytes(range(256))]


def test_garbage_on_its_topics_is_counted_and_told_once(
    start: Start, witness: Witness, rendezvous: Rendezvous
) -> None:
    process = start()
    witness.wait_for("ready")
    key = f"wackel/{rendezvous.config.robot}/bus/main/command"
    for payload in GARBAGE:
        witness.link.session.put(key, payload)
    witness.link.publisher(keys.COMMAND, bus="main").put(BusCommand(stamp=1, goals=[]))
    disliked = BusCommand(stamp=1, boot=3, seq=99, goals=[])
    witness.link.session.put(key, wire.encode(disliked))
    witness.wait(lambda: any(beat.rejected == len(GARBAGE) + 1 for beat in witness.beats))
    process.terminate()
    _, log = process.communicate(timeout=10)
    assert process.returncode == 0
    assert log.count("no BusCommand") == 1


def test_a_request_that_is_not_understood_gets_the_reason(
    start: Start, witness: Witness, rendezvous: Rendezvous
) -> None:
    start()
    witness.wait_for("ready")
    link = witness.link
    assert link.ask(keys.HEALTH_REQUEST, HealthRequest(code="x")).text == "x"
    with pytest.raises(wire.Rejected, match="code nonsense is not known"):
        link.ask(keys.HEALTH_REQUEST, HealthRequest(code="nonsense"))
    key = f"wackel/{rendezvous.config.robot}/health/request"
    for payload in GARBAGE:
        if payload != b"\x80":  # an empty map is a request with every default
            replies = list(link.session.get(key, payload=payload, timeout=5.0))
            assert [r.err.payload.to_string()[:16] for r in replies if r.err] == [
                "no HealthRequest"
            ]
    # Plain clients may leave the payload out.
    replies = list(link.session.get(key, timeout=5.0))
    assert [reply.ok is not None for reply in replies] == [True]


def test_a_question_that_nobody_answers_times_out(witness: Witness) -> None:
    with pytest.raises(TimeoutError, match="no answer on health/request"):
        witness.link.ask(keys.HEALTH_REQUEST, HealthRequest(), timeout_s=0.3)


def test_a_late_subscriber_gets_the_latched_value(start: Start, witness: Witness) -> None:
    start()
    witness.wait_for("ready")
    got: list[Health] = []
    witness.link.subscribe(keys.HEALTH, lambda _, health: got.append(health))
    witness.wait(lambda: bool(got))
    assert [health.summary for health in got] == ["a"]


def test_a_plain_client_gets_the_latched_value_by_a_query(
    start: Start, witness: Witness, rendezvous: Rendezvous
) -> None:
    start()
    witness.wait_for("ready")
    replies = witness.link.session.get(f"wackel/{rendezvous.config.robot}/health", timeout=5.0)
    payloads = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
    assert payloads
    assert {wire.decode(payload, Health).summary for payload in payloads} == {"a"}


def test_services_come_up_before_their_rendezvous_and_find_it_later(
    robot_config: RobotConfig, tmp_path: Path
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(dump(robot_config))
    command = [sys.executable, "-m", "tests.node.sample_service", str(path), "a", "run"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            assert "ready" in process.stderr.readline()
            with session(robot_config, "router"), Link(robot_config) as link:
                Witness(link).wait_for("ready")
        finally:
            process.kill()


def test_systemd_is_told_ready_alive_and_stopping(
    start: Start, witness: Witness, tmp_path: Path
) -> None:
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.bind(path)
        supervisor.settimeout(10)
        process = start(NOTIFY_SOCKET=path)
        told = [supervisor.recv(100) for _ in range(4)]
        assert b"READY=1" in told
        assert b"WATCHDOG=1" in told
        process.terminate()
        while told[-1] != b"STOPPING=1":
            told.append(supervisor.recv(100))
        assert process.wait(10) == 0


def test_zenoh_itself_would_accept_a_foreign_key_and_nobody_minds(
    start: Start, witness: Witness, rendezvous: Rendezvous
) -> None:
    start()
    witness.wait_for("ready")
    session: zenoh.Session = witness.link.session
    session.put(f"wackel/{rendezvous.config.robot}/alive/x", b"")
    session.put(f"wackel/{rendezvous.config.robot}/alive/ü/%20", b"\xff")
    witness.wait(lambda: len(witness.beats) >= 3)
