"""``python -m tests.fuzz [--bytes N] [--seed S]``: exit code 1 on any violation."""

import argparse
import sys
import time

import numpy as np
from rich.console import Console
from rich.progress import Progress

from tests.fuzz import dynamixel2
from tests.fuzz.target import Outcome, Target

TARGETS: tuple[Target, ...] = dynamixel2.TARGETS
SHOWN_VIOLATIONS = 10


def run(target: Target, total_bytes: int, seed: int, progress: Progress) -> Outcome:
    """Rounds of one target until it has had its share; each round has a generator of its own."""
    share = int(total_bytes * target.share)
    task = progress.add_task(target.name, total=share)
    outcome = Outcome()
    index = 0
    while outcome.bytes < share:
        result = target.round(np.random.default_rng([seed, index]))
        result.violations = [f"round {index}: {line}" for line in result.violations]
        outcome.add(result)
        progress.update(task, completed=min(outcome.bytes, share))
        index += 1
    return outcome


def report(name: str, outcome: Outcome, seconds: float) -> None:
    """The outcome of one target, on stdout."""
    kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(outcome.kinds.items()))
    print(f"{name}: {outcome.bytes} bytes, {outcome.bytes / seconds / 1e6:.2f} MB/s with judging")
    print(
        f"  packets planted {outcome.planted}, found {outcome.found}, "
        f"hidden by a chance CRC {outcome.shadowed}"
    )
    print(f"  {kinds}")
    for line in outcome.violations[:SHOWN_VIOLATIONS]:
        print(f"  VIOLATION {line}")
    if len(outcome.violations) > SHOWN_VIOLATIONS:
        print(f"  … {len(outcome.violations) - SHOWN_VIOLATIONS} more")


def main() -> int:
    """Run all targets."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--bytes", type=int, default=10_000_000, help="bytes in all (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="same seed, same bytes (%(default)s)")
    arguments = parser.parse_args()
    violated = False
    with Progress(console=Console(stderr=True)) as progress:
        for target in TARGETS:
            began = time.perf_counter()
            outcome = run(target, arguments.bytes, arguments.seed, progress)
            report(target.name, outcome, time.perf_counter() - began)
            violated = violated or bool(outcome.violations)
    print(f"seed {arguments.seed}: {'VIOLATED' if violated else 'all promises kept'}")
    return int(violated)


if __name__ == "__main__":
    sys.exit(main())
