"""The service as a process: transactions in, fault reports out."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.classifier.rig import Rig, chain
from tests.conftest import Rendezvous, wait_until
from wackel_node.config import RobotConfig
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.bus import Transaction
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Heartbeat

pytestmark = pytest.mark.process


class Watcher:
    """A link with what it has heard of the classifier."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.reports: list[FaultReport] = []
        self.beats: list[Heartbeat] = []
        link.subscribe(keys.FAULT, lambda _, report: self.reports.append(report))
        link.subscribe(keys.ALIVE, lambda _, beat: self.beats.append(beat), service="classifier")

    def wait(self, what: str, meanwhile: Callable[[], object] = lambda: None) -> None:
        conditions = {
            "ready": lambda: any(beat.state == "ready" for beat in self.beats),
            "active": lambda: any(report.status == "active" for report in self.reports),
            "repeated": lambda: any(report.repeated for report in self.reports),
            "rejected": lambda: any(beat.rejected for beat in self.beats),
        }

        def turn() -> None:
            meanwhile()
            self.link.pump(0.01)

        wait_until(conditions[what], meanwhile=turn)


@pytest.fixture
def config_file(tmp_path: Path, robot_config: RobotConfig) -> Path:
    file = tmp_path / "robot.toml"
    servos = ", ".join(f"{{ id = {servo.id} }}" for servo in chain(6).servos)
    file.write_text(
        f'robot = "{robot_config.robot}"\n'
        f'[zenoh]\nendpoint = "{robot_config.zenoh.endpoint}"\n'
        f'[buses.main]\nport = "none"\nservos = [{servos}]\n'
    )
    return file


@pytest.fixture
def service(rendezvous: Rendezvous, config_file: Path) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "wackel_classifier", "--config", str(config_file)]
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def broken_cable() -> Iterator[Transaction]:
    """Traffic of a bus whose cable to servo 4 breaks after half a second."""
    rig = Rig(chain(6), 1)
    yield from rig.traffic(0.5)
    rig.inject("break", 4)
    yield from rig.traffic(60.0)


def test_a_fault_is_published_at_once_and_then_repeated(
    service: subprocess.Popen[bytes], robot_config: RobotConfig
) -> None:
    with Link(robot_config, "peer") as link:
        watcher = Watcher(link)
        watcher.wait("ready")
        publisher, traffic = link.publisher(keys.TRANSACTION, bus="main"), broken_cable()
        watcher.wait("active", lambda: publisher.put(next(traffic)))
        first = watcher.reports[0]
        assert (first.code, first.component) == ("cable_break", "bus/main/cable/3-4")
        assert not first.repeated
        watcher.wait("repeated")
        assert [report.seq for report in watcher.reports] == list(range(len(watcher.reports)))


def test_traffic_of_a_bus_that_is_not_configured_is_counted(
    service: subprocess.Popen[bytes], robot_config: RobotConfig
) -> None:
    with Link(robot_config, "peer") as link:
        watcher = Watcher(link)
        watcher.wait("ready")
        publisher, traffic = link.publisher(keys.TRANSACTION, bus="other"), broken_cable()
        watcher.wait("rejected", lambda: publisher.put(next(traffic)))
        assert service.poll() is None


def test_it_stops_cleanly_on_a_signal(
    service: subprocess.Popen[bytes], robot_config: RobotConfig
) -> None:
    with Link(robot_config, "peer") as link:
        Watcher(link).wait("ready")
    service.send_signal(signal.SIGTERM)
    assert service.wait(timeout=5) == 0
