"""The gateway over pseudo-terminals with 20 servos: its CPU, its cycle, what its proxy adds.

All processes are real: virtual bus, rendezvous with a subscriber, gateway. What is compared takes
turns on buses of the same kind; a gateway that is not its turn is stopped (SIGSTOP).
"""

import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median, quantiles

import rustypot
from rich.table import Table

from tests.bench.result import Figure, table
from wackel_gateway.port import Port
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, ZenohConfig, dump
from wackel_node.link import Link
from wackel_protocols.dynamixel2 import fast_sync_read, ping, sync_read
from wackel_protocols.dynamixel2.expectation import expect
from wackel_schemas import keys
from wackel_schemas.bus import BusStatistics, Transaction
from wackel_virtual.bus import VirtualBus

IDS = tuple(range(1, 21))
_BLOCK = (126, 10)  # current, velocity, position of series X: what every cycle reads
_RATES = (1_000_000, 3_000_000, 4_000_000)
_UNLIMITED = 2000.0
_LIMIT_S = 20.0


def run(*, quick: bool = False) -> list[Table]:
    """Measures and compares; a full run takes about a minute."""
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        robot = _Robot(Path(directory), stack)
        turns = 3 if quick else 10
        figures = [*_cpu(robot, turns, fast=False), *_cpu(robot, turns, fast=True)]
        cycles = [figure for rate in _RATES for figure in _cycle(robot, rate, quick=quick)]
        proxy = _proxy(robot, exchanges=200 if quick else 1500)
    return [
        table("Gateway: CPU of the whole process for a transaction, 20 servos × 10 bytes", figures),
        table("Gateway: cycle of sync reads at unlimited rate, 20 servos × 10 bytes", cycles),
        table("Gateway: what mode proxy adds to an exchange", proxy),
    ]


class _Robot:
    """The virtual buses and the rendezvous, for all measurements."""

    def __init__(self, directory: Path, stack: ExitStack) -> None:
        self._directory = directory
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        servos = [ServoConfig(id=servo_id) for servo_id in IDS]
        names = ["peer", "bare", "proxied", *(f"poll{rate}" for rate in _RATES)]
        self.buses = {
            name: BusConfig(
                port=str(directory / name),
                proxy_port=str(directory / f"{name}-proxy"),
                baud_rate=int(name.removeprefix("poll")) if name.startswith("poll") else _RATES[0],
                rate=_UNLIMITED,
                return_delay_us=0,
                servos=servos,
            )
            for name in names
        }
        self.config = RobotConfig(
            robot="bench", buses=self.buses, zenoh=ZenohConfig(endpoint=endpoint)
        )
        path = self.write("all", self.config)
        stack.enter_context(_process("wackel_virtual", "--config", str(path), "--no-zenoh"))
        listener = stack.enter_context(_process("tests.bench.listener", str(path)))
        assert listener.stdout is not None
        listener.stdout.readline()
        _wait(lambda: all(Path(bus.port).exists() for bus in self.buses.values()))
        self.link = stack.enter_context(Link(self.config))

    def write(self, name: str, config: RobotConfig) -> Path:
        path = self._directory / f"{name}.toml"
        path.write_text(dump(config), encoding="utf-8")
        return path

    @contextmanager
    def gateway(self, name: str, **changes: object) -> Iterator["_Gateway"]:
        """A gateway process for a bus, once it has all servos."""
        values = {key: getattr(self.buses[name], key) for key in self.buses[name].__struct_fields__}
        bus = BusConfig(**(values | changes))
        config = RobotConfig(robot="bench", buses={name: bus}, zenoh=self.config.zenoh)
        arguments = ("--config", str(self.write(f"gateway-{name}", config)))
        with _process("wackel_gateway", *arguments) as process:
            gateway = _Gateway(self.link, name, process.pid)
            _wait(gateway.running)
            yield gateway


class _Gateway:
    """A running gateway, seen from outside."""

    def __init__(self, link: Link, bus: str, pid: int) -> None:
        self._link = link
        self._pid = pid
        self._latest: BusStatistics | None = None
        self.cycles: list[Transaction] = []
        link.subscribe(keys.STATISTICS, self._on_statistics, bus=bus)
        link.subscribe(keys.TRANSACTION, self._on_transaction, bus=bus)

    def _on_statistics(self, _: str, message: BusStatistics) -> None:
        self._latest = message

    def _on_transaction(self, _: str, message: Transaction) -> None:
        if len(message.expected) == len(IDS):
            self.cycles.append(message)

    def running(self) -> bool:
        """Whether it has told its statistics, and with all servos if it polls."""
        self._link.pump(0.1)
        latest = self._latest
        return (
            latest is not None
            and latest.connected
            and (latest.mode != "poll" or len(self.cycles) > 100)
        )

    def pause(self) -> None:
        os.kill(self._pid, signal.SIGSTOP)

    def resume(self) -> None:
        os.kill(self._pid, signal.SIGCONT)

    def cpu_ns(self) -> int:
        """CPU time of all its threads so far."""
        tasks = Path(f"/proc/{self._pid}/task").glob("*/schedstat")
        return sum(int(task.read_text().split()[0]) for task in tasks)

    def transactions(self, seconds: float) -> tuple[int, int]:
        """(Transactions, CPU ns) within so many periods of its statistics."""
        first = self._next()
        cpu_ns = self.cpu_ns()
        last = first
        for _ in range(round(seconds)):
            last = self._next()
        return last.transactions - first.transactions, self.cpu_ns() - cpu_ns

    def _next(self) -> BusStatistics:
        self._latest = None
        _wait(lambda: self._link.pump(0.2) is None or self._latest is not None)
        assert self._latest is not None
        return self._latest


def _cpu(robot: _Robot, turns: int, *, fast: bool) -> list[Figure]:
    """The gateway with all it does, against the bare read of a library with a Rust core."""
    peer = rustypot.Xl430PyController(robot.buses["peer"].port, _RATES[0], 0.1)
    peer.set_fast_sync_read(fast)
    calls = 200
    ours: list[float] = []
    theirs: list[float] = []
    with robot.gateway(f"poll{_RATES[0]}", fast_sync_read=fast) as gateway:
        for _ in range(turns):
            count, cpu_ns = gateway.transactions(seconds=1)
            ours.append(cpu_ns / count / 1000)
            gateway.pause()
            begin = time.process_time_ns()
            for _ in range(calls):
                peer.sync_read_raw_data(list(IDS), *_BLOCK)
            theirs.append((time.process_time_ns() - begin) / calls / 1000)
            gateway.resume()
            gateway.transactions(seconds=1)
    name = "fast sync read" if fast else "sync read"
    bare = ("rustypot, bare read", median(theirs))
    return [Figure(f"{name}: capture, timing, decoding, publishing", median(ours), "µs", bare, 1.0)]


def _cycle(robot: _Robot, rate: int, *, quick: bool) -> list[Figure]:
    """From one cycle's beginning to the next one's, against the wire and against the servos."""
    figures: list[Figure] = []
    for name, build, fast in (("sync", sync_read, False), ("fast sync", fast_sync_read, True)):
        instruction = build(IDS, *_BLOCK)
        length = len(instruction) + expect(instruction).total_bytes
        wire_ms = length * 10 / rate * 1000
        bus = VirtualBus(robot.buses[f"poll{rate}"], seed=0)
        came = bus.exchange(0, instruction, 100_000_000)
        servos_ms = came[-1][0] / 1e6
        with robot.gateway(f"poll{rate}", fast_sync_read=fast) as gateway:
            gateway.cycles.clear()
            _wait(lambda g=gateway: g.running() and len(g.cycles) > (300 if quick else 2000))
            stamps = [cycle.stamp for cycle in gateway.cycles]
        period_ms = median(b - a for a, b in pairwise(stamps)) / 1e6
        label = f"{rate // 1_000_000} Mbit/s, {name} read"
        figures.append(Figure(label, period_ms, "ms", ("bytes on the wire", wire_ms), 1.1))
        figures.append(Figure(f"{label}, servos", period_ms, "ms", ("wire and servos", servos_ms)))
    return figures


def _proxy(robot: _Robot, exchanges: int) -> list[Figure]:
    """The same exchange on a bare port and through the proxy, in turn."""
    bare_bus, bus = robot.buses["bare"], robot.buses["proxied"]
    figures: list[Figure] = []
    with (
        robot.gateway("proxied", mode="proxy"),
        Port(bare_bus.port, bare_bus.baud_rate) as bare,
        Port(bus.proxy_port, bus.baud_rate) as proxied,
    ):
        for name, instruction in (
            ("ping", ping(3)),
            ("sync read of 20", sync_read(IDS, *_BLOCK)),
        ):
            took: tuple[list[float], list[float]] = ([], [])
            for _ in range(exchanges):
                for port, mine in zip((bare, proxied), took, strict=True):
                    mine.append(_exchange_ms(port, instruction))
                time.sleep(0.002)  # as control software pauses between its cycles
            added = median(took[1]) - median(took[0])
            tails = [quantiles(times, n=100)[98] for times in took]
            figures.append(Figure(f"{name}, added at the median", added, "ms", None, 0.3))
            figures.append(Figure(f"{name}, p99", tails[1], "ms", ("bare port", tails[0])))
    return figures


def _exchange_ms(port: Port, instruction: bytes) -> float:
    missing = expect(instruction).total_bytes
    begin = time.monotonic_ns()
    port.write(instruction)
    while missing > 0:
        if not port.wait(1000):
            raise RuntimeError("a servo of the virtual bus did not answer")
        missing -= len(port.read())
    return (time.monotonic_ns() - begin) / 1e6


@contextmanager
def _process(module: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", module, *arguments]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=quiet)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait(5)


def _wait(condition: Callable[[], bool]) -> None:
    limit = time.monotonic() + _LIMIT_S
    while not condition():
        if time.monotonic() > limit:
            raise RuntimeError("the benchmark's processes do not come up")
        select.select([], [], [], 0.01)


if __name__ == "__main__":
    from rich import print as show

    for shown in run(quick="--quick" in sys.argv):
        show(shown)
