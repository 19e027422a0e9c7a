"""Diagnoser: drives that are not all of steered wheels, and robots whose commands nobody publishes.

What a drive cannot tell shows here, too: of a tricycle, whose only motor nothing is held against,
and of two wheels and a gyro, of which any explains what another does. Each robot drives for a
minute and a half without a fault, in any way of :mod:`tests.diagnoser.driving`; every report is a
false alarm. Then a fault befalls copies of it on random paths.
"""

import multiprocessing
from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench.diagnoser import (
    KINDS,
    Outcome,
    befall,
    having,
    named_table,
)
from tests.bench.fresh import version
from tests.diagnoser.driving import DRIVING
from tests.diagnoser.fleet import COMPLAINTS
from tests.diagnoser.rig import WARM_UP_S, Rig
from tests.odometry.simulation import differential_drive, other_drives, steered_drive
from wackel_node.garbage import collect_rarely
from wackel_schemas.message import Message
from wackel_virtual.build import Build
from wackel_virtual.drive_simulation import Cycle

ROBOTS = 40
"""Of each drive."""
HEALTHY_S = 90.0
FAULTS = [
    number
    for number, kind in enumerate(KINDS)
    if kind.named and kind.lasts_s <= 5.0 and len(kind.faults) == 1
]
"""That show within seconds."""
UNTOLD = "steered, untold"
"""Robots whose commands are not published."""
DRIVES = {"differential": differential_drive(), **other_drives(), UNTOLD: steered_drive(4)}


class Untold(Rig):
    """A robot whose control publishes no command."""

    def feed(self, cycle: Cycle) -> Iterator[Message]:
        """As of any other."""
        yield from self.diagnoser.imu(self.simulation.gyro, cycle.imu)
        yield from self.diagnoser.bus_state(self.simulation.bus, cycle.state)


@dataclass(frozen=True)
class Driven:
    """What became of a robot.

    Attributes:
        drive: Its name.
        alarms: For each report without a fault, the way it drove.
        outcomes: Of the faults.
    """

    drive: str
    alarms: list[str]
    outcomes: list[Outcome]


def robot(job: tuple[str, str]) -> Driven:
    """Drives one: name of its drive, and seed."""
    name, seed = job
    collect_rarely()
    random = Random(seed)
    build, driving = Build.drawn(random), random.choice(("random", *DRIVING))
    kind = Untold if name == UNTOLD else Rig
    healthy = kind.of(seed, DRIVES[name], build=build, driving=driving, shown=False)
    healthy.drive(HEALTHY_S)
    rig = kind.of(seed, DRIVES[name], build=build)
    rig.drive(WARM_UP_S)
    alarms = [
        way
        for way, each in ((driving, healthy), ("random", rig))
        for report in each.reports
        if report.status == "active" and report.code not in COMPLAINTS
    ]
    faults = [number for number in FAULTS if having(rig.config, KINDS[number])]
    outcomes = [befall(rig.copy(), number, seed) for number in faults]
    return Driven(name, alarms, outcomes)


def run(*, quick: bool = False, robots: int | None = None, seeds: str | None = None) -> Table:
    """All drives in two processes.

    Args:
        quick: A few robots.
        robots: Of each drive.
        seeds: Beginning of those of the robots; else they are fresh.
    """
    count = robots if robots is not None else 2 if quick else ROBOTS
    seeds = seeds or version()
    jobs = [(name, f"{seeds}/other/{name}/{i}") for name in DRIVES for i in range(count)]
    with (
        multiprocessing.get_context("spawn").Pool(2) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        found = list(progress.track(pool.imap_unordered(robot, jobs), len(jobs)))
    outcomes: dict[str, list[Outcome]] = {name: [] for name in DRIVES}
    alarms: dict[str, list[str]] = {name: [] for name in DRIVES}
    for each in found:
        outcomes[each.drive] += each.outcomes
        alarms[each.drive] += each.alarms
    hours = count * (HEALTHY_S + WARM_UP_S) / 3600
    said = ", ".join(
        f"{name} {len(ways)}" + f" ({', '.join(sorted(ways))})" * bool(ways)
        for name, ways in alarms.items()
    )
    shown = named_table(f"Diagnoser: other drives, {count} robots each", outcomes, FAULTS)
    shown.caption = f"false alarms in {hours:.2f} h each: {said}"
    return shown
