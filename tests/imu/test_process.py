"""``wackel imu`` as a process: waits for its device, publishes, tells what is wrong."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from tests.conftest import Rendezvous, wait_until
from tests.imu.tree import SCALE, SCAN, Tree
from wackel_aggregator.service import needed_services
from wackel_cli.up import robot_jobs
from wackel_node.config import BusConfig, RobotConfig, dump
from wackel_node.config_drive import GyroConfig
from wackel_node.errors import USAGE
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.drive import ImuSample
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Heartbeat

pytestmark = pytest.mark.process

GYRO = GyroConfig(source="iio", device="lsm6dsl_gyro", rate=100.0)


class Driver(threading.Thread):
    """The kernel's part: a scan each 10 ms, as long as the buffer is enabled."""

    def __init__(self, tree: Tree) -> None:
        super().__init__()
        self._tree = tree
        self.sent = 0
        self.ended = threading.Event()

    def run(self) -> None:
        feeder = self._open()
        while not self.ended.wait(0.01):
            scan = SCAN.pack(1, 2, self.sent % 1000, time.monotonic_ns())
            with suppress(BlockingIOError, BrokenPipeError):
                os.write(feeder, scan)
                self.sent += 1
        os.close(feeder)

    def _open(self) -> int:
        while not self.ended.is_set():
            with suppress(OSError):  # nobody reads yet
                return self._tree.feeder()
            self.ended.wait(0.01)
        return os.open(os.devnull, os.O_WRONLY)


class Watcher:
    def __init__(self, link: Link) -> None:
        self.link = link
        self.samples: list[ImuSample] = []
        self.reports: list[FaultReport] = []
        self.states: list[str] = []
        link.subscribe(keys.IMU, lambda _, sample: self.samples.append(sample), name="body")
        link.subscribe(keys.FAULT, lambda _, report: self.reports.append(report))
        link.subscribe(keys.ALIVE, lambda _, beat: self._beat(beat), service="imu")

    def _beat(self, beat: Heartbeat) -> None:
        self.states.append(beat.state)

    def wait(self, condition: Callable[[], bool]) -> None:
        wait_until(condition, 15, lambda: self.link.pump(0.02))


@pytest.fixture
def watcher(rendezvous: Rendezvous, tmp_path: Path) -> Iterator[Watcher]:
    config: RobotConfig = msgspec.structs.replace(rendezvous.config, gyros={"body": GYRO})
    path = tmp_path / "robot.toml"
    path.write_text(dump(config), encoding="utf-8")
    command = [sys.executable, "-m", "wackel_cli", "imu", "--config", str(path)]
    places = ["--sysfs", str(tmp_path / "sys"), "--dev", str(tmp_path / "dev")]
    with Link(config) as link:
        watcher = Watcher(link)
        process = subprocess.Popen([*command, *places])
        try:
            yield watcher
        finally:
            process.terminate()
            assert process.wait(5) == 0


def test_samples_come_with_the_rate_and_the_stamps_of_the_device(
    watcher: Watcher, tmp_path: Path
) -> None:
    driver = Driver(Tree(tmp_path))
    driver.start()
    try:
        watcher.wait(lambda: len(watcher.samples) > 200)
    finally:
        driver.ended.set()
        driver.join()
    stamps = [sample.stamp for sample in watcher.samples]
    assert stamps == sorted(stamps)
    assert abs(stamps[-1] - time.time_ns()) < 5_000_000_000
    assert watcher.samples[0].angular_velocity[:2] == pytest.approx((SCALE, 2 * SCALE))
    raw = [round(sample.angular_velocity[2] / SCALE) for sample in watcher.samples]
    assert all(after == before + 1 for before, after in pairwise(raw))


def test_a_device_that_is_not_there_is_told_and_waited_for(
    watcher: Watcher, tmp_path: Path
) -> None:
    watcher.wait(lambda: "ready" in watcher.states)
    watcher.wait(lambda: any(report.repeated for report in watcher.reports))
    first = watcher.reports[0]
    assert (first.code, first.component, first.status) == ("gyro_absent", "gyro/body", "active")
    assert "no IIO device 'lsm6dsl_gyro'; there are none" in first.message
    driver = Driver(Tree(tmp_path))
    driver.start()
    try:
        watcher.wait(lambda: watcher.reports[-1].status == "healed")
        watcher.wait(lambda: len(watcher.samples) > 20)
    finally:
        driver.ended.set()
        driver.join()
    watcher.wait(lambda: watcher.reports[-1].status == "active")  # it was unplugged


@pytest.mark.parametrize(
    ("gyros", "arguments", "told"),
    [
        ({}, [], "say which gyro with --gyro; there are none"),
        ({"a": GYRO, "b": GYRO}, [], "say which gyro with --gyro; there are a, b"),
        ({"a": GYRO}, ["--gyro", "c"], "--gyro c: there is no such gyro of source iio"),
    ],
)
def test_which_gyro_must_be_clear(
    tmp_path: Path, gyros: dict[str, GyroConfig], arguments: list[str], told: str
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(dump(RobotConfig(gyros=gyros)), encoding="utf-8")
    command = [sys.executable, "-m", "wackel_cli", "imu", "--config", str(path), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == USAGE
    assert told in done.stderr


def test_a_robot_with_such_a_gyro_runs_the_service_and_needs_it() -> None:
    config = RobotConfig(buses={"main": BusConfig(port="p")}, gyros={"body": GYRO})
    jobs = [job.name for job in robot_jobs(config, Path("robot.toml"))]
    assert "imu/body" in jobs
    assert "imu/body" in needed_services(config)
    other = msgspec.structs.replace(config, gyros={"body": GyroConfig()})
    assert "imu/body" not in needed_services(other)
