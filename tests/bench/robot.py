"""What a whole robot costs its computer: 20 servos at 200 Hz, 4 wheels, all of ``wackel up``.

The virtual bus, which stands for the servos, is not counted; ``up`` itself, which holds the
rendezvous, is. One core of CPU is 100 %; memory is the proportional set size.

Most of the CPU goes into waking threads with cold caches, which differs between computers by more
than wackel's own work does. So beside it stands a thread that wakes at the same rate and does
nothing: each cycle wakes some twenty.
"""

import math
import tempfile
import time
from pathlib import Path
from statistics import median

import msgspec
from rich.table import Table

from tests.bench.processes import cpu_ns, pss_bytes
from tests.bench.result import Figure, table
from tests.robot import chain, running
from wackel_node.config import RobotConfig
from wackel_node.config_drive import DriveConfig, WheelConfig
from wackel_schemas import keys

SERVOS = 20
RATE_HZ = 200.0
WHEELS = 4
BEYOND_WHEELS = range(2 * WHEELS + 1, SERVOS)
"""Servos that neither drive nor steer, without the last of the chain."""
_SETTLE_S = 3.0


def config(directory: Path) -> RobotConfig:
    """The robot of the budgets; 3 Mbit/s, since 1 Mbit/s does not carry its plain sync reads."""
    settings = {"rate": RATE_HZ, "baud_rate": 3_000_000, "return_delay_us": 0}
    wheels = [
        WheelConfig(
            name=f"w{number}",
            l=0.3,
            alpha=math.pi / WHEELS * (2 * number - 1),
            radius=0.05,
            bus="main",
            drive=number,
            steering=WHEELS + number,
        )
        for number in range(1, WHEELS + 1)
    ]
    drive = DriveConfig(kind="steered", wheels=wheels)
    return msgspec.structs.replace(chain(directory, SERVOS, **settings), drive=drive)


def run(*, quick: bool = False) -> Table:
    """Measures a healthy robot."""
    seconds = 5.0 if quick else 30.0
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        with running(config(directory), directory) as robot:
            robot.wait(robot.ready)
            robot.listen(_SETTLE_S)
            rates: list[float] = []
            robot.link.subscribe(keys.STATISTICS, lambda _, told: rates.append(told.cycle_rate))
            pids = {"up": robot.up.pid, **robot.pids()}
            del pids["virtual/main"]
            begin = {name: cpu_ns(pid) for name, pid in pids.items()}
            begin_s = time.monotonic()
            robot.listen(seconds)
            took_ns = (time.monotonic() - begin_s) * 1e9
            shares = {n: 100 * (cpu_ns(pid) - begin[n]) / took_ns for n, pid in pids.items()}
            memory = {name: pss_bytes(pid) / 2**20 for name, pid in pids.items()}
            bare = _bare_share(seconds)
    rate_hz = median(rates)
    return table(
        f"Whole robot: {SERVOS} servos, {WHEELS} wheels, {rate_hz:.0f} cycles/s, {seconds:g} s",
        [
            *(Figure(f"CPU: {name}", share, "% of a core") for name, share in shares.items()),
            Figure("CPU: all", sum(shares.values()), "% of a core", None, 25.0),
            Figure("CPU: a thread that only wakes at this rate", bare, "% of a core"),
            *(Figure(f"memory: {name}", mebi, "MiB") for name, mebi in memory.items()),
            Figure("memory: all", sum(memory.values()), "MiB", None, 350.0),
        ],
    )


def _bare_share(seconds: float) -> float:
    """CPU of waking up at the robot's rate, % of a core."""
    begin_s, begin_ns = time.monotonic(), time.thread_time_ns()
    for number in range(round(seconds * RATE_HZ)):
        time.sleep(max(0.0, begin_s + (number + 1) / RATE_HZ - time.monotonic()))
    return (time.thread_time_ns() - begin_ns) / (time.monotonic() - begin_s) / 1e7
