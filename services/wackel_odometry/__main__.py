"""``wackel odometry``: where the robot is, from its wheels and gyros."""

import argparse
import sys

from wackel_node.algebra import single_threaded
from wackel_node.arguments import configured
from wackel_node.config import drive_of
from wackel_node.errors import OK


def main(argv: list[str]) -> int:
    """Runs the service; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel odometry",
        description="Publishes pose and twist on wackel/<robot>/odometry, from the wheels that "
        "robot.toml lists under [drive] (read from bus/<bus>/state) and the gyros under [gyros] "
        "(from imu/<name>): with covariances, what each input was worth, slip of each wheel, and "
        "faults of the gyros.",
        epilog="Look at it, and reset or set the pose: `wackel pose`.",
    )
    config = configured(parser, argv, "odometry")
    drive = drive_of(config, "get odometry")
    single_threaded()
    from wackel_odometry.service import run

    run(config, drive)
    return OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
