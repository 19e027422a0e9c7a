"""``wackel aggregator``: merges all faults of a robot into one health."""

import argparse
import sys
from pathlib import Path

from wackel_node import log
from wackel_node.config import load


def main(argv: list[str]) -> int:
    """Runs the service; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel aggregator",
        description="Merges the faults of all sources, and who is alive, into the topic "
        "wackel/<robot>/health: at once on a change, else once a second, the latest value for "
        "late subscribers. Confirmed faults outlive a restart.",
        epilog="Ask it: `wackel echo health`, `wackel top`.",
    )
    parser.add_argument(
        "--config", type=Path, default=Path("robot.toml"), help="configuration (%(default)s)"
    )
    parser.add_argument("--verbose", action="store_true", help="log more")
    arguments = parser.parse_args(argv)
    log.set_up("aggregator", arguments.verbose)
    config = load(arguments.config)

    from wackel_aggregator.service import run

    run(config)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
