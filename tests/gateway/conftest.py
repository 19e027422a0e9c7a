"""A virtual bus on a real pseudo-terminal, and a real gateway process beside it."""

import os
import select
import signal
import subprocess
import sys
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import sleep
from typing import Literal

import msgspec
import pytest

from tests.conftest import Rendezvous, wait_until
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, dump
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.bus import BusState, BusStatistics, Transaction
from wackel_schemas.fault import FaultReport
from wackel_schemas.virtual import Injection, VirtualRequest

IDS = (1, 2, 3, 4, 5, 6)


@dataclass
class Bus:
    """A virtual bus that runs in a process of its own."""

    config: BusConfig
    link: Link
    process: subprocess.Popen[bytes]

    def stall(self, seconds: float) -> None:
        """Holds everything back, as an adapter or its driver may do."""
        self.process.send_signal(signal.SIGSTOP)
        sleep(seconds)
        self.process.send_signal(signal.SIGCONT)

    def inject(self, kind: str, servo: int | None = None, value: float | None = None) -> None:
        self._ask("inject", Injection(kind=kind, servo=servo, value=value))

    def heal(self) -> None:
        self._ask("heal", Injection(kind=""))

    def _ask(self, operation: Literal["inject", "heal"], injection: Injection) -> None:
        request = VirtualRequest(operation=operation, injection=injection)
        reply = self.link.ask(keys.VIRTUAL_REQUEST, request, timeout_s=5)
        assert reply.ok, reply.text


@pytest.fixture
def bus_config(tmp_path: Path) -> BusConfig:
    return BusConfig(
        port=str(tmp_path / "bus"),
        proxy_port=str(tmp_path / "proxy"),
        return_delay_us=0,
        servos=[ServoConfig(id=servo_id) for servo_id in IDS],
    )


@pytest.fixture
def wire(bus_config: BusConfig) -> Iterator[int]:
    """A pseudo-terminal at the bus's port; here is its other side."""
    master, slave = os.openpty()
    tty.setraw(slave)
    Path(bus_config.port).symlink_to(os.ttyname(slave))
    yield master
    os.close(slave)
    os.close(master)


def stuff(port: Path) -> int:
    """Writes to a port until it takes no more; returns how many bytes it took."""
    fd = os.open(port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
    room = select.poll()
    room.register(fd, select.POLLOUT)
    taken = 0
    try:
        # The kernel moves what it took to the reader's side, which makes room again.
        while room.poll(300):
            with suppress(BlockingIOError):
                taken += os.write(fd, bytes(64))
    finally:
        os.close(fd)
    return taken


@pytest.fixture
def bus(rendezvous: Rendezvous, bus_config: BusConfig, tmp_path: Path) -> Iterator[Bus]:
    config: RobotConfig = msgspec.structs.replace(rendezvous.config, buses={"main": bus_config})
    path = tmp_path / "virtual.toml"
    path.write_text(dump(config), encoding="utf-8")
    process = subprocess.Popen([sys.executable, "-m", "wackel_virtual", "--config", str(path)])
    try:
        with Link(config) as link:
            alive: list[str] = []
            link.watch_alive(lambda name, _: alive.append(name))
            wait_until(lambda: "virtual/main" in alive, 10, lambda: link.pump(0.02))
            wait_until(Path(bus_config.port).is_symlink)
            yield Bus(bus_config, link, process)
    finally:
        process.terminate()
        process.wait(5)


@dataclass
class Gateway:
    """A gateway process and what it has published."""

    process: subprocess.Popen[bytes]
    link: Link
    transactions: list[Transaction] = field(default_factory=list)
    states: list[BusState] = field(default_factory=list)
    statistics: list[BusStatistics] = field(default_factory=list)
    faults: list[FaultReport] = field(default_factory=list)

    def listen(self) -> None:
        self.link.subscribe(keys.TRANSACTION, lambda _, m: self.transactions.append(m))
        self.link.subscribe(keys.STATE, lambda _, m: self.states.append(m))
        self.link.subscribe(keys.STATISTICS, lambda _, m: self.statistics.append(m))
        self.link.subscribe(keys.FAULT, lambda _, m: self.faults.append(m))

    def wait_until(self, condition: Callable[[], bool], limit_s: float = 10.0) -> None:
        wait_until(condition, limit_s, lambda: self.link.pump(0.02))

    def answering(self, ids: tuple[int, ...]) -> Callable[[], bool]:
        """The latest cycle has heard these servos and no other."""

        def condition() -> bool:
            cycles = [t for t in self.transactions[-40:] if len(t.expected) > 1]
            return bool(cycles) and tuple(r.id for r in cycles[-1].response_times) == ids

        return condition

    def stop(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(5)


StartGateway = Callable[[BusConfig], Gateway]


@pytest.fixture
def start_gateway(rendezvous: Rendezvous, tmp_path: Path) -> Iterator[StartGateway]:
    """Starts gateway processes for a bus called main, and ends them after the test."""
    started: list[subprocess.Popen[bytes]] = []
    links: list[Link] = []

    def start(bus_config: BusConfig) -> Gateway:
        config: RobotConfig = msgspec.structs.replace(rendezvous.config, buses={"main": bus_config})
        path = tmp_path / "robot.toml"
        path.write_text(dump(config), encoding="utf-8")
        link = Link(config)
        links.append(link)
        command = [sys.executable, "-m", "wackel_gateway", "--config", str(path)]
        process = subprocess.Popen(command)
        started.append(process)
        gateway = Gateway(process, link)
        gateway.listen()
        return gateway

    yield start
    for process in started:
        if process.poll() is None:
            process.terminate()
            process.send_signal(signal.SIGCONT)  # a test may have stopped it
            process.wait(5)
    for link in links:
        link.__exit__(None, None, None)
