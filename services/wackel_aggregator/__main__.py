"""``wackel aggregator``: merges all faults of a robot into one health."""

import argparse
import sys

from wackel_node import log
from wackel_node.arguments import add_config, config_of


def main(argv: list[str]) -> int:
    """Runs the service; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel aggregator",
        description="Merges the faults of all sources, and who is alive, into the topic "
        "wackel/<robot>/health: at once on a change, else once a second, the latest value for "
        "late subscribers. Confirmed faults outlive a restart.",
        epilog="Ask it: `wackel echo health`, `wackel top`.",
    )
    add_config(parser)
    parser.add_argument("--verbose", action="store_true", help="log more")
    arguments = parser.parse_args(argv)
    log.set_up("aggregator", arguments.verbose)
    config = config_of(arguments)

    from wackel_aggregator.service import run

    run(config)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
