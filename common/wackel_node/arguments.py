"""Arguments that the commands share."""

import argparse
import math
import re
from pathlib import Path

from wackel_node import log
from wackel_node.config import RobotConfig, load
from wackel_protocols.dynamixel2.packet import MAX_ID

DEFAULT = Path("robot.toml")
_LARGEST = 1_000_000  # s, m, m/s and the like


ELSE_DEFAULTS = "robot.toml where you are, else all defaults"
"""What :func:`config_of` takes, in words."""


def add_config(parser: argparse.ArgumentParser, default: str = ELSE_DEFAULTS) -> None:
    """Adds ``--config FILE``; ``default`` says what the command takes without it."""
    parser.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help=f"the robot's configuration (default: {default})",
    )


def add_config_first(
    parser: argparse.ArgumentParser, default: str = "robot.toml where you are"
) -> None:
    """Adds the configuration as an argument of its own, of commands that are about little else;
    ``--config`` names it here, too. ``default`` says what the command takes without it."""
    parser.add_argument(
        "config",
        nargs="?",
        action=_IfThere,
        type=Path,
        help=f"the robot's configuration (default: {default})",
    )
    parser.add_argument("--config", type=Path, help=argparse.SUPPRESS)


class _IfThere(argparse.Action):
    """Stores an argument that may be missing; else, it would undo an option of its name."""

    def __call__(
        self,
        _parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        _option: str | None = None,
    ) -> None:
        if values is not None:
            setattr(namespace, self.dest, values)


def config_of(arguments: argparse.Namespace) -> RobotConfig:
    """The configuration that was asked for.

    Raises:
        ConfigError: It cannot be used.
    """
    if arguments.config is not None:
        return load(arguments.config)
    return load(DEFAULT) if DEFAULT.exists() else RobotConfig()


def configured(parser: argparse.ArgumentParser, argv: list[str], service: str) -> RobotConfig:
    """The configuration of a service that has no arguments of its own; sets up its log, too.

    Raises:
        ConfigError: It cannot be used.
    """
    add_config(parser)
    add_verbose(parser)
    arguments = parser.parse_args(argv)
    log.set_up(service, arguments.verbose)
    return config_of(arguments)


def add_verbose(parser: argparse.ArgumentParser) -> None:
    """Adds ``--verbose``."""
    parser.add_argument("--verbose", action="store_true", help="log more")


def above_zero(text: str) -> float:
    """A quantity that can only be so, and is no larger than anything of a robot.

    Raises:
        argparse.ArgumentTypeError: It is not.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= _LARGEST:
        raise argparse.ArgumentTypeError(
            f"{text!r}: allowed is a number above zero, up to {_LARGEST}"
        )
    return value


def count(text: str) -> int:
    """A number of things, at least one.

    Raises:
        argparse.ArgumentTypeError: It is none.
    """
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no count above zero")
    return int(text)


def id_list(text: str) -> list[int]:
    """Ids of servos as people write them: ``1-20,30``; each once.

    Raises:
        argparse.ArgumentTypeError: They are none.
    """
    ids: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*([0-9]{1,3})(?:-([0-9]{1,3}))?\s*", part)
        if match is None:
            raise argparse.ArgumentTypeError(f"{part!r} is no id and no range such as 1-20")
        first, last = int(match[1]), int(match[2] or match[1])
        if last > MAX_ID:
            raise argparse.ArgumentTypeError(f"{part!r}: ids are 0 to {MAX_ID}")
        if first > last:
            raise argparse.ArgumentTypeError(f"{part!r}: a range begins with the lower id")
        ids.extend(range(first, last + 1))
    return list(dict.fromkeys(ids))
