"""``wackel gateway``: arguments and exit codes."""

import argparse
import sys

from wackel_node import log
from wackel_node.arguments import add_config, add_verbose, config_of
from wackel_node.config import ConfigError, RobotConfig
from wackel_node.errors import OK

_DESCRIPTION = """\
Owns one servo bus and publishes every transaction on it, raw and with its
timing, and what the servos say in SI units.

How it owns the bus is set by `mode` of the bus in robot.toml:
  poll   it is the master: reads all servos in a cycle and takes goals from
         bus/<bus>/command
  proxy  your software is the master: it opens `proxy_port` instead of the real
         port, and nothing else changes for it
  tap    it only listens, through a second adapter on the same wires
"""

_EPILOG = """\
examples:
  wackel gateway --config robot.toml             the only bus of the robot
  wackel gateway --config robot.toml --bus legs  one of several: a process each
  wackel scan --write robot.toml                 a robot.toml to start from

A port that is not there is waited for, and reported as a fault meanwhile.
"""


def main(argv: list[str]) -> int:
    """Runs a gateway; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel gateway",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_config(parser)
    parser.add_argument("--bus", metavar="NAME", help="which bus; not needed if there is only one")
    add_verbose(parser)
    arguments = parser.parse_args(argv)
    config = config_of(arguments)
    bus = _bus(config, arguments.bus)
    log.set_up(f"gateway/{bus}", arguments.verbose)

    from wackel_gateway.service import run

    run(config, bus)
    return OK


def _bus(config: RobotConfig, name: str | None) -> str:
    known = ", ".join(config.buses) or "none; `wackel scan --write robot.toml` finds some"
    if name is None:
        if len(config.buses) == 1:
            return next(iter(config.buses))
        raise ConfigError(f"say which bus with --bus; there are {known}")
    if name not in config.buses:
        raise ConfigError(f"--bus {name}: there is no such bus; there are {known}")
    return name


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
