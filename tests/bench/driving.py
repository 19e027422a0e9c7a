"""Diagnoser: faults by kind of driving, which decides what a fault looks like.

Each befalls a robot that has driven this way for half a minute; what its motion does not show
cannot be named, but must not be blamed on another part either.
"""

import multiprocessing
from dataclasses import dataclass
from random import Random

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench.diagnoser import KINDS, Outcome, befall, named_table
from tests.bench.fresh import version
from tests.diagnoser.driving import DRIVING
from tests.diagnoser.rig import WARM_UP_S, Rig
from wackel_virtual.build import Build
from wackel_virtual.drivetrain import Physics

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


def robot(job: Job) -> tuple[str, list[Outcome]]:
    """Drives one; returns how, and what became of the faults."""
    build = Build.drawn(Random(f"{job.seed}/build"))
    rig = Rig.of(job.seed, job.wheels, physics=job.physics, driving=job.driving, build=build)
    rig.drive(WARM_UP_S)
    return job.driving, [befall(rig.copy(), number, job.seed) for number in FAULTS]


def run(
    *,
    quick: bool = False,
    robots: int | None = None,
    seeds: str | None = None,
) -> Table:
    """All kinds in two processes.

    Args:
        quick: A few robots.
        robots: Of each number of wheels, physics and kind of driving.
        seeds: Beginning of those of the robots; else they are fresh.
    """
    count = robots if robots is not None else 1 if quick else ROBOTS
    seeds = seeds or version()
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
    by_driving: dict[str, list[Outcome]] = {driving: [] for driving in KINDS_OF_DRIVING}
    for driving, outcomes in found:
        by_driving[driving] += outcomes
    return named_table("Diagnoser: faults by kind of driving", by_driving, FAULTS)
