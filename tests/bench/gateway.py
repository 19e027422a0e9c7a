"""CPU of the gateway for one read of 20 servos, against libraries that only read.

The gateway is the real process, polling a pseudo-terminal as fast as the wire allows; counted is
the CPU of all its threads (capture, timing, decoding, publishing to a Zenoh subscriber in another
process), less what it takes when it polls once a second (heartbeats, slow registers), divided by
its reads. The libraries read the same registers over a port of the same kind; counted is the CPU of
the thread that calls them. They take turns; while a library has its turn, the gateway is stopped
(SIGSTOP).
"""

import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import thread_time_ns

import rustypot
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, PacketHandler, PortHandler
from rich.table import Table

from tests.bench.buses import BLOCK, IDS, Buses
from tests.bench.progress import steps
from tests.bench.result import Figure, table

_BAUD_RATE = 1_000_000
_CALLS = 200  # of a library in a turn: a second of bus time
_MAY_FAIL = 0.05  # share of a library's reads; on a busy machine some time out


def run(*, quick: bool = False) -> Table:
    """Measures both kinds of read."""
    figures: list[Figure] = []
    rates = dict.fromkeys(("gateway", "rustypot", "vendor"), _BAUD_RATE)
    with tempfile.TemporaryDirectory() as directory, Buses(Path(directory), rates) as buses:
        for fast in (False, True):
            figures += _figures(buses, turns=3 if quick else 10, fast=fast)
    return table("Gateway: CPU for a transaction, 20 servos × 10 bytes", figures)


def _figures(buses: Buses, turns: int, *, fast: bool) -> list[Figure]:
    kind = "fast sync read" if fast else "sync read"
    peers = (
        _rustypot(buses.configs["rustypot"].port, fast=fast),
        _vendor(buses.configs["vendor"].port, fast=fast),
    )
    with buses.gateway("gateway", fast_sync_read=fast, rate=1.0) as gateway:
        idle = gateway.work(periods=3)
    idle_share = idle.cpu_ns / idle.took_ns
    ours: list[float] = []
    theirs: tuple[list[float], list[float]] = ([], [])
    with buses.gateway("gateway", fast_sync_read=fast) as gateway:
        for _ in steps(range(turns), kind):
            work = gateway.work(periods=2)
            ours.append((work.cpu_ns - idle_share * work.took_ns) / work.cycles / 1000)
            gateway.pause()
            for read, mine in zip(peers, theirs, strict=True):
                mine.append(_cpu_us(read))
            gateway.resume()
            gateway.work(periods=1)  # what it has to catch up with counts for nobody
    name = f"{kind}: captured, timed, decoded, published"
    bare, vendor = (median(mine) for mine in theirs)
    return [
        Figure(name, median(ours), "µs", ("rustypot, bare read", bare), 1.0),
        Figure(name, median(ours), "µs", ("dynamixel_sdk, bare read", vendor)),
        Figure(f"{kind}: gateway at one read a second", idle_share * 100, "% of a core"),
    ]


def _cpu_us(read: Callable[[], bool]) -> float:
    """CPU µs a read."""
    begin_ns = thread_time_ns()
    failed = sum(not read() for _ in range(_CALLS))
    if failed > _MAY_FAIL * _CALLS:
        raise RuntimeError(f"{failed} of {_CALLS} reads failed; the machine is too busy")
    return (thread_time_ns() - begin_ns) / _CALLS / 1000


def _rustypot(port: str, *, fast: bool) -> Callable[[], bool]:
    controller = rustypot.Xl430PyController(port, _BAUD_RATE, 0.1)
    controller.set_fast_sync_read(fast)

    def read() -> bool:
        try:
            return len(controller.sync_read_raw_data(list(IDS), *BLOCK)) == len(IDS)
        except RuntimeError:
            return False

    return read


def _vendor(port: str, *, fast: bool) -> Callable[[], bool]:
    handler = PortHandler(port)
    handler.setBaudRate(_BAUD_RATE)
    group = GroupSyncRead(handler, PacketHandler(2.0), *BLOCK)
    for servo_id in IDS:
        group.addParam(servo_id)
    exchange = group.fastSyncRead if fast else group.txRxPacket
    return lambda: bool(exchange() == COMM_SUCCESS)
