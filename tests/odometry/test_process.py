"""The service as a process, over Zenoh."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from tests.conftest import Rendezvous, wait_until
from tests.odometry.simulation import BUS, GYRO, START_NS, Robot, differential_drive, exact
from tests.odometry.test_core import SECOND, statistics
from wackel_cli.pose import main
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, dump
from wackel_node.config_drive import GyroConfig
from wackel_node.errors import USAGE
from wackel_node.link import Link
from wackel_schemas import component, keys
from wackel_schemas.drive import (
    Exclusion,
    Exclusions,
    ImuSample,
    Odometry,
    OdometryRequest,
    PoseSet,
)
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Heartbeat
from wackel_schemas.inputs import Inputs

pytestmark = pytest.mark.process


def with_drive(config: RobotConfig) -> RobotConfig:
    bus = BusConfig(port="nowhere", servos=[ServoConfig(id=1), ServoConfig(id=2)])
    return RobotConfig(
        robot=config.robot,
        zenoh=config.zenoh,
        state_directory=config.state_directory,
        buses={BUS: bus},
        drive=differential_drive(),
        gyros={GYRO: GyroConfig()},
    )


def start(config: RobotConfig, directory: Path) -> subprocess.Popen[bytes]:
    path = directory / "robot.toml"
    path.write_text(dump(config), encoding="utf-8")
    command = [sys.executable, "-m", "wackel_cli", "odometry", "--config", str(path)]
    return subprocess.Popen(command, stderr=subprocess.PIPE)


class Watcher:
    """A client that publishes what sensors would, and keeps what the service says."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.told: list[Odometry] = []
        self.reports: list[FaultReport] = []
        self.states: list[str] = []
        self.poses_set: list[PoseSet] = []
        self.inputs: list[str] = []
        link.subscribe(keys.ODOMETRY, lambda _, message: self.told.append(message))
        link.subscribe(keys.FAULT, lambda _, message: self.reports.append(message))
        link.subscribe(keys.POSE_SET, lambda _, message: self.poses_set.append(message))
        link.subscribe(keys.INPUTS, self._took, service="odometry")
        link.subscribe(keys.ALIVE, self._beat, service="odometry")
        self.robot = Robot(differential_drive(), exact(2), np.random.default_rng(1))
        self._states = link.publisher(keys.STATE, bus=BUS)
        self._samples = link.publisher(keys.IMU, name=GYRO)
        self.statistics = link.publisher(keys.STATISTICS, bus=BUS)
        self.exclusions = link.publisher(keys.EXCLUSIONS)

    def _beat(self, _: str, beat: Heartbeat) -> None:
        self.states.append(beat.state)

    def _took(self, _: str, inputs: Inputs) -> None:
        self.inputs += [inputs.streams[index].key for index in inputs.order]

    def drive(self, cycles: int, *twist: float) -> None:
        for moment in self.robot.drive(np.tile(np.array(twist), (cycles, 1))):
            self._states.put(moment.state)
            self._samples.put(moment.sample)
            self.wait(partial(self._reached, moment.state.stamp - 20_000_000))

    def sample(self, sample: ImuSample) -> None:
        self._samples.put(sample)

    def _reached(self, stamp: int) -> bool:
        """The service keeps pace, so that nothing is dropped on the way."""
        return stamp <= START_NS + 20_000_000 or bool(self.told and self.told[-1].stamp >= stamp)

    def wait(self, condition: Callable[[], bool]) -> None:
        wait_until(condition, meanwhile=lambda: self.link.pump(0.02))


@pytest.fixture
def service(rendezvous: Rendezvous, tmp_path: Path) -> Iterator[Watcher]:
    config = with_drive(rendezvous.config)
    with Link(config, "client") as link:
        watcher = Watcher(link)
        process = start(config, tmp_path)
        try:
            watcher.wait(lambda: "ready" in watcher.states)
            yield watcher
        finally:
            process.terminate()
            process.communicate(timeout=5)
        assert process.returncode == 0


def test_wheels_and_gyro_go_in_and_a_pose_comes_out(service: Watcher) -> None:
    service.drive(50, 0.0, 0.0, 0.0)
    service.drive(100, 0.4, 0.0, 0.5)
    latest = service.told[-1]
    assert latest.valid
    assert latest.vx == pytest.approx(0.4, abs=0.01)
    assert latest.x == pytest.approx(0.38, abs=0.03)
    assert [message.seq for message in service.told] == list(range(len(service.told)))

    reply = service.link.ask(keys.ODOMETRY_REQUEST, OdometryRequest(operation="reset"))
    assert reply.ok
    assert reply.odometry is not None
    assert reply.odometry.x == 0.0
    service.drive(10, 0.4, 0.0, 0.5)
    assert service.told[-1].x < 0.1


def test_a_pose_that_was_set_is_an_input_of_recordings(service: Watcher) -> None:
    service.drive(20, 0.4, 0.0, 0.0)
    latest = service.link.ask(keys.ODOMETRY_REQUEST, OdometryRequest(operation="get")).odometry
    assert latest is not None
    assert latest.age_s < 3600.0  # though the messages' stamps are of another year
    refused = OdometryRequest(operation="set_pose", position_sigma=-1.0)
    assert not service.link.ask(keys.ODOMETRY_REQUEST, refused).ok
    asked = OdometryRequest(operation="set_pose", x=3.0, y=-1.0, theta=0.5)
    assert service.link.ask(keys.ODOMETRY_REQUEST, asked).ok
    service.drive(20, 0.4, 0.0, 0.0)
    service.wait(lambda: keys.POSE_SET.key() in service.inputs)
    assert [message.request for message in service.poses_set] == [asked]

    # It stands between those of the states that came before and after.
    at = service.inputs.index(keys.POSE_SET.key())
    assert 20 <= service.inputs[:at].count(keys.STATE.key(bus=BUS)) < 40


def test_a_person_sees_the_pose_and_sets_it(
    service: Watcher, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--config", str(tmp_path / "robot.toml")]
    assert main(where) == 1
    assert capsys.readouterr().err == "no step has been made yet\n"
    service.drive(20, 0.0, 0.0, 0.0)
    assert main(["set", "3", "-1", "0.5", *where]) == 0
    assert main(where) == 0
    shown = capsys.readouterr().out
    assert "the pose is 3 m, -1 m, 0.5 rad\nat +3.000 m -1.000 m, heading +0.5000 rad" in shown
    assert main(["set", "nan", "0", "0", *where]) == 1
    assert "must be numbers" in capsys.readouterr().err
    assert main(["reset", *where]) == 0
    assert main(["--json", *where]) == 0
    assert '"x": 0.0' in capsys.readouterr().out


def test_a_bus_that_goes_on_alone_tells_that_the_pose_is_not_known(service: Watcher) -> None:
    service.drive(20, 0.4, 0.0, 0.0)
    for second in (1, 2):
        service.statistics.put(statistics(START_NS + second * SECOND))
    service.wait(lambda: bool(service.reports) and not service.told[-1].valid)
    assert service.reports[0].code == "pose_unknown"
    service.wait(lambda: service.inputs.count(keys.STATISTICS.key(bus=BUS)) == 2)


def test_the_diagnoser_is_obeyed_and_faults_are_told_again(service: Watcher) -> None:
    one = Exclusion(component=component.wheel_drive("left"), fault="sensor", reason="stuck")
    service.drive(5, 0.4, 0.0, 0.0)
    service.exclusions.put(Exclusions(stamp=START_NS, excluded=[one]))

    def obeyed() -> bool:
        service.drive(1, 0.4, 0.0, 0.0)
        return service.told[-1].excluded == [one]

    service.wait(obeyed)
    bad = ImuSample(stamp=service.told[-1].stamp, angular_velocity=(float("nan"), 0.0, 0.0))
    service.sample(bad)
    service.wait(lambda: any(report.repeated for report in service.reports))
    assert service.reports[0].code == "bad_input"
    assert replace(service.reports[-1], repeated=False, seq=0) == replace(
        service.reports[0], repeated=False, seq=0
    )


def test_a_late_service_learns_what_was_excluded_before(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    config = with_drive(rendezvous.config)
    one = Exclusion(component=component.gyro(GYRO), fault="sensor", reason="drifts")
    with Link(config, "client") as link:
        watcher = Watcher(link)
        watcher.exclusions.put(Exclusions(stamp=START_NS, excluded=[one]))
        process = start(config, tmp_path)
        try:
            watcher.wait(lambda: "ready" in watcher.states)

            def known() -> bool:
                watcher.drive(3, 0.4, 0.0, 0.0)
                return bool(watcher.told) and watcher.told[-1].excluded == [one]

            watcher.wait(known)
        finally:
            process.terminate()
            process.communicate(timeout=5)


def test_a_robot_without_wheels_gets_a_hint(robot_config: RobotConfig, tmp_path: Path) -> None:
    process = start(robot_config, tmp_path)
    _, errors = process.communicate(timeout=10)
    assert process.returncode == USAGE
    assert b"no [drive]" in errors
