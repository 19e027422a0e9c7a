"""``wackel diagnoser``: which wheel, steering or sensor of a drive is faulty."""

import argparse
import sys

from wackel_node.algebra import single_threaded
from wackel_node.arguments import configured
from wackel_node.config import drive_of
from wackel_node.errors import OK


def main(argv: list[str]) -> int:
    """Runs the service; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel diagnoser",
        description="Names faulty drives, steerings and sensors: holds the wheels that robot.toml "
        "lists under [drive] (bus/<bus>/state), the gyros (imu/<name>) and the commanded velocity "
        "(command/twist) against each other. Publishes fault/diagnoser, exclusions (which odometry "
        "obeys) and residuals.",
        epilog="Look at it: `wackel echo residuals`. What it can tell apart on your robot: `wackel "
        "explain robot.toml`.",
    )
    config = configured(parser, argv, "diagnoser")
    drive = drive_of(config, "have them diagnosed")
    single_threaded()
    from wackel_diagnoser.service import run

    run(config, drive)
    return OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
