"""The user's control software, the vendor's library, on a proxied bus while services die."""

import os
import signal
from pathlib import Path

import dynamixel_sdk as sdk
import pytest

from tests import robot as robots
from tests.conftest import wait_until
from tests.end_to_end.command import LIMIT_S
from tests.gateway.conftest import IDS
from tests.gateway.test_proxy_process import PRESENT_POSITION, Control
from tests.robot import SERVICES, Robot

pytestmark = pytest.mark.process


def controlling(robot: Robot, control: Control) -> None:
    """One step of a control loop, which takes whatever comes, and a look at health."""
    group = sdk.GroupSyncRead(control.port, control.packets, *PRESENT_POSITION)
    for servo_id in IDS:
        group.addParam(servo_id)
    group.txRxPacket()
    robot.link.pump(0.005)


def test_control_goes_on_whatever_dies_and_a_fault_is_named_from_its_traffic(
    tmp_path: Path,
) -> None:
    proxy_port = tmp_path / "control"
    config = robots.chain(
        tmp_path, len(IDS), mode="proxy", proxy_port=str(proxy_port), return_delay_us=0
    )
    with robots.running(config, tmp_path) as robot:
        robot.wait(lambda: robot.ready() and proxy_port.exists(), LIMIT_S)
        with Control(str(proxy_port)) as control:
            wait_until(control.ping)
            for service in ("classifier/main", "aggregator/main", "gateway/main"):
                os.kill(robot.pids()[service], signal.SIGKILL)
                assert control.goes_on()
            wait_until(
                lambda: all(robot.status(name) == "ready" for name in SERVICES),
                LIMIT_S,
                lambda: controlling(robot, control),
            )
            robot.inject("break", 4)
            wait_until(
                lambda: robot.confirmed("cable_break", "bus/main/cable/3-4"),
                LIMIT_S,
                lambda: controlling(robot, control),
            )
            assert control.ping(3)
            robot.heal()
            wait_until(
                lambda: not robot.confirmed("cable_break", "bus/main/cable/3-4"),
                LIMIT_S,
                lambda: controlling(robot, control),
            )
