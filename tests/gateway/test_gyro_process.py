"""A gyro on the servo bus: real gateway, real pseudo-terminal."""

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from time import sleep

import msgspec
import pytest

from tests.conftest import Rendezvous, wait_until
from tests.robot import chain, running
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, dump
from wackel_node.config_drive import GyroConfig, GyroRegister
from wackel_node.link import Link
from wackel_protocols.dynamixel2.packet import InstructionPacket
from wackel_schemas import keys
from wackel_schemas.bus import BusState, BusStatistics
from wackel_schemas.drive import ImuSample
from wackel_virtual.board import Board, boards
from wackel_virtual.bus import VirtualBus
from wackel_virtual.port import Ports

pytestmark = [pytest.mark.process, pytest.mark.alone]

GYROS = {
    "body": GyroConfig(
        source="bus",
        bus="main",
        id=200,
        registers={"x": GyroRegister(address=60), "z": GyroRegister(address=68)},
    ),
    "head": GyroConfig(
        source="bus",
        bus="main",
        id=201,
        registers={"z": GyroRegister(address=30, encoding="int16", scale=0.001)},
    ),
}


class Watcher:
    """What the gateway publishes."""

    def __init__(self, link: Link, ports: Ports) -> None:
        self.link = link
        self.ports = ports
        self.samples: dict[str, list[ImuSample]] = {name: [] for name in GYROS}
        self.states: list[BusState] = []
        self.statistics: list[BusStatistics] = []
        link.subscribe(keys.IMU, lambda key, m: self.samples[key.split("/")[1]].append(m))
        link.subscribe(keys.STATE, lambda _, m: self.states.append(m))
        link.subscribe(keys.STATISTICS, lambda _, m: self.statistics.append(m))

    def board(self, board_id: int) -> Board:
        return self.ports.call(lambda buses: buses["main"].boards[board_id])

    def wait(self, condition: Callable[[], bool]) -> None:
        wait_until(condition, 10, lambda: self.link.pump(0.02))


@pytest.fixture
def watcher(rendezvous: Rendezvous, tmp_path: Path) -> Iterator[Watcher]:
    bus = BusConfig(
        port=str(tmp_path / "bus"),
        return_delay_us=0,
        servos=[ServoConfig(id=1), ServoConfig(id=2)],
    )
    config: RobotConfig = msgspec.structs.replace(
        rendezvous.config, buses={"main": bus}, gyros=GYROS
    )
    path = tmp_path / "robot.toml"
    path.write_text(dump(config), encoding="utf-8")
    virtual = VirtualBus(bus, 1, boards=boards(GYROS, "main"))
    with Ports({"main": (virtual, Path(bus.port))}) as ports, Link(config) as link:
        watcher = Watcher(link, ports)
        process = subprocess.Popen([sys.executable, "-m", "wackel_gateway", "--config", str(path)])
        try:
            yield watcher
        finally:
            process.terminate()
            assert process.wait(5) == 0


def test_every_cycle_gives_a_sample_with_the_time_at_which_it_was_taken(watcher: Watcher) -> None:
    board = watcher.board(200)
    watcher.wait(lambda: len(watcher.samples["body"]) > 20 and len(watcher.samples["head"]) > 20)
    before = watcher.link.clock.now_ns()
    board.rates["body"] = (0.25, 9.0, -1.5)  # it has no register for y
    watcher.board(201).rates["head"] = (0.0, 0.0, 1.2344)
    shown = (0.25, 0.0, -1.5)
    watcher.wait(lambda: watcher.samples["body"][-1].angular_velocity == shown)
    first = next(s for s in watcher.samples["body"] if s.angular_velocity == shown)
    assert before - 5_000_000 < first.stamp < watcher.link.clock.now_ns()
    watcher.wait(lambda: watcher.samples["head"][-1].angular_velocity[2] == pytest.approx(1.234))
    stamps = [sample.stamp for sample in watcher.samples["body"]]
    assert stamps == sorted(stamps)
    seqs = [sample.seq for sample in watcher.samples["body"]]
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))
    watcher.wait(lambda: len(watcher.statistics) >= 3)
    cycles = watcher.statistics[-1].cycle_rate
    assert cycles == pytest.approx(100.0, rel=0.1)
    # Rates of samples and cycles are the same, over the whole time.
    span_s = (stamps[-1] - stamps[0]) / 1e9
    assert (len(stamps) - 1) / span_s == pytest.approx(cycles, rel=0.2)


def test_a_board_that_falls_silent_costs_the_servos_nothing(watcher: Watcher) -> None:
    watcher.wait(lambda: len(watcher.samples["body"]) > 10)
    watcher.board(200).silent = True
    heard = len(watcher.samples["body"])
    watcher.wait(lambda: len(watcher.samples["head"]) > 0 and len(watcher.states) > 300)
    assert len(watcher.samples["body"]) <= heard + 20
    watcher.statistics.clear()
    watcher.wait(lambda: len(watcher.statistics) >= 2)
    assert watcher.statistics[-1].cycle_rate > 80.0
    watcher.board(200).silent = False
    heard = len(watcher.samples["body"])
    watcher.wait(lambda: len(watcher.samples["body"]) > heard + 50)


def test_a_sample_that_was_held_back_says_so(watcher: Watcher) -> None:
    samples = watcher.samples["body"]
    watcher.wait(lambda: len(samples) > 50)
    board = watcher.board(200)
    answer = board.execute
    asked = count()

    def now_and_then_late(packet: InstructionPacket) -> tuple[int, bytes]:
        if next(asked) % 20 == 0:
            sleep(0.012)  # in the bus's own thread: as an adapter may hold everything back
        return answer(packet)

    board.execute = now_and_then_late
    watcher.wait(lambda: sum(sample.late_s > 0.008 for sample in samples) > 2)
    assert all(0.0 <= sample.late_s < 1.0 for sample in samples)


def test_what_is_no_number_is_counted_and_not_published(watcher: Watcher) -> None:
    watcher.wait(lambda: bool(watcher.samples["body"]))
    watcher.board(200).rates["body"] = (float("nan"), 0.0, 0.0)
    watcher.wait(
        lambda: (
            bool(watcher.statistics)
            and watcher.statistics[-1].rejected.get("gyro sends no number", 0) > 10
        )
    )
    rates = [rate for sample in watcher.samples["body"] for rate in sample.angular_velocity]
    assert all(map(math.isfinite, rates))


def test_a_board_on_the_bus_is_no_fault(tmp_path: Path) -> None:
    bus = BusConfig(port=str(tmp_path / "bus"), servos=[ServoConfig(id=i) for i in (1, 2, 3)])
    config = RobotConfig(
        robot="testbot",
        buses={"main": bus},
        gyros=GYROS,
        zenoh=chain(tmp_path, 1).zenoh,
        state_directory=str(tmp_path / "state"),
    )
    samples: list[ImuSample] = []
    with running(config, tmp_path) as robot:
        robot.link.subscribe(keys.IMU, lambda _, sample: samples.append(sample))
        robot.wait(robot.ready)
        robot.wait(lambda: len(samples) > 500)
        assert robot.health.level == "ok"
        # That the computer was late is information, of itself.
        assert [fault for fault in robot.health.faults if fault.code != "host_lag"] == []
