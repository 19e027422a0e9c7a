"""Diagnoser: false alarms of robots that drive without a fault. Goes on where the last run stopped.

Seldom as they shall be, they take hundreds of hours to count, at some thirty times real time on
each processor: ``make alarms HOURS=300`` drives on until all runs of the same code together have so
many. ``alarms.json`` says which robots have driven, to be committed with that code. They are those
of :mod:`tests.diagnoser.fleet`; of the ones that are three times worse calibrated than configured a
tenth of the hours is enough. Each version of the code has a fleet of its own: what reports of one
led to is judged by robots that nobody has seen.
"""

import argparse
import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from scipy.special import gammaincinv

from tests.bench.fresh import version
from tests.bench.result import console
from tests.diagnoser.fleet import ROBOT_S, Member
from wackel_node.garbage import collect_rarely

AIMS = {1.0: 0.01, 3.0: 0.1}
"""Reports an hour, by how many times worse than configured the calibration is."""
TELLING = 3.0
"""Reports to be expected at the aimed rate, in hours that tell: none of them is then as likely as
one in twenty."""
HOURS, QUICK_HOURS = 6.0, 0.2
KEPT = Path(__file__).with_name("alarms.json")


@dataclass(frozen=True)
class Driven:
    """What became of one.

    Attributes:
        number: Of the robot in its fleet.
        member: The robot.
        alarms: As :meth:`Member.drive` tells them.
    """

    number: int
    member: Member
    alarms: list[str]


def robot(job: tuple[str, int]) -> Driven:
    """Drives one, of a fleet and with a number."""
    member = Member.of(*job)
    return Driven(job[1], member, member.drive())


def known(path: Path, code: str) -> dict[int, Driven]:
    """The robots of earlier runs of this code, by number.

    Raises:
        SystemExit: What is there is no such record. Hours of driving are not thrown away unasked.
    """
    if not path.exists():
        return {}
    try:
        kept = json.loads(path.read_text())
        if kept["code"] != code:
            return {}
        alarms = {int(number): list(said) for number, said in kept["alarms"].items()}
        numbers = [number for first, last in kept["driven"] for number in range(first, last + 1)]
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise SystemExit(
            f"{path} is damaged ({error!r}); without it, counting begins anew"
        ) from None
    return {
        number: Driven(number, Member.of(code, number), alarms.get(number, []))
        for number in numbers
    }


def keep(path: Path, code: str, driven: Iterable[Driven]) -> None:
    """Writes what :func:`known` reads; all of it or, if it is interrupted, what was there."""
    by_number = {each.number: each.alarms for each in driven}
    ranges: list[list[int]] = []
    for number in sorted(by_number):
        if not ranges or number > ranges[-1][1] + 1:
            ranges.append([number, number])
        ranges[-1][1] = number
    alarms = {str(number): by_number[number] for number in sorted(by_number) if by_number[number]}
    written = path.with_suffix(".new")
    kept = {"code": code, "driven": ranges, "alarms": alarms}
    written.write_text(json.dumps(kept, indent=1) + "\n")
    written.replace(path)


def drive(hours: float, path: Path = KEPT) -> list[Driven]:
    """Robots until there are so many hours, or Ctrl-C.

    Args:
        hours: Of those that are calibrated as configured.
        path: Where each that has driven is added to.
    """
    code = version()
    driven = known(path, code)
    jobs = [(code, number) for number in _needed(hours, code, driven)]
    with (
        multiprocessing.get_context("spawn").Pool(os.cpu_count(), prepare) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        try:
            for each in progress.track(pool.imap_unordered(robot, jobs), len(jobs)):
                driven[each.number] = each
                keep(path, code, driven.values())
        except KeyboardInterrupt:
            pool.terminate()
    return list(driven.values())


def run(*, quick: bool = False, hours: float | None = None) -> Table:
    """All robots so far.

    Args:
        quick: A few.
        hours: In all, of robots that are calibrated as configured; or else so many more.
    """
    if hours is None:
        already = known(KEPT, version()).values()
        hours = _hours(already, 1.0) + (QUICK_HOURS if quick else HOURS)
    return _table(drive(hours))


def _needed(hours: float, code: str, driven: dict[int, Driven]) -> list[int]:
    """The next robots that together have so many hours."""
    left_s, numbers = hours * 3600, []
    for number in count():
        if left_s <= 0:
            return numbers
        if number not in driven:
            numbers.append(number)
        if Member.of(code, number).worse == 1.0:
            left_s -= ROBOT_S
    raise AssertionError("numbers do not end")


def _hours(driven: Iterable[Driven], worse: float) -> float:
    return sum(ROBOT_S for each in driven if each.member.worse == worse) / 3600


def _table(driven: list[Driven]) -> Table:
    shown = Table(title="Diagnoser: false alarms of robots without a fault", title_justify="left")
    for heading in ("calibration", "physics", "wheels", "h", "reports", "per h", "at most", "aim"):
        shown.add_column(heading, justify="left" if heading == "calibration" else "right")
    shown.add_column("met")
    for worse, aim in AIMS.items():
        name = "as configured" if worse == 1.0 else f"{worse:g} times worse"
        every = [each for each in driven if each.member.worse == worse]
        for physics in ("fast", "mujoco"):
            for wheels in (3, 4):
                mine = [
                    e for e in every if (e.member.physics, e.member.wheels) == (physics, wheels)
                ]
                shown.add_row(name, physics, str(wheels), *_rates(mine, worse))
        hours = _hours(every, worse)
        alarms = sum(len(each.alarms) for each in every)
        needed = TELLING / aim
        met = "[green]yes" if alarms <= aim * hours else "[red]NO"
        if hours < needed and alarms <= aim * needed:
            met = f"{needed:.0f} h will tell"
        shown.add_row(name, "", "", *_rates(every, worse), f"≤ {aim:g}", met, end_section=True)
    shown.caption = "at most: with a probability of 95 %"
    for each in sorted(driven, key=lambda each: each.number):
        for alarm in each.alarms:
            of = each.member
            shown.caption += (
                f"\nrobot {of.seed}: {alarm} ({of.wheels} wheels, {of.physics}, {of.driving}"
                f"{', busy' * of.busy})"
            )
    return shown


def _rates(driven: list[Driven], worse: float) -> list[str]:
    """Hours, reports, reports an hour, and how many that may be in the long run."""
    hours = _hours(driven, worse)
    alarms = sum(len(each.alarms) for each in driven)
    shown = [f"{hours:.2f}", str(alarms)]
    if not hours:
        return [*shown, "", ""]
    return [*shown, f"{alarms / hours:.3f}", f"{gammaincinv(alarms + 1, 0.95) / hours:.3f}"]


def prepare() -> None:
    """A process that drives robots; Ctrl-C is for the one that keeps what became of them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_rarely()  # as the service does


def main(argv: list[str]) -> int:
    """``python -m tests.bench.alarms --hours 300``."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.alarms", description=__doc__)
    parser.add_argument("--hours", type=float, default=300.0, help="in all (%(default)g)")
    console().print(run(hours=parser.parse_args(argv).hours))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
