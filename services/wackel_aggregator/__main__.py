"""``wackel aggregator``: merges all faults of a robot into one health."""

import argparse
import sys

from wackel_node.arguments import configured
from wackel_node.errors import OK


def main(argv: list[str]) -> int:
    """Runs the service; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel aggregator",
        description="Merges the faults of all sources, and who is alive, into the topic "
        "wackel/<robot>/health: at once on a change, else once a second, the latest value for "
        "late subscribers. Confirmed faults outlive a restart.",
        epilog="Ask it: `wackel echo health`, `wackel top`.",
    )
    config = configured(parser, argv, "aggregator")

    from wackel_aggregator.service import run

    run(config)
    return OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
