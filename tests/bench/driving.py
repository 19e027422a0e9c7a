"""Diagnoser: faults by kind of driving, which decides what a fault looks like.

Each befalls a robot that has driven this way for half a minute; what its motion does not show
cannot be named, but must not be blamed on another part either.
"""

import multiprocessing
from dataclasses import dataclass

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench.diagnoser import KINDS, Physics, befall
from tests.diagnoser.driving import DRIVING
from tests.diagnoser.rig import WARM_UP_S, Rig

ROBOTS = 20
"""Of each number of wheels, physics and kind of driving."""
FAULTS = [number for number, kind in enumerate(KINDS) if kind.named and kind.lasts_s <= 5.0]
"""That show within seconds."""
KINDS_OF_DRIVING = ("random", *DRIVING)


@dataclass(frozen=True)
class Job:
    """A robot.

    Attributes:
        wheels: How many.
    """

    wheels: int
    physics: Physics
    driving: str
    seed: str


@dataclass(frozen=True)
class Found:
    """What became of it.

    Attributes:
        named, wrong: By fault: whether it, and whether another part, was named at the end.
    """

    job: Job
    named: dict[int, bool]
    wrong: dict[int, bool]


def robot(job: Job) -> Found:
    """Drives it."""
    rig = Rig.of(job.seed, job.wheels, physics=job.physics, driving=job.driving)
    rig.drive(WARM_UP_S)
    outcomes = [befall(rig.copy(), number, job.seed) for number in FAULTS]
    return Found(
        job,
        {outcome.kind: outcome.named for outcome in outcomes},
        {outcome.kind: outcome.wrong for outcome in outcomes},
    )


def run(
    *,
    quick: bool = False,
    robots: int | None = None,
    seeds: str = "judge",
) -> Table:
    """All kinds in two processes.

    Args:
        quick: A few robots.
        robots: Of each number of wheels, physics and kind of driving.
        seeds: ``judge`` or ``tune``.
    """
    count = robots if robots is not None else 1 if quick else ROBOTS
    physics: tuple[Physics, ...] = ("fast", "mujoco")
    jobs = [
        Job(wheels, way, driving, f"{seeds}/{way}/{wheels}/{driving}/{i}")
        for driving in KINDS_OF_DRIVING
        for way in physics
        for wheels in (3, 4)
        for i in range(count)
    ]
    with (
        multiprocessing.get_context("spawn").Pool(2) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        found = list(progress.track(pool.imap_unordered(robot, jobs), len(jobs)))
    return _faults_table(found)


def _faults_table(found: list[Found]) -> Table:
    shown = Table(
        title="Diagnoser: faults by kind of driving, named % / another part named %",
        title_justify="left",
    )
    shown.add_column("fault")
    for driving in KINDS_OF_DRIVING:
        shown.add_column(driving, justify="right")
    for number in FAULTS:
        cells = []
        for driving in KINDS_OF_DRIVING:
            mine = [each for each in found if each.job.driving == driving]
            named = 100 * sum(each.named[number] for each in mine) / len(mine)
            wrong = 100 * sum(each.wrong[number] for each in mine) / len(mine)
            cells.append(f"{named:.0f} / {wrong:.0f}")
        shown.add_row(KINDS[number].name, *cells)
    return shown
