"""What mode proxy adds to the exchanges of the vendor's library, and whether it changes any.

The same library makes the same exchanges on a bare port and through the proxy, in turn; between
them it pauses, as control software does between its cycles.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median, quantiles

from dynamixel_sdk import GroupSyncRead, PacketHandler, PortHandler
from rich.table import Table

from tests.bench.buses import IDS, Buses
from tests.bench.progress import steps
from tests.bench.result import Figure, table

_BAUD_RATE = 1_000_000
_VELOCITY_LIMIT = (44, 4)  # keeps what is written, so that both buses have to answer the same
_LED = 65
_PAUSE_S = 0.002


@dataclass
class _Exchange:
    """One exchange on both ports.

    Attributes:
        name: Of the exchange.
        bare, proxied: The exchange, as the library's caller gets its result.
        bare_ms, proxied_ms: How long it took.
        bare_other, proxied_other: How often the result was another than the bare port's first.
    """

    name: str
    bare: Callable[[], object]
    proxied: Callable[[], object]
    bare_ms: list[float] = field(default_factory=list)
    proxied_ms: list[float] = field(default_factory=list)
    bare_other: int = 0
    proxied_other: int = 0

    def __post_init__(self) -> None:
        self._expected = self.bare()

    def make(self) -> None:
        """Once on each port."""
        self.bare_other += _timed(self.bare, self.bare_ms) != self._expected
        time.sleep(_PAUSE_S)
        self.proxied_other += _timed(self.proxied, self.proxied_ms) != self._expected
        time.sleep(_PAUSE_S)

    def figures(self) -> list[Figure]:
        """Added at the median, the tails, and the differences."""
        count = f"of {len(self.bare_ms)}"
        bare, proxied = median(self.bare_ms), median(self.proxied_ms)
        bare_p99, proxied_p99 = (
            quantiles(took, n=100)[98] for took in (self.bare_ms, self.proxied_ms)
        )
        return [
            Figure(f"{self.name}: added at the median", proxied - bare, "ms", None, 0.3),
            Figure(f"{self.name}: median", proxied, "ms", ("bare port", bare)),
            Figure(f"{self.name}: p99", proxied_p99, "ms", ("bare port", bare_p99)),
            Figure(f"{self.name}: other results", self.proxied_other, count),
            Figure(f"{self.name}: other results, bare port", self.bare_other, count),
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


def _library(path: str) -> dict[str, Callable[[], object]]:
    """The exchanges on one port."""
    port = PortHandler(path)
    port.setBaudRate(_BAUD_RATE)
    packets = PacketHandler(2.0)
    group = GroupSyncRead(port, packets, *_VELOCITY_LIMIT)
    for servo_id in IDS:
        group.addParam(servo_id)
        if packets.write4ByteTxRx(port, servo_id, _VELOCITY_LIMIT[0], 100 + servo_id)[0]:
            raise RuntimeError(f"servo {servo_id} cannot be written to through {path}")

    def limits() -> object:
        result = group.txRxPacket()
        return result, [group.getData(servo_id, *_VELOCITY_LIMIT) for servo_id in IDS]

    return {
        "ping": lambda: packets.ping(port, 3),
        "read": lambda: packets.read2ByteTxRx(port, 3, 0),
        "write": lambda: packets.write1ByteTxRx(port, 3, _LED, 1),
        "sync read of 20": limits,
    }


def _timed(exchange: Callable[[], object], took_ms: list[float]) -> object:
    begin_ns = time.monotonic_ns()
    result = exchange()
    took_ms.append((time.monotonic_ns() - begin_ns) / 1e6)
    return result
