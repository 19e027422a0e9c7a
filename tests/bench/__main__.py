"""``python -m tests.bench``: measurements against the budgets, one table after the other."""

import argparse
import importlib
import os
import platform
import subprocess
import sys

from rich.table import Table

from tests.bench.result import console

BENCHES = {
    "parsing": "parse and diagnose an answer, against the vendor's parser",
    "gateway": "CPU of the gateway, against libraries that only read",
    "bus_use": "cycle time, against the bytes on the wire",
    "proxy": "what mode proxy adds to the vendor's library",
    "latency": "from the wire to the health topic",
    "robot": "CPU and memory of a whole robot",
    "replay": "replay of a recording, against real time",
    "odometry": "cost, drift and consistency of the pose, recorded robots",
    "diagnoser": "cost of the drive diagnosis, and how well drive faults are named; long",
    "driving": "faults of the drive by kind of driving; long",
    "other_drives": "faults of drives that are not all of steered wheels; long",
    "second_faults": "a second fault beside one that stays; long",
    "alarms": "false alarms of the drive, with those of earlier runs; long",
    "drive_live": "from a physical event in the drive to health, and its replay",
    "start": "start and stop of every service",
    "crash": "kill -9 of every service during a fault",
    "bus_faults": "how well bus faults are named; the longest",
}


def main(argv: list[str]) -> int:
    """Runs what is named, or all; 1 if one could not run, whatever the budgets say."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench",
        description="Measures the budgets of the design and prints each figure beside its peer in "
        "the same run. A budget that is missed says NO.",
        epilog="Exit code 1 only if a measurement could not be made.",
    )
    parser.add_argument("names", metavar="NAME", nargs="*", help="which; none: all")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--list", action="store_true", help="name them and stop")
    arguments = parser.parse_args(argv)
    strange = [name for name in arguments.names if name not in BENCHES]
    if strange:
        parser.error(f"there is no {strange[0]!r}; there are {', '.join(BENCHES)}")
    if arguments.list:
        for name, what in BENCHES.items():
            print(f"{name:<14}{what}")
        return 0
    names = arguments.names or list(BENCHES)
    if len(names) == 1:
        _run(names[0], quick=arguments.quick)
        return 0
    # A process for each: no memory, thread or failure of one in the next one's figures.
    quick = ["--quick"] if arguments.quick else []
    failed = []
    for number, name in enumerate(names, 1):
        print(f"[{number}/{len(names)}] {name}: {BENCHES[name]} …", file=sys.stderr, flush=True)
        if subprocess.run(
            [sys.executable, "-m", "tests.bench", name, *quick], check=False
        ).returncode:
            failed.append(name)
    if failed:
        print(f"could not be measured: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _run(name: str, *, quick: bool) -> None:
    result = importlib.import_module(f"tests.bench.{name}").run(quick=quick)
    paper = console()
    for shown in [result] if isinstance(result, Table) else result:
        paper.print(shown)
    load = " ".join(f"{average:.2f}" for average in os.getloadavg())
    # How Python was built makes an eighth of what it costs.
    python = f"Python {platform.python_version()} of {sys.base_prefix}"
    paper.print(f"{python}; load of the machine ({os.cpu_count()} cores, 1, 5, 15 min): {load}\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
