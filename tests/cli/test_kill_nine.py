"""A whole robot with a fault, and ``kill -9`` for each of its services in turn."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from tests.conftest import wait_until
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, dump
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.health import FaultRecord, Health
from wackel_schemas.virtual import Injection, VirtualRequest

pytestmark = pytest.mark.process

SILENT = 3


class Robot:
    """A virtual robot that ``wackel up`` runs, and its health."""

    def __init__(self, link: Link, up: subprocess.Popen[str], pid: Callable[[str], int]) -> None:
        self.link = link
        self.up = up
        self.pid = pid
        self.health = Health(stamp=0, level="unknown", summary="nothing heard")
        self.numbers: set[int] = set()
        link.subscribe(keys.HEALTH, self.take)

    def take(self, _: str, health: Health) -> None:
        self.health = health
        self.numbers.update(transition.number for transition in health.transitions)

    def wait(self, condition: Callable[[], bool], limit_s: float = 30.0) -> None:
        wait_until(condition, limit_s, lambda: self.link.pump(0.02))

    def status(self, service: str) -> str:
        found = [s.status for s in self.health.services if s.name == service]
        return found[0] if found else ""

    def silent_servo(self) -> FaultRecord | None:
        return next(
            (
                fault
                for fault in self.health.faults
                if (fault.code, fault.component) == ("servo_silent", f"bus/main/servo/{SILENT}")
            ),
            None,
        )

    def knows_the_fault(self) -> bool:
        fault = self.silent_servo()
        return fault is not None and fault.status == "confirmed"


@pytest.fixture
def robot(robot_config: RobotConfig, tmp_path: Path) -> Iterator[Robot]:
    bus = BusConfig(
        port=str(tmp_path / "bus"), servos=[ServoConfig(id=number) for number in range(1, 7)]
    )
    config = msgspec.structs.replace(robot_config, buses={"main": bus})
    path = tmp_path / "robot.toml"
    path.write_text(dump(config))
    lines = tmp_path / "up.jsonl"
    command = [sys.executable, "-m", "wackel_cli", "up", str(path), "--virtual", "--json"]
    with lines.open("w") as out, subprocess.Popen(command, stdout=out, text=True) as up:

        def pid(service: str) -> int:
            told = [json.loads(line) for line in lines.read_text().splitlines()]
            return next(
                int(line["detail"].split()[1])
                for line in reversed(told)
                if (line["name"], line["event"]) == (service, "started")
            )

        try:
            wait_until(lambda: "aggregator/main" in lines.read_text(), 30.0)
            with Link(config) as link:
                yield Robot(link, up, pid)
        finally:
            up.terminate()
            up.wait(10)


SERVICES = ["gateway/main", "classifier/main", "aggregator/main"]


@pytest.mark.parametrize("service", SERVICES)
def test_a_killed_service_is_told_recovers_and_loses_no_fault(robot: Robot, service: str) -> None:
    robot.wait(lambda: robot.health.level == "ok")
    injection = Injection(kind="silent", servo=SILENT, bus="main")
    request = VirtualRequest(operation="inject", injection=injection)
    assert robot.link.ask(keys.VIRTUAL_REQUEST, request).ok
    robot.wait(robot.knows_the_fault)
    pids = {name: robot.pid(name) for name in [*SERVICES, "virtual/main"]}
    boot = robot.health.boot

    os.kill(pids[service], signal.SIGKILL)
    if service == "aggregator/main":
        robot.wait(lambda: robot.health.boot != boot)
    else:
        robot.wait(lambda: robot.status(service) == "dead")
    assert robot.silent_servo() is not None

    robot.wait(lambda: all(robot.status(name) == "ready" for name in SERVICES))
    robot.wait(robot.knows_the_fault)
    fault = robot.silent_servo()
    assert fault is not None
    assert fault.occurrences == 1
    assert {name for name in pids if robot.pid(name) != pids[name]} == {service}
    assert sorted(robot.numbers) == list(range(max(robot.numbers) + 1))

    assert robot.link.ask(keys.VIRTUAL_REQUEST, VirtualRequest(operation="heal")).ok
    robot.wait(lambda: not robot.knows_the_fault())
