"""How much of the bus's time its bytes use when the gateway polls as fast as it can.

A cycle lasts longer than its bytes for three reasons, which are told apart: the servos think before
they answer (wire and servos, in simulated time); the pseudo-terminal and its reader wake up late (a
bare exchange that waits for its bytes and does nothing else, on the same terminal); and the gateway
itself: what its schedule inserts between cycles (in simulated time, with a host that takes no time)
and what it computes between the last byte of one cycle and the first of the next.
"""

import tempfile
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import monotonic_ns

import msgspec
from rich.table import Table

from tests.bench.buses import BLOCK, IDS, Buses
from tests.bench.progress import steps
from tests.bench.result import Figure, table
from tests.gateway.simulation import Simulation
from wackel_gateway.port import Port
from wackel_gateway.schedule import Stage
from wackel_node.config import BusConfig
from wackel_protocols.dynamixel2 import fast_sync_read, sync_read
from wackel_protocols.dynamixel2.expectation import expect
from wackel_schemas.bus import Transaction
from wackel_virtual.bus import VirtualBus

_BAUD_RATES = (1_000_000, 3_000_000, 4_000_000)
_SIMULATED_S = 10.0
_WARM_UP_S = 2.0
_KINDS = (("sync read", sync_read, False), ("fast sync read", fast_sync_read, True))


def run(*, quick: bool = False) -> list[Table]:
    """Measures every baud rate with both kinds of read."""
    cycles = 300 if quick else 2000
    rates = {f"bus-{rate // 1_000_000}": rate for rate in _BAUD_RATES}
    simulated: list[Figure] = []
    live: list[Figure] = []
    with tempfile.TemporaryDirectory() as directory, Buses(Path(directory), rates) as buses:
        for name, baud_rate in steps(list(rates.items()), "baud rates"):
            config = buses.configs[name]
            for kind, build, fast in _KINDS:
                instruction = build(IDS, *BLOCK)
                missing = expect(instruction).total_bytes
                wire_ms = (len(instruction) + missing) * 10 / baud_rate * 1000
                servos_ms = _servos_ms(config, instruction)
                bytes_ = ("bytes on the wire", wire_ms)
                label = f"{baud_rate // 1_000_000} Mbit/s, {kind}"
                mean_ms = _schedule_ms(config, fast=fast)
                simulated += [
                    Figure(label, mean_ms, "ms", bytes_, 1.1),
                    Figure(label, mean_ms, "ms", ("wire and servos", servos_ms)),
                ]
                bare_ms = _bare_ms(config, instruction, cycles)
                with buses.gateway(name, fast_sync_read=fast) as gateway:
                    period_ms = _period_ms(gateway.cycles(cycles))
                live += [
                    Figure(label, period_ms, "ms", bytes_, 1.1),
                    Figure(label, period_ms, "ms", ("wire and servos", servos_ms)),
                    Figure(label, period_ms, "ms", ("bare exchange", bare_ms)),
                ]
    return [
        table("Bus use: mean cycle of the schedule in simulated time, 20 × 10 bytes", simulated),
        table("Bus use: median cycle of the gateway on a pseudo-terminal, 20 × 10 bytes", live),
    ]


def _servos_ms(config: BusConfig, instruction: bytes) -> float:
    """When the last byte of the answer has come, in simulated time."""
    came = VirtualBus(config).exchange(0, instruction, 100_000_000)
    return came[-1][0] / 1e6


def _schedule_ms(config: BusConfig, *, fast: bool) -> float:
    """Mean from cycle to cycle, background reads and all, with a host that takes no time."""
    config = msgspec.structs.replace(config, fast_sync_read=fast)
    simulation = Simulation(config, VirtualBus(config), host_ns=0)
    for _ in simulation.run(_WARM_UP_S):
        pass  # servos join, and the schedule learns what its jobs cost
    work = simulation.run(_SIMULATED_S)
    begun = [outcome.begin_ns for job, outcome in work if job.stage is Stage.CYCLE]
    return (begun[-1] - begun[0]) / (len(begun) - 1) / 1e6


def _bare_ms(config: BusConfig, instruction: bytes, exchanges: int) -> float:
    """Median of an exchange that waits for its bytes and does nothing else."""
    took: list[float] = []
    with Port(config.port, config.baud_rate) as port:
        for _ in range(exchanges):
            missing = expect(instruction).total_bytes
            begin_ns = monotonic_ns()
            port.write(instruction)
            while missing > 0:
                if not port.wait(1000):
                    raise RuntimeError("a servo of the virtual bus did not answer")
                missing -= len(port.read())
            took.append((monotonic_ns() - begin_ns) / 1e6)
    return median(took)


def _period_ms(cycles: Iterable[Transaction]) -> float:
    """Median from cycle to cycle."""
    return median((b.stamp - a.stamp) / 1e6 for a, b in pairwise(cycles))
