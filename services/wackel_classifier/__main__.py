"""``wackel classifier``: arguments and exit codes."""

import argparse
import sys

from wackel_node.arguments import configured
from wackel_node.errors import OK

_DESCRIPTION = """\
Names the physical faults of all servo buses from their raw traffic: which
cable, which servo, what kind. Listens to bus/<bus>/transaction, which a gateway
or `wackel play` publishes, and tells what it finds on fault/classifier: at once
on a change, and once a second what is still there.

It needs the servos of robot.toml in cable order, from the adapter outwards, and
where power enters.
"""

_EPILOG = """\
examples:
  wackel classifier --config robot.toml     for all buses of the robot
  wackel echo fault/classifier              what it finds
  wackel replay FILE                        the same diagnosis on a recording
"""


def main(argv: list[str]) -> int:
    """Runs the classifier; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel classifier",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    config = configured(parser, argv, "classifier")

    from wackel_classifier.service import run

    run(config)
    return OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
