"""How long after a physical event in the drive a whole live robot tells it, and its replay.

Gateway, virtual robot on three steered wheels, all services as processes, a pilot that drives an
eight at 100 Hz. Time runs from the moment at which the virtual robot has the fault, so here the
detection window counts: a wheel that jams first has to deviate. It ends when a program that reads
``health`` has the first message with a fault at that component. The recording of all this is then
replayed: its verdicts must be those of the live services, byte for byte.
"""

import tempfile
import time
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from statistics import median, quantiles

import msgspec
from rich.table import Table

from tests.bench.progress import steps
from tests.bench.result import Figure, table
from tests.robot import Robot, process, running
from wackel_cli import replay
from wackel_cli.wheeled_robot import WHEELS, three_wheels
from wackel_node.config import RecorderConfig, ServoConfig
from wackel_schemas import component
from wackel_schemas.fault_codes import FAULT_CODES
from wackel_schemas.virtual import Injection

_LEARN_S = 45.0
"""The diagnoser learns from fault-free driving how good the calibration is, in about 40 s."""
_LIMIT_S = 5.0
_DRIVE_CODES = frozenset(
    code for code in FAULT_CODES if code.startswith(("wheel_", "steering_", "gyro_dev", "two_"))
)


@dataclass
class _Kind:
    """A fault of the drive that shows by itself.

    Attributes:
        kind: As the virtual robot calls it.
        part: The component that is to be named, given a wheel.
        value: Its strength; absent: the default.
        took_ms: From the event to health, of those that were named.
        missed: Those that were not named within the limit.
        elsewhere: Those at which another component was named first.
    """

    kind: str
    part: str
    value: float | None = None
    took_ms: list[float] = field(default_factory=list)
    missed: int = 0
    elsewhere: int = 0

    def place(self, wheel: str) -> str:
        """The component that is to be named."""
        return component.gyro("body") if self.part == "gyro" else f"wheel/{wheel}/{self.part}"


def run(*, quick: bool = False) -> list[Table]:
    """Injects and heals faults in turn, on each wheel."""
    kinds = [
        _Kind("wheel_blocked", "drive"),
        _Kind("drive_sensor_stuck", "drive"),
        _Kind("steering_offset", "steering"),
        _Kind("steering_sensor_offset", "steering"),
        _Kind("gyro_offset", "gyro", 0.3),
    ]
    rounds = 2 if quick else 12
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        servos = [ServoConfig(id=servo) for servo in range(1, 2 * len(WHEELS) + 1)]
        config = msgspec.structs.replace(
            three_wheels("testbot", directory, servos, 12.0),
            recorder=RecorderConfig(directory=str(directory / "recordings")),
        )
        with running(config, directory) as robot:
            robot.wait(robot.ready)
            pilot = ("wackel_cli", "pilot", "--config", str(directory / "robot.toml"))
            with process(*pilot, "--path", "eight", log=directory / "pilot.log"):
                robot.listen(_LEARN_S)
                false = _drive_faults(robot)
                for number in steps(range(rounds), "drive"):
                    for kind in kinds:
                        _measure(robot, kind, WHEELS[number % len(WHEELS)])
        files = sorted(map(str, (directory / "recordings").glob("*.mcap")))
        begin_s = time.process_time()
        with redirect_stdout(StringIO()):  # its exit code tells whether anything differs
            differs = replay.main([*files, "--compare"])
        replay_s = time.process_time() - begin_s
    every = [took for kind in kinds for took in kind.took_ms]
    named = [
        figure
        for kind in kinds
        for figure in (
            Figure(f"{kind.kind}: p50", median(kind.took_ms or [float("nan")]), "ms"),
            Figure(f"{kind.kind}: worst", max(kind.took_ms, default=float("nan")), "ms"),
            Figure(f"{kind.kind}: another component named first", kind.elsewhere, f"of {rounds}"),
            Figure(f"{kind.kind}: not named in {_LIMIT_S:g} s", kind.missed, f"of {rounds}"),
        )
    ]
    tails = quantiles(every, n=100, method="inclusive") if len(every) > 1 else [float("nan")] * 99
    return [
        table(
            f"Drive, live: from the physical event to health, {len(every)} faults",
            [
                *named,
                Figure("all: p50", tails[49], "ms"),
                Figure("all: p99", tails[98], "ms"),
                Figure(f"false in {_LEARN_S:g} s before the first", false, ""),
                Figure("replay of all this: differs from live", differs, "", None, 0),
                Figure("replay of all this: CPU", replay_s, "s"),
            ],
        )
    ]


def _drive_faults(robot: Robot) -> int:
    """How many faults of the drive health has told so far."""
    return sum(fault.occurrences for fault in robot.health.faults if fault.code in _DRIVE_CODES)


def _measure(robot: Robot, kind: _Kind, wheel: str) -> None:
    """Injects a fault, measures, heals it and waits until all is well."""
    place = kind.place(wheel)
    at_wheel = None if kind.part == "gyro" else wheel
    known = len(robot.heard)
    begin_ns = robot.disturb(Injection(kind=kind.kind, wheel=at_wheel, value=kind.value))
    named: list[tuple[int, str]] = []

    def told() -> bool:
        for at_ns, health in robot.heard[known:]:
            named.extend(
                (at_ns, fault.component)
                for fault in health.faults
                if fault.code in _DRIVE_CODES and fault.status in ("pending", "confirmed")
            )
            if any(there == place for _, there in named):
                return True
        return False

    limit = time.monotonic() + _LIMIT_S
    robot.wait(lambda: told() or time.monotonic() > limit)
    right = [at_ns for at_ns, there in named if there == place]
    if right:
        kind.took_ms.append((right[0] - begin_ns) / 1e6)
    else:
        kind.missed += 1
    kind.elsewhere += bool(named) and named[0][1] != place
    robot.heal()
    robot.wait(robot.ready, 60.0)
