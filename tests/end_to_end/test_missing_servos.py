"""Configured servos that never answer, from the start: health says so, whatever the cause is."""

from pathlib import Path

import msgspec
import pytest

from tests import robot as robots

pytestmark = pytest.mark.process

SERVOS = 6
ABSENT = (3, 6)
NAMED = {("servo_silent", "bus/main/servo/3"), ("cable_break", "bus/main/cable/5-6")}
HOLDS_S = 3.0  # a diagnosis that holds outlasts every repetition and heal time


def test_a_robot_that_starts_without_two_of_its_servos_is_not_called_well(tmp_path: Path) -> None:
    config = robots.chain(tmp_path, SERVOS)
    bus = config.buses["main"]
    there = [servo for servo in bus.servos if servo.id not in ABSENT]
    incomplete = msgspec.structs.replace(
        config, buses={"main": msgspec.structs.replace(bus, servos=there)}
    )
    wire = str(robots.write(incomplete, tmp_path, "wire"))
    virtual = robots.process(
        "wackel_virtual", "--config", wire, "--no-zenoh", log=tmp_path / "virtual.log"
    )
    with virtual, robots.running(config, tmp_path, virtual=False) as robot:
        robot.wait(lambda: robot.health.capabilities.get("can_command") is False)
        told = len(robot.heard)
        robot.wait(lambda: all(robot.confirmed(*fault) for fault in NAMED))
        robot.listen(HOLDS_S)
        assert {heard.health.level for heard in robot.heard[told:]} == {"fault"}
        assert all(robot.confirmed(*fault) for fault in NAMED)
        assert robot.fault("servo_unheard", "bus/main/servo/1") is None
