"""``wackel record``: all topics of the robot into MCAP files."""

import argparse
import shutil
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from secrets import token_hex

from wackel_node import log
from wackel_node.arguments import add_config, config_of
from wackel_node.config import RobotConfig, dump
from wackel_node.errors import FAILED, OK, NotWritable
from wackel_node.listen import EVERYTHING, key_expression
from wackel_node.node import Node
from wackel_recorder.service import Recorder
from wackel_recording.about import About
from wackel_recording.writer import RecordingWriter

_SIZES = {"k": 1e3, "M": 1e6, "G": 1e9}
_DURATIONS = {"s": 1.0, "min": 60.0, "h": 3600.0}
_EXAMPLES = """\
examples:
  wackel record -o run.mcap
  wackel record -o /data --max-duration 10min
  wackel record --topics 'bus/*/transaction' 'fault/*'
"""
_SILENCE_S = 3.0  # a robot that runs has sent several heartbeats by then


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    arguments = _parser().parse_args(argv)
    config = config_of(arguments)
    log.set_up("recorder")
    recorder_config = config.recorder
    writer = RecordingWriter(
        arguments.output or Path(recorder_config.directory or "."),
        _about(config),
        max_bytes=arguments.max_size or recorder_config.max_bytes,
        max_s=arguments.max_duration or recorder_config.max_s,
    )
    for pattern in arguments.topics:
        key_expression(pattern)
    try:
        writer.open()
    except OSError as error:
        raise NotWritable(f"cannot record: {_reason(error)}") from error
    with Node("recorder", "main", config) as node:
        progress = _progress(time.monotonic()) if sys.stderr.isatty() else lambda _: None
        recorder = Recorder(node, writer, arguments.topics, progress)
        node.ready()
        log.logger.info("recording robot %s into %s", config.robot, writer.path)
        warn_at = time.monotonic() + _SILENCE_S
        while not node.stopping:
            node.pump(0.5)
            if not recorder.others and time.monotonic() > warn_at:
                warn_at = float("inf")
                log.logger.warning(
                    "nothing came yet from robot %s at %s; does `wackel up` run?",
                    config.robot,
                    config.zenoh.endpoint,
                )
        whole = recorder.close() and not recorder.lost
    with suppress(OSError):  # a terminal that was closed
        if sys.stderr.isatty():
            print(file=sys.stderr)
    log.logger.info("%s", _sum(recorder, node))
    return OK if whole else FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="wackel record",
        description="Records all topics of the robot into MCAP files, until Ctrl-C. At most\n"
        "half a second is lost if the recorder is killed; play or replay read whatever\n"
        "is there. If a disk did not take messages, the exit code is 1.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_config(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR|FILE.mcap",
        type=Path,
        help="where to (default: recorder.directory in robot.toml, else where you are)",
    )
    parser.add_argument(
        "--topics",
        metavar="PATTERN",
        nargs="+",
        default=[EVERYTHING],
        help="only keys below the robot's name that match one of these key expressions",
    )
    parser.add_argument(
        "--max-size",
        metavar="SIZE",
        type=_size,
        help="begin a new file after so much: 500M, 2G",
    )
    parser.add_argument(
        "--max-duration",
        metavar="TIME",
        type=_duration,
        help="begin a new file after so long: 90s, 10min, 1h",
    )
    return parser


def _quantity(text: str, units: dict[str, float]) -> float:
    """``10min`` with the units given.

    Raises:
        argparse.ArgumentTypeError: It is none, or not above zero.
    """
    number = text.rstrip("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ")
    factor = units.get(text[len(number) :])
    try:
        value = float(number) * (factor or float("nan"))
    except ValueError:
        value = float("nan")
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no number above zero with one of the units {', '.join(units)}"
        )
    return value


def _size(text: str) -> int:
    return max(1, int(_quantity(text, _SIZES)))


def _duration(text: str) -> float:
    return _quantity(text, _DURATIONS)


def _about(config: RobotConfig) -> About:
    from importlib.metadata import version

    return About(
        robot=config.robot,
        config=dump(config),
        version=version("wackel"),
        started_ns=time.time_ns(),
        session=token_hex(8),
    )


def _progress(start_s: float) -> Callable[[Recorder], None]:
    """Shows, on one line of a terminal that is written over, how it goes."""
    last = (start_s, 0)

    def show(recorder: Recorder) -> None:
        nonlocal last
        now, stored = time.monotonic(), recorder.writer.stored_bytes
        rate = (stored - last[1]) / max(now - last[0], 1e-3)
        last = (now, stored)
        elapsed = timedelta(seconds=int(now - start_s))
        path = recorder.writer.path
        line = (
            f"{elapsed}  {recorder.writer.messages} messages  {stored / 1e6:.1f} MB  "
            f"{rate / 1e3:.0f} kB/s  {path.name if path else 'paused'}"
        )
        # A line that wraps would not be written over but scroll.
        width = shutil.get_terminal_size().columns - 1
        with suppress(OSError):  # a terminal that was closed
            print(f"\r{line[:width]}\x1b[K", end="", file=sys.stderr, flush=True)

    return show


def _sum(recorder: Recorder, node: Node) -> str:
    writer = recorder.writer
    text = f"{writer.messages - writer.lost} messages, {writer.stored_bytes / 1e6:.1f} MB"
    counts = {
        "on keys that are not wackel's": writer.foreign,
        "not understood, kept as they came": writer.undecodable,
        "refused, on too many keys": writer.refused,
        "never arrived": node.lost,
        "lost here because the computer was busy": node.overrun,
        "lost to a disk that did not take them": recorder.lost,
    }
    return "; ".join([text, *(f"{count} {what}" for what, count in counts.items() if count)])


def _reason(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}" if error.strerror else str(error)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
