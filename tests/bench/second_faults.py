"""Diagnoser: a second fault ten seconds after a first that stays.

A robot is driven on with what is wrong with it. Of each first fault, of a wheel or the gyro, and
each second one, of another wheel or the gyro, it is asked whether both are named some seconds
later, and whether a third part is. Meanwhile the first alone drives on, too: every other part that
is then accused is a false alarm. A gyro that jumps beside a wheel cannot be told: one that drags
turns the robot by as much.
"""

import multiprocessing
from dataclasses import dataclass, field
from random import Random

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench.fresh import version
from tests.diagnoser.fleet import COMPLAINTS
from tests.diagnoser.rig import WARM_UP_S, Rig
from wackel_node.garbage import collect_rarely
from wackel_schemas import component
from wackel_virtual.build import Build

ROBOTS = 24
"""Of each number of wheels."""
FIRST_S, SECOND_S = 10.0, 4.0
SIZED = ("scale", "offset")
SIZES = 0.1, 0.3
"""Of those that have one: a share, rad, or rad/s; either way."""
OF_GYRO = ("gyro_offset", "gyro_frozen")
FAULTS = (
    "wheel_blocked",
    "drive_scale",
    "drive_sensor_stuck",
    "drive_sensor_scale",
    "steering_blocked",
    "steering_offset",
    "steering_sensor_stuck",
    "steering_sensor_offset",
    *OF_GYRO,
)


@dataclass
class Driven:
    """What became of a robot.

    Attributes:
        wheels: How many.
        both, third: Of each first and second fault, whether both were named, and another part.
        alarms: Parts beside the first fault that were accused without a second, one each.
    """

    wheels: int
    both: dict[tuple[str, str], bool] = field(default_factory=dict)
    third: dict[tuple[str, str], bool] = field(default_factory=dict)
    alarms: int = 0


def robot(job: tuple[int, str]) -> Driven:
    """Drives one: number of its wheels, and seed."""
    wheels, seed = job
    collect_rarely()
    build = Build.drawn(Random(f"{seed}/build"))
    sound = Rig.of(seed, wheels, build=build, shown=False)
    sound.drive(WARM_UP_S)
    driven = Driven(wheels)
    for first in FAULTS:
        rig, own = sound.copy(), _place(first, 0)
        random = Random(f"{seed}/{first}")
        _inject(rig, first, 0, random)
        rig.drive(FIRST_S)
        alone = rig.copy()
        alone.reports.clear()
        alone.drive(SECOND_S)
        accused = {
            each.component
            for each in (*alone.reports, *alone.diagnoser.active())
            if each.status == "active" and each.code not in COMPLAINTS
        }
        driven.alarms += len(accused - {own})
        for second in FAULTS:
            if {first, second} <= set(OF_GYRO):
                continue
            later, both = rig.copy(), {own, _place(second, 1)}
            _inject(later, second, 1, random)
            later.drive(SECOND_S)
            named = {path for code, path in later.active() if code not in COMPLAINTS}
            driven.both[first, second] = both <= named
            driven.third[first, second] = bool(named - both)
    return driven


def run(*, quick: bool = False, robots: int | None = None, seeds: str | None = None) -> list[Table]:
    """All robots in two processes.

    Args:
        quick: A few.
        robots: Of each number of wheels.
        seeds: Beginning of those of the robots; else they are fresh.
    """
    count = robots if robots is not None else 2 if quick else ROBOTS
    seeds = seeds or version()
    jobs = [(wheels, f"{seeds}/second/{wheels}/{i}") for i in range(count) for wheels in (3, 4)]
    with (
        multiprocessing.get_context("spawn").Pool(2) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        found = list(progress.track(pool.imap_unordered(robot, jobs), len(jobs)))
    return [_table([each for each in found if each.wheels == wheels], wheels) for wheels in (3, 4)]


def _table(robots: list[Driven], wheels: int) -> Table:
    shown = Table(
        title=f"Diagnoser: {wheels} steered wheels, {len(robots)} robots, a second fault "
        f"{FIRST_S:g} s after the first, both named % / a third part named %",
        title_justify="left",
    )
    shown.add_column("first")
    for second in FAULTS:
        shown.add_column(second.replace("_", " "), justify="right")
    for first in FAULTS:
        shown.add_row(first.replace("_", " "), *(_cell(robots, (first, s)) for s in FAULTS))
    minutes = len(robots) * len(FAULTS) * SECOND_S / 60
    alarms = sum(each.alarms for each in robots)
    shown.caption = f"other parts accused in {minutes:.0f} min with the first fault alone: {alarms}"
    return shown


def _cell(robots: list[Driven], faults: tuple[str, str]) -> str:
    both = [each.both[faults] for each in robots if faults in each.both]
    if not both:
        return ""
    third = [each.third[faults] for each in robots]
    return f"{100 * sum(both) / len(both):.0f} / {100 * sum(third) / len(third):.0f}"


def _place(fault: str, wheel: int) -> str:
    if fault in OF_GYRO:
        return component.gyro("body")
    of = component.wheel_steering if fault.startswith("steering") else component.wheel_drive
    return of(f"w{wheel}")


def _inject(rig: Rig, fault: str, wheel: int, random: Random) -> None:
    size = random.choice((-1, 1)) * random.uniform(*SIZES) if fault.endswith(SIZED) else None
    rig.inject(fault, None if fault in OF_GYRO else f"w{wheel}", size)
