"""What mode proxy adds to the exchanges of the vendor's library, and whether it changes any.

The same library makes the same exchanges on a bare port and through the proxy, in turn; between
them it pauses, as control software does between its cycles. The library gives up after about 34 ms:
on a busy computer that alone lets exchanges fail, on either port, so these count apart from
results that are wrong.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median, quantiles

from dynamixel_sdk import COMM_RX_TIMEOUT, GroupSyncRead, PacketHandler, PortHandler
from rich.table import Table

from tests.bench.buses import IDS, Buses
from tests.bench.progress import steps
from tests.bench.result import Figure, table

_BAUD_RATE = 1_000_000
_VELOCITY_LIMIT = (44, 4)  # keeps what is written, so that both buses have to answer the same
_LED = 65
_PAUSE_S = 0.002


_Result = tuple[int, object]


@dataclass
class _Port:
    """An exchange on one port.

    Attributes:
        expected: The bare port's first result.
        took_ms: How long it took each time.
        timeouts: How often the library gave up.
        other: How often the result was yet another.
    """

    expected: _Result
    took_ms: list[float] = field(default_factory=list)
    timeouts: int = 0
    other: int = 0

    def make(self, exchange: Callable[[], _Result]) -> None:
        """Once, timed."""
        begin_ns = time.monotonic_ns()
        result = exchange()
        self.took_ms.append((time.monotonic_ns() - begin_ns) / 1e6)
        if result[0] == COMM_RX_TIMEOUT:
            self.timeouts += 1
        else:
            self.other += result != self.expected


@dataclass
class _Exchange:
    """One exchange on both ports.

    Attributes:
        name: Of the exchange.
        bare, proxied: The exchange; gives the library's result code and what the caller gets.
    """

    name: str
    bare: Callable[[], _Result]
    proxied: Callable[[], _Result]

    def __post_init__(self) -> None:
        expected = self.bare()
        self._bare, self._proxied = _Port(expected), _Port(expected)

    def make(self) -> None:
        """Once on each port."""
        self._bare.make(self.bare)
        time.sleep(_PAUSE_S)
        self._proxied.make(self.proxied)
        time.sleep(_PAUSE_S)

    def figures(self) -> list[Figure]:
        """Added at the median, the tails, and the differences."""
        count = f"of {len(self._bare.took_ms)}"
        ports = self._bare, self._proxied
        bare, proxied = (median(port.took_ms) for port in ports)
        bare_p99, proxied_p99 = (quantiles(port.took_ms, n=100)[98] for port in ports)
        return [
            Figure(f"{self.name}: added at the median", proxied - bare, "ms", None, 0.3),
            Figure(f"{self.name}: median", proxied, "ms", ("bare port", bare)),
            Figure(f"{self.name}: p99", proxied_p99, "ms", ("bare port", bare_p99)),
            Figure(f"{self.name}: time-outs", self._proxied.timeouts, count),
            Figure(f"{self.name}: time-outs, bare port", self._bare.timeouts, count),
            Figure(f"{self.name}: other results", self._proxied.other, count, None, 0),
            Figure(f"{self.name}: other results, bare port", self._bare.other, count),
        ]


def run(*, quick: bool = False) -> Table:
    """Measures a ping, a read, a write and a sync read of 20 servos."""
    rates = dict.fromkeys(("bare", "proxied"), _BAUD_RATE)
    with (
        tempfile.TemporaryDirectory() as directory,
        Buses(Path(directory), rates) as buses,
        buses.gateway("proxied", mode="proxy"),
    ):
        bare = _library(buses.configs["bare"].port)
        proxied = _library(buses.configs["proxied"].proxy_port)
        exchanges = [
            _Exchange(name, one, other)
            for (name, one), other in zip(bare.items(), proxied.values(), strict=True)
        ]
        for _ in steps(range(200 if quick else 1500), "exchanges"):
            for exchange in exchanges:
                exchange.make()
    figures = [figure for exchange in exchanges for figure in exchange.figures()]
    return table("Proxy: the vendor's library through it, 1 Mbit/s", figures)


def _library(path: str) -> dict[str, Callable[[], _Result]]:
    """The exchanges on one port."""
    port = PortHandler(path)
    port.setBaudRate(_BAUD_RATE)
    packets = PacketHandler(2.0)
    group = GroupSyncRead(port, packets, *_VELOCITY_LIMIT)
    for servo_id in IDS:
        group.addParam(servo_id)
        if packets.write4ByteTxRx(port, servo_id, _VELOCITY_LIMIT[0], 100 + servo_id)[0]:
            raise RuntimeError(f"servo {servo_id} cannot be written to through {path}")

    def ping() -> _Result:
        number, result, error = packets.ping(port, 3)
        return result, (number, error)

    def read() -> _Result:
        value, result, error = packets.read2ByteTxRx(port, 3, 0)
        return result, (value, error)

    def limits() -> _Result:
        result = group.txRxPacket()
        return result, [group.getData(servo_id, *_VELOCITY_LIMIT) for servo_id in IDS]

    return {
        "ping": ping,
        "read": read,
        "write": lambda: packets.write1ByteTxRx(port, 3, _LED, 1),
        "sync read of 20": limits,
    }
