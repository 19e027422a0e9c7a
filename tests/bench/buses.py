"""Virtual buses of 20 servos on real pseudo-terminals, and gateway processes that own them.

All processes are real: virtual buses, rendezvous with a subscriber of everything, gateway.
"""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import msgspec

from tests.bench.processes import cpu_ns
from tests.conftest import free_port, wait_until
from tests.robot import process, write
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, ZenohConfig
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.bus import BusStatistics, Transaction

IDS = tuple(range(1, 21))
BLOCK = (126, 10)
"""Address and length of current, velocity, position of series X: what every cycle reads."""
UNLIMITED = 2000.0
"""Hz; more than any of the wires allows, so that a cycle follows at once on the last."""


class Buses:
    """Virtual buses in one process, and a rendezvous with a reader; use with ``with``.

    Attributes:
        configs: Of the buses, by name.
    """

    def __init__(self, directory: Path, rates: dict[str, int]) -> None:
        """Starts nothing yet.

        Args:
            directory: For ports and configurations.
            rates: Baud rate of each bus.
        """
        self.configs = {
            name: BusConfig(
                port=str(directory / name),
                proxy_port=str(directory / f"{name}-proxy"),
                baud_rate=baud_rate,
                rate=UNLIMITED,
                return_delay_us=0,
                servos=[ServoConfig(id=servo_id) for servo_id in IDS],
            )
            for name, baud_rate in rates.items()
        }
        self._directory = directory
        self._log = directory / "log"
        self._robot = RobotConfig(
            robot="bench",
            buses=self.configs,
            zenoh=ZenohConfig(endpoint=f"tcp/127.0.0.1:{free_port()}"),
        )
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            path = str(write(self._robot, self._directory, "all"))
            stack.enter_context(
                process("wackel_virtual", "--config", path, "--no-zenoh", log=self._log)
            )
            listener = stack.enter_context(process("tests.bench.listener", path, log=self._log))
            assert listener.stdout is not None
            listener.stdout.readline()
            wait_until(lambda: all(Path(bus.port).exists() for bus in self.configs.values()))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @contextmanager
    def gateway(self, name: str, **changes: object) -> Iterator["Gateway"]:
        """A gateway process for a bus, once it has all servos; ``changes`` to the bus's section."""
        bus = msgspec.structs.replace(self.configs[name], **changes)
        config = msgspec.structs.replace(self._robot, buses={name: bus})
        path = write(config, self._directory, f"gateway-{name}")
        with (
            process("wackel_gateway", "--config", str(path), log=self._log) as started,
            Link(config) as link,
        ):
            gateway = Gateway(link, name, started.pid)
            gateway.wait(lambda: gateway.connected and (bus.mode != "poll" or gateway.reads))
            try:
                yield gateway
            finally:
                gateway.resume()


@dataclass(frozen=True)
class Work:
    """What a gateway did in a while.

    Attributes:
        cycles: Reads of all servos.
        cpu_ns: CPU time of all its threads.
        took_ns: How long the while was.
    """

    cycles: float
    cpu_ns: int
    took_ns: int


class Gateway:
    """A running gateway, seen from outside: by its statistics, which cost it next to nothing."""

    def __init__(self, link: Link, bus: str, pid: int) -> None:
        self._link = link
        self._bus = bus
        self._pid = pid
        self._latest: BusStatistics | None = None
        link.subscribe(keys.STATISTICS, self._on_statistics, bus=bus)

    def _on_statistics(self, _: str, message: BusStatistics) -> None:
        self._latest = message

    @property
    def connected(self) -> bool:
        """Whether it has said that its port is open."""
        return self._latest is not None and self._latest.connected

    @property
    def reads(self) -> bool:
        """Whether it has said that it reads all servos, cycle by cycle."""
        return self._latest is not None and self._latest.cycle_rate > 0.0

    def cycles(self, count: int) -> list[Transaction]:
        """Its next reads of all servos; it has one more reader to feed from now on."""
        cycles: list[Transaction] = []

        def on_transaction(_: str, message: Transaction) -> None:
            if len(message.expected) == len(IDS):
                cycles.append(message)

        self._link.subscribe(keys.TRANSACTION, on_transaction, bus=self._bus)
        self.wait(lambda: len(cycles) >= count)
        return cycles

    def wait(self, condition: Callable[[], bool], limit_s: float = 20.0) -> None:
        """Listens to it until a condition holds.

        Raises:
            AssertionError: It did not come true within the limit.
        """
        wait_until(condition, limit_s, lambda: self._link.pump(0.05))

    def pause(self) -> None:
        """It stands still, for others to be measured."""
        os.kill(self._pid, signal.SIGSTOP)

    def resume(self) -> None:
        """It goes on."""
        os.kill(self._pid, signal.SIGCONT)

    def work(self, periods: int) -> Work:
        """What it does in so many periods of its statistics, 1 s each."""
        begin = self._next()
        cpu_begin_ns = cpu_ns(self._pid)
        last, cycles = begin, 0.0
        for _ in range(periods):
            latest = self._next()
            cycles += latest.cycle_rate * (latest.stamp - last.stamp) / 1e9
            last = latest
        return Work(cycles, cpu_ns(self._pid) - cpu_begin_ns, last.stamp - begin.stamp)

    def _next(self) -> BusStatistics:
        self._latest = None
        self.wait(lambda: self._latest is not None)
        assert self._latest is not None
        return self._latest
