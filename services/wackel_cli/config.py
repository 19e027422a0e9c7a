"""``wackel config``: checks a robot.toml and prints what is in force, with every default."""

import argparse
import sys
from pathlib import Path

import msgspec

from wackel_node.config import RobotConfig, dump, load
from wackel_node.errors import OK


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel config",
        description="Checks a configuration and prints it with all defaults written out, as TOML "
        "that may be saved and edited. A mistake is told in one line, with exit code 2.",
    )
    parser.add_argument(
        "config", nargs="?", type=Path, help="robot.toml; without it, the defaults are printed"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of TOML")
    arguments = parser.parse_args(argv)
    config = load(arguments.config) if arguments.config is not None else RobotConfig()
    if arguments.json:
        print(msgspec.json.format(msgspec.json.encode(config)).decode())
    else:
        print(dump(config), end="")
    return OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
