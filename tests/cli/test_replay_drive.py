"""`wackel replay` of a robot whose drive fails: the wheel is named, and odometry leaves it out."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.test_replay import write
from tests.odometry.simulation import BUS, GYRO, steered_drive
from wackel_cli.replay import main
from wackel_node.config import BusConfig, RobotConfig, ServoConfig
from wackel_node.config_drive import GyroConfig
from wackel_schemas import wire
from wackel_schemas.virtual import Injection
from wackel_virtual.drive_simulation import DriveSimulation

CONFIG = RobotConfig(
    robot="testbot",
    buses={BUS: BusConfig(port="p", servos=[ServoConfig(id=i) for i in (0, 1, 2, 100, 101, 102)])},
    drive=steered_drive(3),
    gyros={GYRO: GyroConfig()},
)


def drive_with_a_blocked_wheel() -> Iterator[tuple[str, bytes]]:
    """Six seconds, then the wheel jams."""
    simulation = DriveSimulation(CONFIG, 3)
    simulation.inject(Injection(kind="wheel_blocked", wheel="w1", start_s=6.0))
    for cycle in range(680):
        moment = simulation.step(0.4, 0.0, 0.4 * math.sin(cycle / 100))
        yield "command/twist", wire.encode(moment.command)
        yield f"imu/{GYRO}", wire.encode(moment.imu)
        yield f"bus/{BUS}/state", wire.encode(moment.state)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "run.mcap"
    return write(path, list(drive_with_a_blocked_wheel()), CONFIG)


def test_the_wheel_is_named_twice_the_same_and_odometry_obeys(
    recording: Path, tmp_path: Path
) -> None:
    written = []
    for name in ("first", "second"):
        faults, odometry = tmp_path / f"{name}.faults", tmp_path / f"{name}.odometry"
        assert main([str(recording), "-o", str(faults), "--odometry", str(odometry)]) == 0
        written.append((faults.read_bytes(), odometry.read_bytes()))
    assert written[0] == written[1]
    faults = [json.loads(line) for line in written[0][0].splitlines()]
    blamed = {fault["component"] for fault in faults if fault["status"] == "active"}
    assert "wheel/w1/drive" in blamed
    left_out = [json.loads(line).get("excluded", []) for line in written[0][1].splitlines()]
    assert left_out[0] == []
    assert "wheel/w1/drive" in {each["component"] for each in left_out[-1]}
