"""``wackel play``: a recording on the robot's topics, in the gateway's place."""

import argparse
import itertools
import shutil
import sys
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

from wackel_node import log
from wackel_node.arguments import DEFAULT, add_config, config_of
from wackel_node.config import RobotConfig, parse
from wackel_node.errors import OK, Explained
from wackel_node.keyboard import Keyboard
from wackel_node.link import Link
from wackel_node.node import Node
from wackel_node.session import NotReached
from wackel_playback.pace import FASTEST, SLOWEST, Pace, timed
from wackel_playback.service import Player, in_the_way, is_played
from wackel_recording.reader import Entry, Recording, open_recordings

_SHOW_S = 0.25
_STARTING_S = 3.0  # what a rendezvous in a container takes to listen
_RETRY_S = 0.2


class LiveRobot(Explained, RuntimeError):
    """The robot itself runs: two sources of the same topics would contradict each other."""


class NothingToPlay(Explained, ValueError):
    """The recording holds none of the topics asked for in the time asked for."""


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    arguments = _parser().parse_args(argv)
    recordings = open_recordings(arguments.files)
    config = _config(arguments, recordings[0])
    log.set_up("playback")
    with _reached(config) as link:
        _refuse(in_the_way(link, arguments.all), config)
    entries = _entries(recordings, arguments)
    first = next(entries, None)
    if first is None:
        raise NothingToPlay(f"{recordings[0].files[0].path}: nothing to play there")
    for doubt in filter(None, (recording.doubt(config.robot) for recording in recordings)):
        log.logger.warning("%s", doubt)
    with Node("playback", "main", config) as node, Keyboard() as keyboard:
        node.ready()
        player = Player(node, keyboard.typed)
        player.await_listeners(first[1].key)
        pace = Pace(time.monotonic(), arguments.speed, arguments.paused)
        if sys.stderr.isatty():
            node.every(_SHOW_S, lambda: _show(player, pace, recordings))
        player.play(itertools.chain([first], entries), pace)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    log.logger.info("%d messages", player.messages)
    for text in (text for recording in recordings for text in recording.damage):
        log.logger.warning("%s", text)
    _refuse(player.intruder, config)
    return OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="wackel play",
        description="Publishes a recording on the topics of the robot, in the gateway's place, in "
        "its recorded rhythm. Refuses where a gateway runs. Needs a rendezvous such as zenohd; "
        "compose/containers/playback.yaml starts that and the diagnosis with it.",
        epilog="On a terminal: space pauses, + and - change the speed, q quits.",
    )
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path, help="of a recording")
    add_config(parser, "robot.toml where you are, else that in the recording")
    parser.add_argument(
        "--speed", type=_speed, default=1.0, help=f"{SLOWEST:g} … {FASTEST:g} (default: 1)"
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--paused", action="store_true", help="begin with a pause")
    parser.add_argument(
        "--from", dest="from_s", metavar="S", type=_seconds, default=0.0, help="skip so much"
    )
    parser.add_argument(
        "--to", dest="to_s", metavar="S", type=_seconds, default=float("inf"), help="end there"
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="also what wackel concluded then: faults, health (refuses where it concludes now)",
    )
    return parser


def _speed(text: str) -> float:
    return _number(text, SLOWEST, FASTEST)


def _seconds(text: str) -> float:
    return _number(text, 0.0, 1e9)


def _number(text: str, least: float, most: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of {least:g} … {most:g}")
    return value


def _config(arguments: argparse.Namespace, recording: Recording) -> RobotConfig:
    """As asked for, or else what the recording was made with."""
    if arguments.config is None and not DEFAULT.exists():
        return parse(recording.about.config, str(recording.files[0].path))
    return config_of(arguments)


def _reached(config: RobotConfig) -> Link:
    """A link to a rendezvous that may be starting at the same time as the playback.

    Raises:
        NotReached: There is none.
    """
    limit = time.monotonic() + _STARTING_S
    while True:
        try:
            return Link(config)
        except NotReached as error:
            if time.monotonic() > limit:
                raise NotReached(
                    f"no robot at {config.zenoh.endpoint}: `wackel up --play FILE` starts its "
                    "services with the recording in the gateway's place"
                ) from error
            time.sleep(_RETRY_S)


def _refuse(service: str, config: RobotConfig) -> None:
    if service:
        raise LiveRobot(
            f"{service} of robot {config.robot} runs at {config.zenoh.endpoint} and publishes the "
            "same topics; stop it first"
        )


def _entries(
    recordings: list[Recording], arguments: argparse.Namespace
) -> Iterator[tuple[float, Entry]]:
    """What is to be played, over and over in a loop."""
    start_s = 0.0
    while True:
        at_s = None
        for at_s, entry in timed(
            (each.entries(lambda key: is_played(key, arguments.all)) for each in recordings),
            arguments.from_s,
            arguments.to_s,
        ):
            yield start_s + at_s, entry
        if at_s is None or not arguments.loop:
            return
        start_s += at_s


def _show(player: Player, pace: Pace, recordings: list[Recording]) -> None:
    share = sum(recording.progress for recording in recordings) / len(recordings)
    state = "paused" if pace.paused else f"x{pace.speed:g}"
    line = (
        f"{timedelta(seconds=int(player.position_s))}  {share:4.0%}  {state}  "
        f"{player.messages} messages  (space pause, + - speed, q quit)"
    )
    # A line that wraps would not be written over but scroll.
    width = shutil.get_terminal_size().columns - 1
    print(f"\r{line[:width]}\x1b[K", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
