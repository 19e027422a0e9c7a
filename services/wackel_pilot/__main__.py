"""``wackel pilot``: drives a robot along a path."""

import argparse
import sys
from collections.abc import Callable

from wackel_node import log
from wackel_node.algebra import single_threaded
from wackel_node.arguments import DEFAULT, above_zero, add_config
from wackel_node.config import drive_of, load
from wackel_node.errors import OK
from wackel_pilot import path

_EXAMPLES = """\
examples:
  wackel pilot                     a circle of 1 m at 0.3 m/s
  wackel pilot --path eight --speed 0.5 --radius 0.8
  wackel pilot --path random --seed 3 --for 60
"""


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel pilot",
        description="Drives a robot with [drive] along a path: publishes command/twist and the\n"
        "servos' goals on bus/<bus>/command, 100 times a second. THE ROBOT MOVES. Ctrl-C,\n"
        "Ctrl-Z or closing the terminal stops its wheels and ends it; if it is killed,\n"
        "they stop a second later. Servos that drive are put into wheel mode; where one\n"
        "could not follow, the whole robot drives slower. When nothing comes from the\n"
        "robot for two seconds, the pilot ends with exit code 3.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_config(parser, "robot.toml where you are")
    parser.add_argument(
        "--path", choices=["circle", "eight", "random"], default="circle", help="the way (circle)"
    )
    parser.add_argument("--speed", metavar="M/S", type=above_zero, default=0.3, help="(0.3)")
    parser.add_argument("--radius", metavar="M", type=above_zero, default=1.0, help="(1.0)")
    parser.add_argument(
        "--acceleration", metavar="M/S²", type=above_zero, default=0.3, help="from rest (0.3)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of a random path (0)")
    parser.add_argument(
        "--for",
        metavar="S",
        type=above_zero,
        dest="duration_s",
        help="end after so many seconds (default: Ctrl-C)",
    )
    arguments = parser.parse_args(argv)
    log.set_up("pilot")
    config = load(arguments.config or DEFAULT)
    drive = drive_of(config, "drive")
    single_threaded()
    from wackel_pilot.service import run

    run(config, drive, _path(arguments), arguments.duration_s)
    return OK


def _path(arguments: argparse.Namespace) -> path.Path:
    shape: tuple[float, float, float] = (
        arguments.speed,
        arguments.radius,
        arguments.acceleration,
    )
    if arguments.path == "random":
        return path.wander(*shape, seed=arguments.seed)
    paths: dict[str, Callable[[float, float, float], path.Path]] = {
        "circle": path.circle,
        "eight": path.eight,
    }
    return paths[arguments.path](*shape)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
