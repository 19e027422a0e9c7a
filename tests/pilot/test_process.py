"""The whole robot drives: pilot, gateway, virtual bus, wheels, gyro, odometry."""

import math
import signal
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from tests.conftest import Rendezvous, wait_until
from tests.odometry.simulation import steered_drive
from tests.robot import Robot, chain, process, running, write
from wackel_node.config import RobotConfig, ServoConfig
from wackel_node.config_drive import GyroConfig
from wackel_node.errors import FAILED, NOT_REACHED, USAGE
from wackel_node.link import Link
from wackel_node.node import Node
from wackel_node.session import NotReached
from wackel_pilot import service
from wackel_pilot.path import circle
from wackel_schemas import keys
from wackel_schemas.bus import BusRequest, BusState
from wackel_schemas.drive import Odometry, TwistCommand
from wackel_schemas.virtual import Injection, VirtualRequest

pytestmark = pytest.mark.process

IDS = (0, 100, 1, 101, 2, 102)


def wheeled(directory: Path) -> RobotConfig:
    config = chain(directory, 0)
    bus = msgspec.structs.replace(
        config.buses["main"], servos=[ServoConfig(id=i) for i in IDS], return_delay_us=0
    )
    return msgspec.structs.replace(
        config, buses={"main": bus}, drive=steered_drive(3), gyros={"body": GyroConfig()}
    )


class Watch:
    """What the robot says."""

    def __init__(self, robot: Robot) -> None:
        self.odometry = Odometry(
            stamp=0, x=0, y=0, theta=0, vx=0, vy=0, omega=0,
            pose_covariance=[], twist_covariance=[], valid=False,
        )  # fmt: skip
        self.commands: list[TwistCommand] = []
        self.rates: dict[int, float | None] = {}
        robot.link.subscribe(keys.ODOMETRY, self._odometry)
        robot.link.subscribe(keys.TWIST_COMMAND, lambda _, each: self.commands.append(each))
        robot.link.subscribe(keys.STATE, self._state)

    def _odometry(self, _: str, message: Odometry) -> None:
        self.odometry = message

    def _state(self, _: str, state: BusState) -> None:
        self.rates |= {servo.id: servo.velocity for servo in state.servos}


def pilot(directory: Path, *more: str) -> list[str]:
    return ["wackel_cli", "pilot", "--config", str(directory / "robot.toml"), *more]


def test_the_robot_drives_and_stops_when_the_pilot_is_stopped(tmp_path: Path) -> None:
    with running(wheeled(tmp_path), tmp_path) as robot:
        robot.wait(robot.ready)
        watch = Watch(robot)
        arguments = pilot(tmp_path, "--speed", "0.2", "--acceleration", "1")
        with process(*arguments, log=tmp_path / "pilot.log") as driver:
            robot.wait(lambda: watch.odometry.valid and watch.odometry.theta > 0.4)
            twist = pytest.approx((0.2, 0.2), rel=0.1)
            robot.wait(lambda: (watch.odometry.vx, watch.odometry.omega) == twist)
            # The pose is on a circle of 1 m about (0, 1).
            assert math.hypot(watch.odometry.x, watch.odometry.y - 1.0) == pytest.approx(
                1.0, abs=0.05
            )
            gaps = [b.stamp - a.stamp for a, b in pairwise(watch.commands[50:])]
            assert sorted(gaps)[len(gaps) // 2] == pytest.approx(10_000_000, rel=0.2)

            with process(*pilot(tmp_path), log=tmp_path / "second.log") as second:
                assert second.wait(20.0) == FAILED
            assert "a pilot drives" in (tmp_path / "second.log").read_text()

            # A fault of the drive shows on the bus.
            request = VirtualRequest(
                operation="inject", injection=Injection(kind="wheel_blocked", wheel="w0")
            )
            assert robot.link.ask(keys.VIRTUAL_REQUEST, request).ok
            robot.wait(lambda: watch.rates.get(0) == 0.0 and (watch.rates.get(1) or 0.0) > 2.0)
            assert robot.link.ask(keys.VIRTUAL_REQUEST, VirtualRequest(operation="heal")).ok
            robot.wait(lambda: (watch.rates.get(0) or 0.0) > 2.0)

            # A servo that has lost its torque gets it back.
            off = BusRequest(operation="write", id=1, register="torque_enable", value=0)
            assert robot.link.ask(keys.BUS_REQUEST, off, timeout_s=5.0, bus="main").ok
            on = BusRequest(operation="read", id=1, register="torque_enable")
            robot.wait(
                lambda: robot.link.ask(keys.BUS_REQUEST, on, timeout_s=5.0, bus="main").value == 1
            )

            driver.send_signal(signal.SIGTSTP)  # Ctrl-Z; what stops other services stops it, too
            assert driver.wait(5) == 0
        robot.wait(lambda: (watch.commands[-1].vx, watch.commands[-1].omega) == (0.0, 0.0))
        robot.wait(lambda: all(abs(watch.rates[i] or 0.0) < 0.05 for i in (0, 1, 2)))


def test_wheels_stop_when_the_pilot_is_killed(tmp_path: Path) -> None:
    with running(wheeled(tmp_path), tmp_path) as robot:
        robot.wait(robot.ready)
        watch = Watch(robot)
        with process(*pilot(tmp_path), log=tmp_path / "pilot.log") as driver:
            robot.wait(lambda: watch.odometry.valid and watch.odometry.vx > 0.2)
            driver.kill()
            driver.wait()
        robot.wait(lambda: all(abs(watch.rates[i] or 0.0) < 0.05 for i in (0, 1, 2)))


def test_it_does_not_outlive_the_robot(tmp_path: Path) -> None:
    with running(wheeled(tmp_path), tmp_path) as robot:
        robot.wait(robot.ready)
        watch = Watch(robot)
        with process(*pilot(tmp_path), log=tmp_path / "pilot.log") as driver:
            robot.wait(lambda: watch.odometry.valid and watch.odometry.vx > 0.1)
            robot.up.send_signal(signal.SIGINT)
            assert driver.wait(20) == NOT_REACHED
    assert "nothing has come from bus main" in (tmp_path / "pilot.log").read_text()


def test_without_a_gateway_it_says_what_to_start(tmp_path: Path) -> None:
    write(wheeled(tmp_path), tmp_path)
    with process(*pilot(tmp_path), log=tmp_path / "pilot.log") as driver:
        assert driver.wait(20) == NOT_REACHED
    assert "wackel up" in (tmp_path / "pilot.log").read_text()


def test_where_another_robot_runs_it_says_so(
    rendezvous: Rendezvous, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "REQUEST_S", 2.0)  # who else is there is known soon
    config = msgspec.structs.replace(wheeled(tmp_path), zenoh=rendezvous.config.zenoh)
    assert config.drive is not None
    other = msgspec.structs.replace(rendezvous.config, robot="otherbot")
    told = "no gateway of bus main of robot testbot answers: here runs otherbot"
    with Node("gateway", "main", other), Link(config) as link:
        wait_until(lambda: link.robots() == {"otherbot"})
        with pytest.raises(NotReached, match=told):
            service.run(config, config.drive, circle(0.3, 1.0, 0.3), None)


def test_without_wheels_it_says_so(tmp_path: Path) -> None:
    write(chain(tmp_path, 2), tmp_path)
    with process(*pilot(tmp_path), log=tmp_path / "pilot.log") as driver:
        assert driver.wait(20) == USAGE
    assert "[drive]" in (tmp_path / "pilot.log").read_text()


def test_a_robot_that_cannot_be_driven_is_not_driven(tmp_path: Path) -> None:
    config = wheeled(tmp_path)
    with running(config, tmp_path) as robot:
        robot.wait(robot.ready)
        watch = Watch(robot)
        robot.inject("silent", 1)
        with process(*pilot(tmp_path), log=tmp_path / "silent.log") as driver:
            assert driver.wait(20) == NOT_REACHED
        assert (
            "servo 1 on bus main cannot be made to drive" in (tmp_path / "silent.log").read_text()
        )
        robot.listen(0.2)
        assert watch.commands == []
    tapped = msgspec.structs.replace(config.buses["main"], mode="tap")
    write(msgspec.structs.replace(config, buses={"main": tapped}), tmp_path)
    with process(*pilot(tmp_path), log=tmp_path / "tap.log") as driver:
        assert driver.wait(20) == USAGE
    assert "buses.main.mode = 'tap'" in (tmp_path / "tap.log").read_text()
