"""``wackel replay``: a recording diagnosed anew, as fast as it goes."""

import argparse
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TextIO

import msgspec

from wackel_cli.comparison import Difference, differences
from wackel_cli.diagnosis import Diagnosis
from wackel_cli.lines import printable
from wackel_cli.progress import with_progress
from wackel_node.algebra import single_threaded
from wackel_node.arguments import add_config
from wackel_node.config import RobotConfig, load, parse
from wackel_node.errors import FAILED, OK, Explained, NotWritable
from wackel_node.garbage import collect_rarely
from wackel_recording.reader import Recording, open_recordings
from wackel_schemas.drive import Odometry
from wackel_schemas.fault import FaultReport


class NotComparable(Explained, ValueError):
    """The recording holds nothing to compare with."""


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    arguments = _parser().parse_args(argv)
    single_threaded()
    recordings = open_recordings(arguments.files)
    _spare(arguments, recordings)
    with ExitStack() as stack:
        output = _open(arguments.output, stack)
        odometry = _open(arguments.odometry, stack)
        same = True
        for recording in recordings:
            same = _replay(recording, arguments, output, odometry) and same
    return OK if same else FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="wackel replay",
        description="Diagnoses recordings anew, with this version of wackel, and prints every "
        "fault of buses, drive and sensors that begins, changes or heals. Runs as fast as it "
        "goes; the same recording always gives the same output.",
        epilog="Exit code 1 if --compare finds a difference.",
    )
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path, help="of a recording")
    add_config(parser, "that in the recording")
    parser.add_argument(
        "--compare",
        action="store_true",
        help="compare with what the live services concluded in the same recording",
    )
    parser.add_argument("--json", action="store_true", help="whole reports as JSON lines")
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, help="also write them as JSON lines to FILE"
    )
    parser.add_argument(
        "--odometry", metavar="FILE", type=Path, help="write the odometry as JSON lines to FILE"
    )
    return parser


def _spare(arguments: argparse.Namespace, recordings: list[Recording]) -> None:
    """Refuses to write over what is read, or one file twice: opening it would empty it."""
    named = [file.path for recording in recordings for file in recording.files]
    for path in (arguments.config, arguments.output, arguments.odometry):
        if path is None:
            continue
        if any(_same(path, other) for other in named):
            raise NotWritable(
                f"{path}: is named twice here, and what is in it would be lost; name another file"
            )
        named.append(path)


def _same(path: Path, other: Path) -> bool:
    """Whether both are one file, which need not be there yet."""
    with suppress(OSError):
        return path.samefile(other)
    return path.resolve() == other.resolve()


def _open(path: Path | None, stack: ExitStack) -> TextIO | None:
    if path is None:
        return None
    try:
        return stack.enter_context(path.open("w", encoding="utf-8"))
    except OSError as error:
        raise NotWritable(f"{path}: {error.strerror}") from error


def _config(arguments: argparse.Namespace, recording: Recording) -> RobotConfig:
    if arguments.config is not None:
        return load(arguments.config)
    return parse(recording.about.config, str(recording.files[0].path))


def _replay(
    recording: Recording,
    arguments: argparse.Namespace,
    output: TextIO | None,
    odometry: TextIO | None,
) -> bool:
    """Whether nothing differs."""
    config = _config(arguments, recording)
    if doubt := recording.doubt(config.robot):
        print(doubt, file=sys.stderr)
    diagnosis = Diagnosis(config)
    collect_rarely()
    started_s = time.monotonic()
    for message in diagnosis.run(with_progress(recording.entries(diagnosis.wants), recording)):
        if isinstance(message, Odometry):
            if odometry is not None:
                print(msgspec.json.encode(message).decode(), file=odometry)
            continue
        line = msgspec.json.encode(message).decode()
        if output is not None:
            print(line, file=output)
        print(line if arguments.json else _line(message, diagnosis.first_ns or 0))
    _summarise(diagnosis, recording, time.monotonic() - started_s)
    return not arguments.compare or _compare(diagnosis, recording, arguments.json)


def _line(report: FaultReport, start_ns: int) -> str:
    return printable(
        f"{(report.stamp - start_ns) / 1e9:10.3f} s  {report.status:<6}  {report.code:<18} "
        f"{report.confidence:4.0%}  {report.message}"
    )


def _summarise(diagnosis: Diagnosis, recording: Recording, took_s: float) -> None:
    """What is not a conclusion goes to stderr, so that the output is always the same."""
    span_s = diagnosis.span_ns / 1e9
    changes = sum(len(service.reports) for service in diagnosis.services.values())
    print(
        f"{recording.files[0].path}: {changes} changes in {diagnosis.transactions} "
        f"transactions of {span_s:.1f} s; took {took_s:.2f} s, {span_s / took_s:.0f} times real "
        "time",
        file=sys.stderr,
    )
    end = diagnosis.odometry
    if end is not None:
        doubt = "" if end.valid else f", not valid: {end.reason}"
        print(
            f"  odometry ends at {end.x:+.3f} {end.y:+.3f} m, {end.theta:+.4f} rad{doubt}",
            file=sys.stderr,
        )
    for key, (count, reason) in diagnosis.skipped.items():
        print(printable(f"  {key}: {count} messages not used: {reason}"), file=sys.stderr)
    for text in recording.damage:
        print(f"  {text}", file=sys.stderr)


def _compare(diagnosis: Diagnosis, recording: Recording, json: bool) -> bool:
    """Prints what differs; whether nothing does."""
    live = {name: service for name, service in diagnosis.services.items() if service.seen}
    if not live:
        raise NotComparable(f"{recording.files[0].path}: no live service was recorded")
    found: list[Difference] = []
    for name, service in live.items():
        for note in service.notes():
            print(f"  the live {name} {note}", file=sys.stderr)
        found += differences(service.live, diagnosis.reports_heard(name))
    for difference in found:
        print(msgspec.json.encode(difference).decode() if json else printable(str(difference)))
    reports = sum(len(service.live) for service in live.values())
    print(f"  {len(found)} differences from {reports} live reports", file=sys.stderr)
    return not found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
