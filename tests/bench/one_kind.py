"""Diagnoser: one row of its table, by as many robots as it takes to tell a share from its aim.

Of a hundred robots whose fault is named in 96 of 100 cases, fewer than 95 are named in one set of
five. ``python -m tests.bench.one_kind "wheel off its motor" --robots 1000`` drives others than the
table does, equally new to the code (:mod:`tests.bench.fresh`).
"""

import argparse
import multiprocessing
import os
import sys
from functools import partial
from random import Random
from typing import get_args

from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from scipy.stats import binomtest

from tests.bench.alarms import prepare
from tests.bench.diagnoser import KINDS, ROBOTS, Outcome, befall, fault_columns, fault_row
from tests.bench.fresh import version
from tests.bench.result import console
from tests.diagnoser.rig import WARM_UP_S, Rig
from wackel_virtual.build import Build
from wackel_virtual.drivetrain import Physics

NUMBERS = {kind.name: number for number, kind in enumerate(KINDS)}


def run(name: str, robots: int, wheels: int, physics: Physics) -> Table:
    """Robots of one set; after Ctrl-C, those that are through.

    Args:
        name: Of the row.
        robots: How many.
        wheels: Of each.
        physics: That move it.
    """
    code = version()
    seeds = [f"{code}/{physics}/{wheels}/{i}" for i in range(ROBOTS, ROBOTS + robots)]
    outcomes: list[Outcome] = []
    with (
        multiprocessing.get_context("spawn").Pool(os.cpu_count(), prepare) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        one = partial(_robot, NUMBERS[name], wheels, physics)
        try:
            outcomes.extend(progress.track(pool.imap_unordered(one, seeds), robots))
        except KeyboardInterrupt:
            pool.terminate()
    return _table(name, outcomes, wheels, physics)


def _robot(number: int, wheels: int, physics: Physics, seed: str) -> Outcome:
    build = Build.drawn(Random(f"{seed}/build"))
    rig = Rig.of(seed, wheels, physics=physics, build=build)
    rig.drive(WARM_UP_S)
    return befall(rig, number, seed)


def _table(name: str, outcomes: list[Outcome], wheels: int, physics: Physics) -> Table:
    shown = fault_columns(f"Diagnoser: {wheels} steered wheels, {physics}, {len(outcomes)} robots")
    if outcomes:
        shown.add_row(*fault_row(KINDS[NUMBERS[name]], outcomes, wheels))
        named = binomtest(sum(each.named for each in outcomes), len(outcomes))
        low, high = named.proportion_ci(0.95)
        shown.caption = (
            f"of all such robots, {100 * low:.1f} to {100 * high:.1f} % would be named, with a "
            "probability of 95 %"
        )
    return shown


def main(argv: list[str]) -> int:
    """``python -m tests.bench.one_kind "wheel off its motor" --robots 1000``."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.one_kind", description=__doc__)
    parser.add_argument("kind", metavar="KIND", choices=NUMBERS, help="a row of the table")
    parser.add_argument("--robots", type=int, default=400, help="how many (%(default)d)")
    parser.add_argument("--wheels", type=int, default=3, choices=(3, 4), help="(%(default)d)")
    parser.add_argument(
        "--physics", default="fast", choices=get_args(Physics), help="(%(default)s)"
    )
    asked = parser.parse_args(argv)
    if asked.robots < 1:
        parser.error("--robots must be at least 1")
    console().print(run(asked.kind, asked.robots, asked.wheels, asked.physics))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
