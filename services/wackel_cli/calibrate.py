"""``wackel calibrate``: radii, steering offsets and track, from a recording and the true path."""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec.structs import replace

from wackel_cli.lines import printable
from wackel_cli.progress import with_progress
from wackel_node.algebra import single_threaded
from wackel_node.arguments import above_zero, add_config
from wackel_node.config import RobotConfig, drive_of, dump, load, parse
from wackel_node.config_drive import DriveConfig
from wackel_node.errors import FAILED, OK, Explained, NotWritable
from wackel_odometry.calibration import (
    Run,
    calibrate,
    fit,
    length,
    measures,
    misses,
    noise,
    uncertainty,
)
from wackel_odometry.recorded_runs import Recorded, recorded_runs
from wackel_odometry.truth import NoTruth, Truth
from wackel_recording.reader import Recording, open_recordings
from wackel_schemas import wire
from wackel_schemas.bus import BusState
from wackel_schemas.fault import FaultReport
from wackel_schemas.keys import FAULT, STATE, chunk_of, topic_of

_APART_S = 3.0
_ROUNDING = 1e-6  # of steps
_HARDLY = 0.9
"""Of how well a measure was known before: if it is known no better, the recordings do not tell."""
_FITS = 0.1
"""Share of the way by which calibrated wheels miss true poses at most; those that skid in turns
miss them by a few hundredths."""
_LEAST_M = 0.05
"""Of way between two poses: ten times the noise of a path, and more than wheels tremble."""
_AS_GOOD = 1.1
"""Where the position is missed by less, the heading may be missed by so much more by chance, and
the other way round: halves of some minutes have 20 stretches and more."""
Verdict = Literal["confirmed", "unchecked", "contradicted", "misfit"]
_IN_WORDS: dict[Verdict, str] = {
    "confirmed": "Each half of the run is explained better by what the other half gives.",
    "unchecked": "Too short to hold the halves of the run against each other: drive longer to be "
    "sure.",
    "contradicted": "What one half of the run gives explains the other half no better than what is "
    "configured: do not use this.",
    "misfit": "That is another way than the wheels have gone: is the path of the same time (UTC), "
    "in m and rad, x forward and y left?",
}

_DESCRIPTION = """\
Finds the radii of the wheels, where their steerings point and, of a
differential drive, its track, from recordings and the true path meanwhile.
What these do not tell stays as it is configured, within radius_error and
steering_error.

The true path is a CSV file with the columns time (UTC, seconds since 1970),
x, y (m) and theta (rad) of the robot's origin: of motion capture or a camera,
4 times a second or more, or of the moments at which the robot stood on marks on
the floor. Drive for some minutes, with turns to both sides.
"""
_EPILOG = """\
example:
  wackel record -o run.mcap      while the robot drives
  wackel calibrate run.mcap --truth path.csv --write calibrated.toml

Exit code 1 if the path does not fit the wheels, or each half of the run is not
explained better by what the other half gives; then nothing is written.
"""


class NotUsable(Explained, ValueError):
    """The path or the recording is none to calibrate from."""


@dataclass(frozen=True)
class _Measure:
    """One measure, m or rad.

    Attributes:
        configured, found: Before and after.
        sigma: Standard deviation of what was found.
        told: Whether the recordings say anything of it.
    """

    configured: float
    found: float
    sigma: float
    told: bool


@dataclass(frozen=True)
class _Missed:
    """By how much the wheels miss the true poses, root mean square.

    Attributes:
        position_m: m.
        heading_rad: rad.
        by_noise: Of both, by the noise of the path.
    """

    position_m: float
    heading_rad: float
    by_noise: float


@dataclass(frozen=True)
class _Result:
    """What is told in the end.

    Attributes:
        stretches: How many were compared.
        apart_s: And how far apart, at least.
        measures: By name.
        configured, calibrated: What is missed before and after.
        unseen: And in halves of the runs with what the other halves give; absent where these are
            too short.
        verdict: ``confirmed``: that is better than before; ``unchecked``: there is none;
            ``contradicted``: it is not; ``misfit``: the path is another one.
    """

    stretches: int
    apart_s: float
    measures: dict[str, _Measure]
    configured: _Missed
    calibrated: _Missed
    unseen: _Missed | None
    verdict: Verdict


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    arguments = _parser().parse_args(argv)
    if arguments.write is not None and arguments.write.exists():
        raise NotWritable(f"{arguments.write} exists; name another file, or move it away first")
    single_threaded()
    truth = _truth(arguments.truth)
    recordings = open_recordings(arguments.files)
    config = _config(arguments.config, recordings)
    drive = drive_of(config, "calibrate them")
    runs, stretch = _runs(drive, recordings, truth, arguments.apart)
    found, result = _calibrated(drive, runs, stretch, arguments.apart)
    if arguments.json:
        print(json.dumps(asdict(result)))
    else:
        print("\n".join(_text(result)))
    if result.verdict in ("contradicted", "misfit"):
        return FAILED
    if arguments.write is not None:
        try:
            arguments.write.write_text(dump(replace(config, drive=found)), encoding="utf-8")
        except OSError as error:
            raise NotWritable(f"{arguments.write}: {error.strerror}") from error
        print(f"{arguments.write} written", file=sys.stderr)
    return OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="wackel calibrate",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path, help="of a recording")
    parser.add_argument(
        "--truth", metavar="CSV", type=Path, required=True, help="the true path meanwhile"
    )
    add_config(parser, "that in the recording")
    parser.add_argument(
        "--apart",
        metavar="S",
        type=above_zero,
        default=_APART_S,
        help="compare poses so many seconds apart; on a circle, a lap (default: %(default)g)",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print one JSON object: measures by name, what is missed, and the verdict: confirmed, "
        "unchecked (too short), contradicted, misfit; m and rad",
    )
    parser.add_argument(
        "--write", metavar="FILE", type=Path, help="write the configuration with these measures"
    )
    return parser


def _truth(path: Path) -> Truth:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            truth = Truth.parse(file)
    except OSError as error:
        raise NotUsable(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise NotUsable(f"{path}: not a text file") from error
    except NoTruth as error:
        raise NotUsable(printable(f"{path}: {error}")) from error
    if truth.unseen:
        print(f"{path}: {truth.unseen} lines without a pose are left out", file=sys.stderr)
    return truth


def _config(path: Path | None, recordings: Sequence[Recording]) -> RobotConfig:
    if path is not None:
        config = load(path)
        for doubt in filter(None, (each.doubt(config.robot) for each in recordings)):
            print(doubt, file=sys.stderr)
        return config
    names = [recording.files[0].path for recording in recordings]
    configs = [
        parse(recording.about.config, str(name))
        for recording, name in zip(recordings, names, strict=True)
    ]
    for name, config in zip(names, configs, strict=True):
        if config.drive != configs[0].drive:
            raise NotUsable(
                f"{name}: another drive was configured than in {names[0]}; say with --config which "
                "one holds"
            )
    return configs[0]


def _runs(
    drive: DriveConfig, recordings: Sequence[Recording], truth: Truth, apart_s: float
) -> tuple[list[Run], int]:
    """Those long enough to be of use, and how many of their steps a stretch takes."""
    found: list[Recorded] = []
    for recording in recordings:
        states = _States(recording)
        found += recorded_runs(drive, states.read(), truth)
        for text in states.notes():
            print(text, file=sys.stderr)
    if not found:
        raise NotUsable("nowhere in the recording were all servos of the drive heard")
    stretch = math.ceil(apart_s / min(each.step_s for each in found) - _ROUNDING)
    runs = [each.run for each in found if len(each.run.moments(stretch)) > 1]
    if not runs:
        raise NotUsable(
            f"nowhere in the recording are true poses known {apart_s:g} s apart: the wheels were "
            f"heard from {_time(found[0].begin)} to {_time(found[-1].end)}, the path leads from "
            f"{_time(int(truth.stamps[0]))} to {_time(int(truth.stamps[-1]))}"
        )
    return runs, stretch


class _States:
    """What the servos of a recording said.

    Args:
        recording: The recording.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._unreadable = 0
        self._fault = ""

    def read(self) -> Iterator[tuple[str, BusState]]:
        """With the names of their buses, in the order of arrival."""
        entries = self._recording.entries(lambda key: topic_of(key) in (STATE, FAULT))
        for entry in with_progress(entries, self._recording):
            try:
                if topic_of(entry.key) is STATE:
                    yield chunk_of(STATE, entry.key, "bus"), wire.decode(entry.payload, BusState)
                else:
                    self._heed(wire.decode(entry.payload, FaultReport))
            except wire.Rejected:
                self._unreadable += 1

    def _heed(self, report: FaultReport) -> None:
        if report.status == "active" and report.component.startswith("wheel/"):
            self._fault = self._fault or report.message

    def notes(self) -> Iterator[str]:
        """What makes it worth less, in words."""
        name = self._recording.files[0].path
        if self._unreadable:
            yield f"{name}: {self._unreadable} messages cannot be read"
        if self._fault:
            yield printable(f"{name}: not all wheels were sound meanwhile: {self._fault}")
        yield from self._recording.damage


def _calibrated(
    drive: DriveConfig, runs: Sequence[Run], stretch: int, apart_s: float
) -> tuple[DriveConfig, _Result]:
    """The drive as it was found to be, and what is told of that."""
    stretches = sum(len(run.moments(stretch)) - 1 for run in runs)
    way_m = sum(length(drive, run) for run in runs) / stretches
    if way_m < _LEAST_M:
        raise NotUsable("the robot hardly drove meanwhile")
    fitted, before, known = fit(drive, runs, stretch), measures(drive), uncertainty(drive)
    calibrated = _missed([(fitted.config, run) for run in runs], stretch)
    unseen, verdict = _checked(drive, runs, stretch)
    return fitted.config, _Result(
        stretches=stretches,
        apart_s=apart_s,
        measures={
            name: _Measure(before[name], found, sigma, sigma < _HARDLY * known[name])
            for (name, found), sigma in zip(
                measures(fitted.config).items(), fitted.sigma.values(), strict=True
            )
        },
        configured=_missed([(drive, run) for run in runs], stretch),
        calibrated=calibrated,
        unseen=unseen,
        verdict=verdict if calibrated.position_m < _FITS * way_m else "misfit",
    )


def _checked(
    drive: DriveConfig, runs: Sequence[Run], stretch: int
) -> tuple[_Missed | None, Verdict]:
    """What each half of the runs misses with what the other half gives."""
    halves: tuple[list[Run], list[Run]] = [], []
    for run in runs:
        middle = len(run.rolled) // 2
        for half, part in zip(
            halves, (run.part(0, middle), run.part(middle, len(run.rolled))), strict=True
        ):
            if len(part.moments(stretch)) > 1:
                half.append(part)
    if not all(halves):
        return None, "unchecked"
    others = [calibrate(drive, half, stretch) for half in reversed(halves)]
    unseen = _missed(
        [(other, run) for other, half in zip(others, halves, strict=True) for run in half], stretch
    )
    before = _missed([(drive, run) for half in halves for run in half], stretch)
    better = unseen.by_noise < before.by_noise and (
        unseen.position_m < _AS_GOOD * before.position_m
        and unseen.heading_rad < _AS_GOOD * before.heading_rad
    )
    return unseen, "confirmed" if better else "contradicted"


def _missed(pairs: Sequence[tuple[DriveConfig, Run]], stretch: int) -> _Missed:
    off = np.concatenate([misses(drive, run, stretch) for drive, run in pairs])
    expected = np.concatenate([noise(run, stretch) for _, run in pairs])
    position_m = math.sqrt(float(np.mean(off[:, 0] ** 2 + off[:, 1] ** 2)))
    return _Missed(
        position_m,
        heading_rad=math.sqrt(float(np.mean(off[:, 2] ** 2))),
        by_noise=math.sqrt(float(np.mean((off / expected) ** 2))),
    )


def _text(result: _Result) -> Iterator[str]:
    stretches = "1 stretch" if result.stretches == 1 else f"{result.stretches} stretches"
    yield f"From {stretches} of {result.apart_s:g} s and more:"
    width = max(map(len, result.measures))
    for name, each in result.measures.items():
        yield f"  {name:<{width}}  {_change(name, each)}"
    yield "By so much the wheels miss the true pose at the end of a stretch (rms):"
    yield f"  as configured                   {_amount(result.configured)}"
    yield f"  calibrated                      {_amount(result.calibrated)}"
    if result.unseen is not None:
        yield f"  halves, by the other half only  {_amount(result.unseen)}"
    yield _IN_WORDS[result.verdict]


def _change(name: str, each: _Measure) -> str:
    change, told = each.found - each.configured, "" if each.told else "  (hardly told by this run)"
    if name.endswith("steering_offset"):
        amount = f"{math.degrees(change):+7.2f}° ± {math.degrees(each.sigma):.2f}°"
        return f"{each.configured:9.4f} -> {each.found:9.4f} rad {amount}{told}"
    amount = f"{change / each.configured:+8.2%} ± {each.sigma / each.configured:.2%}"
    return f"{each.configured * 1e3:9.2f} -> {each.found * 1e3:9.2f} mm  {amount}{told}"


def _amount(missed: _Missed) -> str:
    return f"{missed.position_m * 1e3:7.1f} mm  {math.degrees(missed.heading_rad):6.2f}°"


def _time(stamp: int) -> str:
    return datetime.fromtimestamp(stamp / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-4]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
