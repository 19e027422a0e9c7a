"""The service as a process, over Zenoh."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import Rendezvous, wait_until
from tests.diagnoser.rig import GYRO, Rig
from tests.odometry.simulation import BUS
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, dump
from wackel_node.config_drive import GyroConfig
from wackel_node.errors import USAGE
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.drive import Exclusions
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Heartbeat
from wackel_schemas.residuals import Residuals

pytestmark = pytest.mark.process


def command(path: Path) -> list[str]:
    return [sys.executable, "-m", "wackel_cli", "diagnoser", "--config", str(path)]


def test_messages_go_in_and_a_blocked_wheel_comes_out(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    rig = Rig.of("tune/process")
    servos = [ServoConfig(id=i) for i in (0, 1, 2, 3, 100, 101, 102, 103)]
    config = RobotConfig(
        robot=rendezvous.config.robot,
        zenoh=rendezvous.config.zenoh,
        state_directory=rendezvous.config.state_directory,
        buses={BUS: BusConfig(port="nowhere", servos=servos)},
        drive=rig.config,
        gyros={GYRO: GyroConfig()},
    )
    path = tmp_path / "robot.toml"
    path.write_text(dump(config), encoding="utf-8")
    seen: list[Residuals] = []
    reports: list[FaultReport] = []
    exclusions: list[Exclusions] = []
    states: list[str] = []

    def on_beat(_: str, beat: Heartbeat) -> None:
        states.append(beat.state)

    with Link(config, "client") as link:
        link.subscribe(keys.RESIDUALS, lambda _, message: seen.append(message))
        link.subscribe(keys.FAULT, lambda _, message: reports.append(message))
        link.subscribe(keys.EXCLUSIONS, lambda _, message: exclusions.append(message))
        link.subscribe(keys.ALIVE, on_beat, service="diagnoser")
        commands = link.publisher(keys.TWIST_COMMAND)
        wheels = link.publisher(keys.STATE, bus=BUS)
        gyros = link.publisher(keys.IMU, name=GYRO)

        def drive(cycles: int) -> None:
            for _ in range(cycles):
                cycle = rig.cycle()
                commands.put(cycle.command)
                gyros.put(cycle.imu)
                wheels.put(cycle.state)
                late = cycle.state.stamp - 300_000_000
                # The service keeps pace, so that nothing is dropped on the way.
                wait_until(
                    lambda late=late: rig.cycles < 60 or bool(seen and seen[-1].stamp >= late),
                    meanwhile=lambda: link.pump(0.001),
                )

        process = subprocess.Popen(command(path), stderr=subprocess.PIPE)
        try:
            wait_until(lambda: "ready" in states, meanwhile=lambda: link.pump(0.02))
            drive(400)
            assert reports == []
            assert [message.excluded for message in exclusions] == [[]]
            rig.inject("wheel_blocked", "w1")
            drive(100)
            wait_until(
                lambda: any(report.repeated for report in reports),
                meanwhile=lambda: link.pump(0.02),
            )
        finally:
            process.terminate()
            process.communicate(timeout=5)
    assert process.returncode == 0
    assert reports[0].component == "wheel/w1/drive"
    assert [each.component for each in exclusions[-1].excluded] == ["wheel/w1/drive"]
    assert seen[-1].verdict == ["wheel/w1/drive"]


def test_a_robot_without_wheels_is_wrong_usage(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(dump(RobotConfig()), encoding="utf-8")
    done = subprocess.run(command(path), capture_output=True, text=True, check=False, timeout=30)
    assert done.returncode == USAGE
    assert "[drive]" in done.stderr
