"""How long after a physical event in the drive a whole live robot tells it, and its replay.

Gateway, virtual robot on three steered wheels, all services as processes, a pilot that drives a
path which never repeats at 100 Hz. There is a robot on each physics; they have their faults in
turn, but share the computer. Time runs from the moment at which the virtual robot has the fault, so
here the detection window counts: a wheel that jams first has to deviate, a steering that is stuck
shows only when it should move, and whether a torque is on is read once a second. It ends when a
program that reads ``health`` has the first message with a fault at that component; one that is
never told took for ever. The recordings of all this are then replayed: the verdicts must be those
of the live services, byte for byte.
"""

import math
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from subprocess import Popen

import msgspec
import numpy as np
from rich.table import Table

from tests.bench.fresh import version
from tests.bench.progress import steps
from tests.bench.result import Figure, table
from tests.robot import Robot, process, running
from wackel_cli import replay
from wackel_cli.wheeled_robot import WHEELS, three_wheels
from wackel_node.config import RecorderConfig, ServoConfig
from wackel_schemas import component
from wackel_schemas.fault_codes import FAULT_CODES
from wackel_schemas.virtual import Injection
from wackel_virtual.drivetrain import Physics

_PHYSICS: tuple[Physics, ...] = ("fast", "mujoco")
_LEARN_S = 45.0
"""The diagnoser learns from fault-free driving how good the calibration is, in about 40 s."""
_QUICK_LEARN_S = 30.0
_LIMIT_S = 10.0
_NAMED, _FREE, _FREE_MS = 99.5, 95.0, 2000.0
"""% of all faults to be named, and of wheels that roll freely, these in so many ms."""
_DRIVE_CODES = frozenset(
    code
    for code in FAULT_CODES
    if code.startswith(("wheel_", "steering_", "gyro_", "two_", "drive_"))
)
_FREE_WHEEL = "wheel_free"
_KINDS: tuple[tuple[str, str, float | None], ...] = (
    ("wheel_blocked", "drive", None),
    (_FREE_WHEEL, "drive", None),
    ("drive_sensor_stuck", "drive", None),
    ("steering_blocked", "steering", None),
    ("steering_offset", "steering", None),
    ("steering_sensor_stuck", "steering", None),
    ("steering_sensor_offset", "steering", None),
    ("gyro_offset", "gyro", 0.3),
    ("gyro_frozen", "gyro", None),
)
"""As the virtual robot calls it; the part that is to be named; its strength, absent: the
default."""


@dataclass
class _Told:
    """What became of the faults of a kind.

    Attributes:
        took_ms: From the event to health; infinite for those that were not named in time.
        elsewhere: Those at which another component was named first.
    """

    took_ms: list[float] = field(default_factory=list)
    elsewhere: int = 0


@dataclass
class _Live:
    """A robot, and what it has told.

    Attributes:
        robot: It.
        directory: Where its files are.
        told: By kind.
        false: Faults of the drive that were told before the first one.
    """

    robot: Robot
    directory: Path
    told: dict[str, _Told] = field(default_factory=lambda: {kind: _Told() for kind, *_ in _KINDS})
    false: int = 0


def run(*, quick: bool = False) -> list[Table]:
    """Injects and heals faults in turn, each time at another wheel."""
    rounds = 1 if quick else 4
    learn_s = _QUICK_LEARN_S if quick else _LEARN_S
    with tempfile.TemporaryDirectory() as name:
        with ExitStack() as stack:
            lives = {
                physics: stack.enter_context(_running(Path(name, physics), physics))
                for physics in _PHYSICS
            }
            for live in lives.values():
                live.robot.wait(live.robot.ready)
                stack.enter_context(_pilot(live.directory))
            for live in lives.values():  # while all of them drive
                live.robot.listen(learn_s / len(lives))
            for live in lives.values():
                live.robot.listen(1.0)
                live.false = _drive_faults(live.robot)
            for number in steps(range(rounds * len(_KINDS)), "drive"):
                for live in lives.values():
                    _measure(live, number)
        return [_table(physics, live, learn_s) for physics, live in lives.items()]


@contextmanager
def _running(directory: Path, physics: Physics) -> Iterator[_Live]:
    """A robot with all services."""
    directory.mkdir()
    servos = [ServoConfig(id=servo) for servo in range(1, 2 * len(WHEELS) + 1)]
    config = msgspec.structs.replace(
        three_wheels(f"{physics}bot", directory, servos, 12.0),
        recorder=RecorderConfig(directory=str(directory / "recordings")),
    )
    one = ("--physics", physics, "--seed", str(int(version(), 16)))
    virtual = ("wackel_cli", "virtual", *_config(directory), *one)
    with (
        running(config, directory, virtual=False) as robot,
        process(*virtual, log=directory / "virtual.log"),
    ):
        yield _Live(robot, directory)


def _pilot(directory: Path) -> AbstractContextManager[Popen[str]]:
    """Drives it."""
    pilot = ("wackel_cli", "pilot", *_config(directory), "--path", "random", "--speed", "0.4")
    return process(*pilot, log=directory / "pilot.log")


def _config(directory: Path) -> tuple[str, str]:
    return "--config", str(directory / "robot.toml")


def _drive_faults(robot: Robot) -> int:
    """How many faults of the drive health has told so far."""
    return sum(fault.occurrences for fault in robot.health.faults if fault.code in _DRIVE_CODES)


def _measure(live: _Live, number: int) -> None:
    """Waits until all is well, injects the fault of that number, measures, and heals it."""
    robot, (kind, part, value) = live.robot, _KINDS[number % len(_KINDS)]
    wheel = None if part == "gyro" else WHEELS[(number + number // len(_KINDS)) % len(WHEELS)]
    place = component.gyro("body") if wheel is None else f"wheel/{wheel}/{part}"
    robot.wait(robot.ready, 60.0)
    known = len(robot.heard)
    begin_ns = robot.disturb(Injection(kind=kind, wheel=wheel, value=value))
    named: list[tuple[int, str]] = []

    def told() -> bool:
        named[:] = [
            (at_ns, fault.component)
            for at_ns, health in robot.heard[known:]
            for fault in health.faults
            if fault.code in _DRIVE_CODES and fault.status in ("pending", "confirmed")
        ]
        return any(there == place for _, there in named)

    limit = time.monotonic() + _LIMIT_S
    robot.wait(lambda: told() or time.monotonic() > limit, 2 * _LIMIT_S)
    robot.heal()
    right_ns = next((at_ns for at_ns, there in named if there == place), math.inf)
    live.told[kind].took_ms.append((right_ns - begin_ns) / 1e6)
    live.told[kind].elsewhere += bool(named) and named[0][1] != place


def _table(physics: Physics, live: _Live, learn_s: float) -> Table:
    """Of one robot, which has ended; replays what it has recorded."""
    begin_s = time.process_time()
    with redirect_stdout(StringIO()):  # its exit code tells whether anything differs
        differs = replay.main(
            [*sorted(map(str, live.directory.glob("recordings/*.mcap"))), "--compare"]
        )
    replay_s = time.process_time() - begin_s
    every = [took for told in live.told.values() for took in told.took_ms]
    free = live.told[_FREE_WHEEL].took_ms
    figures = [
        figure
        for kind, told in live.told.items()
        for figure in (
            Figure(f"{kind}: p50", _quantile(told.took_ms, 0.5), "ms"),
            Figure("   worst", max(told.took_ms), "ms"),
            Figure("   another component named first", told.elsewhere, f"of {len(told.took_ms)}"),
        )
    ]
    return table(
        f"Drive, live, physics {physics}: from the physical event to health, {len(every)} faults",
        [
            *figures,
            Figure("all: p50", _quantile(every, 0.5), "ms"),
            Figure("all: p99", _quantile(every, 0.99), "ms"),
            Figure(
                f"all: named in {_LIMIT_S:g} s",
                _share(every, math.inf),
                "%",
                None,
                _NAMED,
                at_least=True,
            ),
            Figure(
                f"{_FREE_WHEEL}: named in {_FREE_MS / 1000:g} s",
                _share(free, _FREE_MS),
                "%",
                None,
                _FREE,
                at_least=True,
            ),
            Figure(f"false in {learn_s:g} s before the first", live.false, "", None, 0),
            Figure("replay of all this: differs from live", differs, "", None, 0),
            Figure("replay of all this: CPU", replay_s, "s"),
        ],
    )


def _quantile(took_ms: list[float], share: float) -> float:
    """One of them, the longer where it lies between two: some may be infinite."""
    return float(np.quantile(took_ms, share, method="higher"))


def _share(took_ms: list[float], below_ms: float) -> float:
    """%, of those that took less."""
    return 100 * float(np.mean(np.array(took_ms) < below_ms))
