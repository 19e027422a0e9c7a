"""A gyro behind the servo bus fails while the robot drives; live, and again from the recording."""

from pathlib import Path

import msgspec
import pytest

from tests import robot as robots
from tests.end_to_end.command import wackel
from tests.odometry.simulation import steered_drive
from wackel_node.config import RecorderConfig, RobotConfig, ServoConfig
from wackel_node.config_drive import GyroConfig, GyroRegister
from wackel_schemas import keys
from wackel_schemas.drive import Odometry
from wackel_schemas.virtual import Injection, VirtualRequest

pytestmark = [pytest.mark.process, pytest.mark.alone]

GYRO = "gyro/body"


def wheeled(directory: Path) -> RobotConfig:
    """Three steered wheels and a board with a gyro, all on one bus; everything is recorded."""
    config = robots.chain(directory, 0, return_delay_us=0)
    servos = [ServoConfig(id=i) for i in (0, 100, 1, 101, 2, 102)]
    gyro = GyroConfig(source="bus", bus="main", id=200, registers={"z": GyroRegister(address=68)})
    made: RobotConfig = msgspec.structs.replace(
        config,
        buses={"main": msgspec.structs.replace(config.buses["main"], servos=servos)},
        drive=steered_drive(3),
        gyros={"body": gyro},
        recorder=RecorderConfig(directory=str(directory / "recordings")),
    )
    return made


def used(odometry: Odometry) -> bool:
    """Whether the gyro was believed in this step."""
    return any(each.name == GYRO and each.result == "used" for each in odometry.inputs)


def test_a_gyro_on_the_bus_that_freezes_is_told_live_and_in_the_recording(tmp_path: Path) -> None:
    latest: list[Odometry] = []

    def ask(robot: robots.Robot, request: VirtualRequest) -> None:
        reply = robot.link.ask(keys.VIRTUAL_REQUEST, request, timeout_s=5.0)
        assert reply.ok, reply.text

    with robots.running(wheeled(tmp_path), tmp_path) as robot:
        robot.wait(robot.ready, 60.0)
        robot.link.subscribe(keys.ODOMETRY, lambda _, message: latest.append(message))
        drive = ("pilot", "--config", str(tmp_path / "robot.toml"), "--path", "eight")
        with robots.process("wackel_cli", *drive, "--radius", "0.3", log=tmp_path / "pilot.log"):
            robot.wait(lambda: bool(latest) and abs(latest[-1].omega) > 0.3 and used(latest[-1]))
            assert robot.fault("gyro_frozen", GYRO) is None
            frozen = VirtualRequest(operation="inject", injection=Injection(kind="gyro_frozen"))
            ask(robot, frozen)
            robot.wait(lambda: robot.confirmed("gyro_frozen", GYRO))
            assert latest[-1].valid  # the wheels go on
            ask(robot, VirtualRequest(operation="heal"))
            robot.wait(lambda: robot.fault("gyro_frozen", GYRO).status == "healed")  # type: ignore[union-attr]
        robot.listen(1.5)
    (recording,) = (tmp_path / "recordings").iterdir()
    replayed = wackel("replay", recording, "--compare", "--json")
    assert replayed.returncode == 0, replayed.stdout[-2000:] + replayed.stderr[-2000:]
    assert '"gyro_frozen"' in replayed.stdout
    assert " 0 differences" in replayed.stderr
