"""``wackel odometry``: where the robot is, from its wheels and gyros."""

import argparse
import sys

from wackel_node import log
from wackel_node.algebra import single_threaded
from wackel_node.arguments import add_config, config_of
from wackel_node.config import ConfigError


def main(argv: list[str]) -> int:
    """Runs the service; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel odometry",
        description="Publishes pose and twist on wackel/<robot>/odometry, from the wheels that "
        "robot.toml lists under [drive] (read from bus/<bus>/state) and the gyros under [gyros] "
        "(from imu/<name>): with covariances, what each input was worth, slip of each wheel, and "
        "faults of the gyros.",
        epilog="Look at it: `wackel echo odometry`. Reset the pose: a query on odometry/request.",
    )
    add_config(parser)
    parser.add_argument("--verbose", action="store_true", help="log more")
    arguments = parser.parse_args(argv)
    log.set_up("odometry", arguments.verbose)
    config = config_of(arguments)
    if config.drive is None:
        raise ConfigError("robot.toml has no [drive]: list the wheels there to get odometry")

    single_threaded()
    from wackel_odometry.service import run

    run(config, config.drive)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
