"""``wackel top``: the robot on a terminal, live."""

import argparse
import sys
import time
from collections.abc import Callable

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from wackel_cli.robot_model import RobotModel
from wackel_cli.robot_screen import render
from wackel_node.arguments import add_config, config_of
from wackel_node.errors import OK
from wackel_node.keyboard import Keyboard
from wackel_node.link import Link
from wackel_schemas.keys import (
    HEALTH,
    ODOMETRY,
    STATE,
    STATISTICS,
    TRANSACTION,
    M,
    Topic,
    chunk_of,
)

_REDRAW_S = 0.25
_KEY_S = 0.1
_COUNT_S = 1.0
_ONCE_S = 2.2  # health and statistics come once a second, and rates need two counts
_ALL_LINES = 1000


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    arguments = _parser().parse_args(argv)
    config = config_of(arguments)
    with Link(config) as link:
        model = RobotModel(config)
        follow(link, model)
        console = Console(highlight=False)
        try:
            if arguments.once:
                _pump_for(link, _ONCE_S)
                if not link.received:
                    raise link.unanswered("aggregator")
                _print(model, console, arguments.json)
            elif arguments.json or not console.is_terminal:
                link.every(_COUNT_S, lambda: _print(model, console, arguments.json))
                while True:
                    link.pump(_COUNT_S)
            else:
                _live(link, model, console)
        except KeyboardInterrupt:
            return OK
    return OK


def follow(link: Link, model: RobotModel) -> None:
    """Keeps a model up to date from :meth:`Link.pump`."""

    def by_bus(topic: Topic[M], take: Callable[[str, M, float], None]) -> None:
        link.subscribe(
            topic,
            lambda key, message: take(chunk_of(topic, key, "bus"), message, time.monotonic()),
        )

    link.subscribe(HEALTH, lambda _, health: model.on_health(health, time.monotonic()))
    link.subscribe(ODOMETRY, lambda _, odometry: model.on_odometry(odometry, time.monotonic()))
    by_bus(STATISTICS, model.on_statistics)
    by_bus(STATE, model.on_state)
    by_bus(TRANSACTION, model.on_transaction)
    model.count(time.monotonic())
    link.every(_COUNT_S, lambda: model.count(time.monotonic()))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="wackel top",
        description="Shows the robot live: buses, servos in cable order with the cable that leads "
        "to each, what is faulty and what to do about it. q or Ctrl-C ends it.",
        epilog="Marks: │ cable  ╳ faulty cable  ● servo  ○ servo that does not answer. What is "
        "grey is old or healed. The columns: answers per second (or time since the last), median "
        "response time, share of answers missed in the last ten seconds, position, voltage, "
        "temperature.",
    )
    add_config(parser)
    parser.add_argument("--once", action="store_true", help="print it once and end")
    parser.add_argument(
        "--json", action="store_true", help="as a line of JSON, once a second or --once"
    )
    return parser


def _live(link: Link, model: RobotModel, console: Console) -> None:
    with (
        Keyboard() as keyboard,
        Live(console=console, screen=True, auto_refresh=False, transient=True) as live,
    ):
        due_s = 0.0
        while "q" not in keyboard.typed():
            link.pump(_KEY_S)
            now_s = time.monotonic()
            if now_s >= due_s:
                due_s = now_s + _REDRAW_S
                width, height = console.size
                live.update(Group(*render(model, now_s, width, height)), refresh=True)


def _pump_for(link: Link, duration_s: float) -> None:
    limit = time.monotonic() + duration_s
    while time.monotonic() < limit:
        link.pump(limit - time.monotonic())


def _print(model: RobotModel, console: Console, json: bool) -> None:
    now_s = time.monotonic()
    if json:
        print(model.as_json(now_s), flush=True)
    else:
        lines = render(model, now_s, console.width, _ALL_LINES)
        console.print(Text("\n").join(lines), end="\n", soft_wrap=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
