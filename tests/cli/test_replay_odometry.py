"""`wackel replay` of a robot with wheels: the same odometry twice, and that of the live service."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.cli.test_replay import recorded, write
from tests.conftest import Rendezvous, wait_until
from tests.odometry.simulation import BUS, GYRO, Robot, differential_drive, exact
from tests.odometry.test_core import SECOND, statistics
from wackel_cli.diagnosis import Diagnosis
from wackel_cli.replay import main
from wackel_cli.replayed import ODOMETRY
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, dump
from wackel_node.config_drive import GyroConfig
from wackel_node.link import Link
from wackel_odometry.core import Odometer
from wackel_recording.reader import Entry
from wackel_schemas import wire
from wackel_schemas.bus import BusState, BusStatistics
from wackel_schemas.drive import ImuSample, Odometry, OdometryRequest
from wackel_schemas.fault import FaultReport
from wackel_schemas.keys import ALIVE, ODOMETRY_REQUEST
from wackel_schemas.keys import ODOMETRY as ODOMETRY_TOPIC
from wackel_schemas.message import Message

CONFIG = RobotConfig(
    robot="testbot",
    buses={BUS: BusConfig(port="p", servos=[ServoConfig(id=1), ServoConfig(id=2)])},
    drive=differential_drive(),
    gyros={GYRO: GyroConfig()},
)


def drive_round() -> Iterator[tuple[str, Message]]:
    """Four seconds of driving; for one of them the gyro sends what cannot be."""
    robot = Robot(differential_drive(), exact(2), np.random.default_rng(5))
    twists = np.zeros((400, 3))
    twists[50:, 0] = 0.3
    twists[100:, 2] = np.sin(np.arange(300) / 40)
    for number, moment in enumerate(robot.drive(twists)):
        sample = moment.sample
        if 150 <= number < 250:
            sample = ImuSample(stamp=sample.stamp, angular_velocity=(0.0, 0.0, float("nan")))
        yield f"imu/{GYRO}", sample
        yield f"bus/{BUS}/state", moment.state
    for second in (1, 2):  # then only the gateway goes on
        yield f"bus/{BUS}/statistics", statistics(moment.state.stamp + second * SECOND)


@pytest.fixture(scope="module")
def inputs() -> list[tuple[str, bytes]]:
    return [(key, wire.encode(message)) for key, message in drive_round()]


@pytest.fixture(scope="module")
def told(inputs: list[tuple[str, bytes]]) -> list[tuple[str, bytes]]:
    """The same recording with what the live odometry said in between."""
    odometer = Odometer(differential_drive(), CONFIG.gyros)
    messages = []
    for key, payload in inputs:
        messages.append((key, payload))
        if key.startswith("imu"):
            said = odometer.imu(GYRO, wire.decode(payload, ImuSample))
        elif key.endswith("statistics"):
            said = odometer.bus_statistics(BUS, wire.decode(payload, BusStatistics))
        else:
            said = odometer.bus_state(BUS, wire.decode(payload, BusState))
        messages += [
            ("fault/odometry", wire.encode(each)) for each in said if isinstance(each, FaultReport)
        ]
    return messages


def test_two_runs_give_the_same_odometry_and_faults_byte_for_byte(
    tmp_path: Path, inputs: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "run.mcap", inputs, CONFIG)
    written = []
    for name in ("first", "second"):
        odometry = tmp_path / f"{name}.odometry"
        faults = tmp_path / f"{name}.faults"
        assert main([str(path), "-o", str(faults), "--odometry", str(odometry)]) == 0
        written.append((faults.read_bytes(), odometry.read_bytes()))
    assert written[0] == written[1]
    faults = [json.loads(line) for line in written[0][0].splitlines()]
    assert {("bad_input", "gyro/body", "active"), ("pose_unknown", "odometry", "active")} <= {
        (fault["code"], fault["component"], fault["status"]) for fault in faults
    }
    steps = [json.loads(line) for line in written[0][1].splitlines()]
    assert len(steps) > 390
    assert steps[-1]["x"] > 0.5
    assert "odometry ends at" in capsys.readouterr().err


def test_faults_of_the_live_odometry_are_compared(
    tmp_path: Path, told: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(write(tmp_path / "run.mcap", told, CONFIG)), "--compare"]) == 0
    assert " 0 differences from 3 live reports" in capsys.readouterr().err
    at = next(n for n, (key, _) in enumerate(told) if key.startswith("fault/"))
    report = wire.decode(told[at][1], FaultReport)
    report.component = "gyro/other"
    other = [*told[:at], (told[at][0], wire.encode(report)), *told[at + 1 :]]
    assert main([str(write(tmp_path / "other.mcap", other, CONFIG)), "--compare"]) == 1
    assert "gyro/other active: only live" in capsys.readouterr().out


def test_a_robot_without_wheels_has_no_odometry(
    tmp_path: Path, inputs: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    config = RobotConfig(robot="testbot", buses=CONFIG.buses)
    assert main([str(write(tmp_path / "run.mcap", inputs, config))]) == 0
    assert "odometry" not in capsys.readouterr().err


@pytest.mark.process
def test_the_live_service_gives_the_same_odometry(
    rendezvous: Rendezvous, tmp_path: Path, inputs: list[tuple[str, bytes]]
) -> None:
    config = msgspec.structs.replace(CONFIG, zenoh=rendezvous.config.zenoh)
    robot_toml = tmp_path / "robot.toml"
    robot_toml.write_text(dump(config))
    source = write(tmp_path / "source.mcap", inputs, config)
    again = tmp_path / "again.mcap"

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "wackel_cli", *arguments, "--config", str(robot_toml)]
        return subprocess.Popen(command)

    ready: set[str] = set()
    odometry, recorder = start("odometry"), start("record", "-o", str(again))
    try:
        with Link(config) as link:
            link.subscribe(ALIVE, lambda key, beat: ready.add(key) if beat.state == "ready" else 0)
            told: list[Odometry] = []
            link.subscribe(ODOMETRY_TOPIC, lambda _, message: told.append(message))
            wait_until(lambda: len(ready) == 2, 20, meanwhile=lambda: link.pump(0.05))
            player = start("play", str(source), "--speed", "2")
            wait_until(lambda: len(told) > 100, 30, meanwhile=lambda: link.pump(0.05))
            asked = OdometryRequest(operation="set_pose", x=20.0, y=-3.0)
            assert link.ask(ODOMETRY_REQUEST, asked).ok
            assert player.wait(60) == 0
        wait_until(lambda: inputs[-1] in recorded(again), 20)
        recorder.send_signal(signal.SIGINT)
        assert recorder.wait(10) == 0
    finally:
        for process in (odometry, recorder):
            process.terminate()
            process.wait(10)
    heard = recorded(again)
    assert [each for each in heard if each[0] in dict(inputs)] == inputs
    assert "inputs/odometry/main" in dict(heard)
    live = [wire.decode(payload, Odometry) for key, payload in heard if key == "odometry"]
    assert live[-1].x > 19.0
    diagnosis = Diagnosis(config)
    wanted = (each for each in heard if diagnosis.wants(each[0]))
    entries = (Entry(key, n, n, payload) for n, (key, payload) in enumerate(wanted))
    replayed = [each for each in diagnosis.run(entries) if isinstance(each, Odometry)]
    assert len(live) == len(replayed) > 390
    assert [wire.encode(plain(each)) for each in live] == [
        wire.encode(plain(each)) for each in replayed
    ]
    assert diagnosis.services[ODOMETRY].reports
    assert main([str(again), "--compare"]) == 0


def plain(odometry: Odometry) -> Odometry:
    """Without what a publisher adds."""
    return msgspec.structs.replace(odometry, boot=0, seq=0)
