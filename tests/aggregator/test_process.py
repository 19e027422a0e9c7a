"""The aggregator as a process, beside services that live and die."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import msgspec
import pytest

from tests.conftest import Rendezvous, wait_until
from wackel_node.config import BusConfig, RobotConfig, dump
from wackel_node.link import Link
from wackel_node.node import HEARTBEAT_S, Node
from wackel_node.publisher import Publisher
from wackel_schemas import keys
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message
from wackel_schemas.health import FaultRecord, Health, HealthRequest

pytestmark = pytest.mark.process

Spawn = Callable[[], subprocess.Popen[bytes]]


@pytest.fixture
def config(rendezvous: Rendezvous) -> RobotConfig:
    return msgspec.structs.replace(rendezvous.config, buses={"main": BusConfig(port="/dev/null")})


@pytest.fixture
def spawn(config: RobotConfig, tmp_path: Path) -> Iterator[Spawn]:
    path = tmp_path / "robot.toml"
    path.write_text(dump(config))
    started: list[subprocess.Popen[bytes]] = []

    def spawn() -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "wackel_cli", "aggregator", "--config", str(path)]
        started.append(subprocess.Popen(command))
        return started[-1]

    yield spawn
    for process in started:
        process.kill()
        process.wait()


class Reader:
    """Reads health as a program of a user would."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.health = Health(stamp=0, level="unknown", summary="nothing heard")
        self.all: list[Health] = []
        link.subscribe(keys.HEALTH, self.take)

    def take(self, _: str, health: Health) -> None:
        self.health = health
        self.all.append(health)

    def wait(self, condition: Callable[[Health], bool]) -> None:
        wait_until(lambda: condition(self.health), 15.0, lambda: self.link.pump(0.05))

    def fault(self, code: str) -> FaultRecord | None:
        return next((f for f in self.health.faults if f.code == code), None)

    def status(self, code: str) -> str:
        fault = self.fault(code)
        return fault.status if fault is not None else ""


@pytest.fixture
def reader(config: RobotConfig) -> Iterator[Reader]:
    with Link(config) as link:
        yield Reader(link)


def report(**changes: object) -> FaultReport:
    report = FaultReport(
        stamp=time.time_ns(),
        code="servo_silent",
        component="bus/main/servo/3",
        status="active",
        confidence=1.0,
        message=message("servo_silent", "bus/main/servo/3"),
        remedy=FAULT_CODES["servo_silent"].remedy,
        evidence=Evidence(summary="seen"),
        since=time.time_ns(),
    )
    return msgspec.structs.replace(report, **changes)


class Service:
    """A service in this process that beats only while it is pumped."""

    def __init__(self, name: str, config: RobotConfig) -> None:
        service, instance = name.split("/")
        self.node = Node(service, instance, config)
        self.faults: Publisher[FaultReport] = self.node.publisher(keys.FAULT, source=service)


def pump(reader: Reader, services: list[Service]) -> None:
    """Lets all that live in this process have their turn."""
    for service in services:
        service.node.pump()
    reader.link.pump(0.02)


@pytest.fixture
def services(config: RobotConfig) -> Iterator[list[Service]]:
    made = [Service("gateway/main", config), Service("classifier/main", config)]
    with made[0].node, made[1].node:
        for service in made:
            service.node.ready()
        yield made


def test_health_follows_faults_and_reaches_late_subscribers_of_both_kinds(
    spawn: Spawn, reader: Reader, services: list[Service], config: RobotConfig
) -> None:
    turn = partial(pump, reader, services)

    def wait(condition: Callable[[], bool]) -> None:
        wait_until(condition, 15.0, turn)

    spawn()
    wait(lambda: reader.health.level == "ok")
    services[1].faults.put(report())
    wait(lambda: reader.status("servo_silent") == "confirmed")
    assert reader.health.level == "fault"

    with Link(config) as late:
        other = Reader(late)
        wait_until(lambda: bool(other.all), 5.0, lambda: late.pump(0.02))
        assert other.all[0].faults[0].code == "servo_silent"
    replies = list(reader.link.session.get(f"wackel/{config.robot}/health", timeout=5.0))
    assert any(reply.ok is not None for reply in replies)

    reply = reader.link.ask(keys.HEALTH_REQUEST, HealthRequest(operation="acknowledge"))
    assert reply.text == "1 acknowledged"
    services[1].faults.put(report(status="healed"))
    wait(lambda: reader.status("servo_silent") == "healed")
    reader.link.ask(keys.HEALTH_REQUEST, HealthRequest(operation="clear"))
    wait(lambda: reader.fault("servo_silent") is None)
    numbers = sorted({t.number for health in reader.all for t in health.transitions})
    assert numbers == list(range(len(numbers)))


def test_a_burst_of_faults_is_told_together_and_whole(
    spawn: Spawn, reader: Reader, services: list[Service]
) -> None:
    turn = partial(pump, reader, services)
    spawn()
    wait_until(lambda: reader.health.level == "ok", 15.0, turn)
    reader.all.clear()
    places = {f"bus/main/servo/{number}" for number in range(1, 101)}
    for place in places:
        services[1].faults.put(report(component=place))

    def told() -> set[str]:
        return {fault.component for fault in reader.health.faults}

    wait_until(lambda: told() == places, 15.0, turn)
    changes = [health for health in reader.all if health.faults]
    assert len(changes) < len(places) / 2


def test_a_killed_aggregator_loses_no_confirmed_fault_and_no_number(
    spawn: Spawn, reader: Reader, services: list[Service]
) -> None:
    turn = partial(pump, reader, services)
    first = spawn()
    wait_until(lambda: reader.health.level == "ok", 15.0, turn)
    for servo in range(5):
        services[1].faults.put(report(component=f"bus/main/servo/{servo}"))
    wait_until(lambda: len(reader.health.faults) == 5, 15.0, turn)
    first.send_signal(signal.SIGKILL)
    first.wait()
    before = reader.health
    boot = before.boot
    spawn()
    wait_until(lambda: reader.health.boot != boot, 15.0, turn)
    assert {f.component for f in reader.health.faults} == {f.component for f in before.faults}
    assert {f.status for f in reader.health.faults} == {"unknown"}

    def turn_and_repeat() -> None:
        for servo in range(5):
            services[1].faults.put(report(component=f"bus/main/servo/{servo}", repeated=True))
        turn()

    wait_until(
        lambda: {f.status for f in reader.health.faults} == {"confirmed"}, 15.0, turn_and_repeat
    )
    assert [f.occurrences for f in reader.health.faults] == [1] * 5
    numbers = sorted({t.number for health in reader.all for t in health.transitions})
    assert numbers == list(range(len(numbers)))


def test_a_silent_service_is_told_and_its_faults_become_unknown(
    spawn: Spawn, reader: Reader, services: list[Service]
) -> None:
    gateway, classifier = services

    turn = partial(pump, reader, services)

    def turn_without_classifier() -> None:
        gateway.node.pump()
        reader.link.pump(0.02)

    spawn()
    wait_until(lambda: reader.health.level == "ok", 15.0, turn)
    classifier.faults.put(report())
    wait_until(lambda: reader.status("servo_silent") == "confirmed", 15.0, turn)
    wait_until(
        lambda: (
            reader.status("servo_silent") == "unknown"
            and reader.status("service_hung") == "confirmed"
        ),
        15.0,
        turn_without_classifier,
    )
    wait_until(lambda: reader.status("service_hung") == "healed", 15.0, turn)
    classifier.faults.put(report())
    wait_until(lambda: reader.status("servo_silent") == "confirmed", 15.0, turn)


def test_garbage_on_every_topic_it_reads_is_counted_and_survived(
    spawn: Spawn, reader: Reader, config: RobotConfig
) -> None:
    lost: dict[str, int] = {}
    process = spawn()
    reader.link.subscribe(keys.ALIVE, lambda key, beat: lost.update({key: beat.rejected}))
    wait_until(lambda: "alive/aggregator/main" in lost, 15.0, lambda: reader.link.pump(0.05))
    root = f"wackel/{config.robot}"
    garbage = [b"", b"\xff", b"\xc1" * 1000, os.urandom(300), b"\x91" * 10_000]
    for payload in garbage:
        reader.link.session.put(f"{root}/fault/x", payload)
        reader.link.session.put(f"{root}/alive/x/y", payload)
    reader.link.publisher(keys.FAULT, source="x").put(report(confidence=float("nan")))
    reader.link.publisher(keys.FAULT, source="aggregator").put(report())
    wait_until(
        lambda: lost["alive/aggregator/main"] == 2 * len(garbage) + 2,
        15.0,
        lambda: reader.link.pump(0.05),
    )
    wait_until(  # health follows the heartbeat that counts them
        lambda: [f.code for f in reader.health.faults] == ["messages_refused"],
        15.0,
        lambda: reader.link.pump(0.05),
    )
    assert process.poll() is None


def test_more_signs_of_life_than_there_can_be_services_are_survived(
    spawn: Spawn, reader: Reader, config: RobotConfig
) -> None:
    rejected: list[int] = []
    process = spawn()
    reader.link.subscribe(
        keys.ALIVE, lambda _, beat: rejected.append(beat.rejected), service="aggregator"
    )
    wait_until(lambda: bool(rejected), 15.0, lambda: reader.link.pump(0.05))
    root = f"wackel/{config.robot}/alive/stranger"
    tokens = [reader.link.session.liveliness().declare_token(f"{root}/{n}") for n in range(80)]
    wait_until(lambda: rejected[-1] >= 10, 15.0, lambda: reader.link.pump(0.05))
    assert process.poll() is None
    assert len(tokens) == 80


def test_a_second_aggregator_says_so_and_leaves(spawn: Spawn, reader: Reader) -> None:
    first = spawn()
    reader.wait(lambda health: health.stamp > 0)
    assert spawn().wait(20) == 1
    assert first.poll() is None


def test_it_stops_on_request_and_says_goodbye(spawn: Spawn, reader: Reader) -> None:
    states: list[str] = []
    reader.link.subscribe(keys.ALIVE, lambda _, beat: states.append(beat.state))
    process = spawn()
    wait_until(lambda: "ready" in states, 15.0, lambda: reader.link.pump(HEARTBEAT_S / 10))
    process.terminate()
    assert process.wait(10) == 0
    wait_until(lambda: "stopping" in states, 15.0, lambda: reader.link.pump(0.05))
