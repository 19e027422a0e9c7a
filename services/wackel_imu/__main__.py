"""``wackel imu``: arguments and exit codes."""

import argparse
import sys
from pathlib import Path

from wackel_node import log
from wackel_node.arguments import add_config, add_verbose, config_of
from wackel_node.config import ConfigError, RobotConfig
from wackel_node.errors import OK

_DESCRIPTION = """\
Reads a gyro of this computer from the kernel (Industrial I/O, buffered) and
publishes its samples on imu/<name>, with the kernel's stamps. In robot.toml:

  [gyros.body]
  source = "iio"
  device = "lsm6dsl_gyro"  # as /sys/bus/iio/devices/*/name, or /dev/iio:device0
  axis = "z"               # that points up
  rate = 100

A gyro that is not there is waited for, and reported as a fault meanwhile. Needs
permission to set the device up: compose/udev has a rule.
"""


def main(argv: list[str]) -> int:
    """Runs the service; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel imu",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_config(parser)
    parser.add_argument("--gyro", metavar="NAME", help="which; not needed if there is only one")
    parser.add_argument(
        "--sysfs", metavar="DIR", type=Path, default=Path("/sys"), help="default: %(default)s"
    )
    parser.add_argument(
        "--dev", metavar="DIR", type=Path, default=Path("/dev"), help="default: %(default)s"
    )
    add_verbose(parser)
    arguments = parser.parse_args(argv)
    config = config_of(arguments)
    name = _gyro(config, arguments.gyro)
    log.set_up(f"imu/{name}", arguments.verbose)

    from wackel_imu.service import run

    run(config, name, arguments.sysfs, arguments.dev)
    return OK


def _gyro(config: RobotConfig, name: str | None) -> str:
    names = [each for each, gyro in config.gyros.items() if gyro.source == "iio"]
    known = ", ".join(names) or 'none; give one of [gyros] source = "iio"'
    if name is None:
        if len(names) == 1:
            return names[0]
        raise ConfigError(f"say which gyro with --gyro; there are {known}")
    if name not in names:
        raise ConfigError(f"--gyro {name}: there is no such gyro of source iio; there are {known}")
    return name


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
