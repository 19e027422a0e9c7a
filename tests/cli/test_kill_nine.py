"""A whole robot with a fault, and ``kill -9`` for each of its services in turn."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.robot import SERVICES, Robot, chain, running
from wackel_node.precedence import may_come_first
from wackel_schemas import component

pytestmark = pytest.mark.process

SILENT = 3
FAULT = ("servo_silent", component.servo("main", SILENT))


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with running(chain(tmp_path, 6), tmp_path) as robot:
        yield robot


@pytest.mark.parametrize("service", SERVICES)
def test_a_killed_service_is_told_recovers_and_loses_no_fault(robot: Robot, service: str) -> None:
    robot.wait(robot.ready)
    robot.inject("silent", SILENT)
    robot.wait(lambda: robot.confirmed(*FAULT))
    pids = robot.pids()
    boot = robot.health.boot

    os.kill(pids[service], signal.SIGKILL)
    if service == "aggregator/main":
        robot.wait(lambda: robot.health.boot != boot)
    else:
        robot.wait(lambda: robot.status(service) == "dead")
    assert robot.fault(*FAULT) is not None

    robot.wait(lambda: all(robot.status(name) == "ready" for name in SERVICES))
    robot.wait(lambda: robot.confirmed(*FAULT))
    fault = robot.fault(*FAULT)
    assert fault is not None
    assert fault.occurrences == 1
    restarted = robot.pids()
    assert {name for name in pids if restarted[name] != pids[name]} == {service}
    if may_come_first():  # also the restarted one
        diagnosis = (restarted["classifier/main"], restarted["aggregator/main"])
        assert {os.sched_getscheduler(pid) for pid in diagnosis} == {os.SCHED_FIFO}
    assert sorted(robot.numbers) == list(range(max(robot.numbers) + 1))

    robot.heal()
    robot.wait(lambda: not robot.confirmed(*FAULT))
