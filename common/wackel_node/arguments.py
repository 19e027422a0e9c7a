"""Arguments that the commands share."""

import argparse
from pathlib import Path

from wackel_node.config import RobotConfig, load

DEFAULT = Path("robot.toml")


def add_config(parser: argparse.ArgumentParser) -> None:
    """Adds ``--config FILE``; see :func:`config_of`."""
    parser.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="the robot's configuration (default: robot.toml where you are, else all defaults)",
    )


def config_of(arguments: argparse.Namespace) -> RobotConfig:
    """The configuration that was asked for.

    Raises:
        ConfigError: It cannot be used.
    """
    if arguments.config is not None:
        return load(arguments.config)
    return load(DEFAULT) if DEFAULT.exists() else RobotConfig()
