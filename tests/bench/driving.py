"""Diagnoser: false alarms and faults by kind of driving, which decides what a fault looks like.

False alarms: robots as well calibrated as configured, and three times worse. Faults: each befalls a
robot that has driven this way for half a minute; what its motion does not show cannot be named, but
must not be blamed on another part either.
"""

import multiprocessing
from dataclasses import dataclass

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench.diagnoser import COMPLAINTS, KINDS, Physics, befall
from tests.diagnoser.driving import DRIVING
from tests.diagnoser.rig import WARM_UP_S, Rig

ROBOTS = 20
"""Of each number of wheels, physics and kind of driving."""
HEALTHY_S = 600.0
FAULTS = [number for number, kind in enumerate(KINDS) if kind.named and kind.lasts_s <= 5.0]
"""That show within seconds."""
KINDS_OF_DRIVING = ("random", *DRIVING)


@dataclass(frozen=True)
class Job:
    """A robot.

    Attributes:
        wheels: How many.
        worse: By how much its calibration is worse than configured.
        seconds: Without a fault; 0: half a minute, and then each fault.
    """

    wheels: int
    physics: Physics
    driving: str
    seed: str
    worse: float = 1.0
    seconds: float = 0.0


@dataclass(frozen=True)
class Found:
    """What became of it.

    Attributes:
        alarms: Reports without a fault.
        named, wrong: By fault: whether it, and whether another part, was named at the end.
    """

    job: Job
    alarms: list[str]
    named: dict[int, bool]
    wrong: dict[int, bool]


def robot(job: Job) -> Found:
    """Drives it."""
    rig = Rig.of(job.seed, job.wheels, physics=job.physics, worse=job.worse, driving=job.driving)
    rig.drive(job.seconds or WARM_UP_S)
    alarms = [
        f"{report.code} {report.component}"
        for report in rig.reports
        if report.status == "active" and report.code not in COMPLAINTS
    ]
    if job.seconds:
        return Found(job, alarms, {}, {})
    outcomes = [befall(rig.copy(), number, job.seed) for number in FAULTS]
    return Found(
        job,
        alarms,
        {outcome.kind: outcome.named for outcome in outcomes},
        {outcome.kind: outcome.wrong for outcome in outcomes},
    )


def run(
    *,
    quick: bool = False,
    robots: int | None = None,
    healthy_s: float | None = None,
    seeds: str = "judge",
) -> list[Table]:
    """All kinds in two processes.

    Args:
        quick: A few robots.
        robots: Of each number of wheels, physics and kind of driving.
        healthy_s: Of each robot without a fault.
        seeds: ``judge`` or ``tune``.
    """
    count = robots if robots is not None else 1 if quick else ROBOTS
    seconds = healthy_s if healthy_s is not None else 60.0 if quick else HEALTHY_S
    physics: tuple[Physics, ...] = ("fast", "mujoco")
    jobs = [
        Job(wheels, way, driving, f"{seeds}/{way}/{wheels}/{driving}/{i}", worse, healthy)
        for driving in KINDS_OF_DRIVING
        for way in physics
        for wheels in (3, 4)
        for worse, healthy in ((1.0, seconds), (3.0, seconds), (1.0, 0.0))
        for i in range(count)
    ]
    with (
        multiprocessing.get_context("spawn").Pool(2) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        found = list(progress.track(pool.imap_unordered(robot, jobs), len(jobs)))
    return [_alarms_table(found), _faults_table(found)]


def _alarms_table(found: list[Found]) -> Table:
    shown = Table(title="Diagnoser: false alarms by kind of driving", title_justify="left")
    for heading in ("driving", "calibration", "physics", "h", "reports", "per h", "which"):
        shown.add_column(heading, justify="right" if heading in ("h", "reports", "per h") else None)
    for driving in KINDS_OF_DRIVING:
        for worse in (1.0, 3.0):
            for physics in ("fast", "mujoco"):
                mine = [
                    each
                    for each in found
                    if (each.job.driving, each.job.worse, each.job.physics)
                    == (driving, worse, physics)
                ]
                hours = sum(each.job.seconds or WARM_UP_S for each in mine) / 3600
                alarms = [alarm for each in mine for alarm in each.alarms]
                shown.add_row(
                    driving,
                    "as configured" if worse == 1.0 else "three times worse",
                    physics,
                    f"{hours:.2f}",
                    str(len(alarms)),
                    f"{len(alarms) / hours:.2f}" if hours else "",
                    ", ".join(sorted(set(alarms))),
                )
    return shown


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
            mine = [each for each in found if each.job.driving == driving and each.named]
            named = 100 * sum(each.named[number] for each in mine) / len(mine)
            wrong = 100 * sum(each.wrong[number] for each in mine) / len(mine)
            cells.append(f"{named:.0f} / {wrong:.0f}")
        shown.add_row(KINDS[number].name, *cells)
    return shown
