"""How fast a recording of a live robot with faults is diagnosed anew, and whether it is the same.

The recording is made first, by the recorder beside all services; half of it is faults. *Cores* is
what ``wackel replay`` does after its start, in this process and by its CPU time, the least of some
runs, since whatever else the computer does only adds to it; *bus* is the same without the drive;
*command* is the whole command as a person runs it, by the clock.
"""

import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec
from rich.table import Table

from tests.bench.progress import steps
from tests.bench.result import Figure, table
from tests.bench.robot import config
from tests.robot import Robot, running
from wackel_cli.diagnosis import Diagnosis
from wackel_node.config import RecorderConfig, RobotConfig
from wackel_node.garbage import collect_rarely
from wackel_recording.reader import open_recordings

_FAULTS = (("overload", 9), ("silent", 11), ("loose_contact", 15), ("rhythmic_jammer", None))
_RUNS = 3
_FAULT_S = 2.0  # how long each lasts; as long again nothing is wrong


def run(*, quick: bool = False) -> Table:
    """Records, replays twice, compares."""
    seconds = 16.0 if quick else 80.0
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        recordings = directory / "recordings"
        robot_config = msgspec.structs.replace(
            config(directory), recorder=RecorderConfig(directory=str(recordings))
        )
        with running(robot_config, directory) as robot:
            robot.wait(robot.ready)
            _live(robot, seconds)
        collect_rarely()  # as the command does
        files = sorted(recordings.iterdir())
        diagnosis, cores_s = _diagnose(files, robot_config)
        without_drive = msgspec.structs.replace(robot_config, drive=None)
        _, bus_s = _diagnose(files, without_drive)
        first, command_s = _replay(files)
        second, _ = _replay(files)
    span_s = diagnosis.span_ns / 1e9
    return table(
        f"Replay: {span_s:.0f} s with {diagnosis.transactions} transactions, "
        f"{sum(len(each.reports) for each in diagnosis.services.values())} reports",
        [
            Figure("cores, times real time", span_s / cores_s, "×", None, 100.0, at_least=True),
            Figure("cores, bus, times real time", span_s / bus_s, "×", None, 100.0, at_least=True),
            Figure("command, times real time", span_s / command_s, "×"),
            Figure("command: exit code of --compare", first.returncode, "", None, 0.0),
            Figure("command: second run differs", first.stdout != second.stdout, "", None, 0.0),
        ],
    )


def _live(robot: Robot, seconds: float) -> None:
    """Faults come and go."""
    rounds = round(seconds / (2 * _FAULT_S))
    for number in steps(range(rounds), "recording"):
        kind, servo = _FAULTS[number % len(_FAULTS)]
        robot.inject(kind, servo)
        robot.listen(_FAULT_S)
        robot.heal()
        if kind == "overload" and servo is not None:
            robot.reboot(servo)
        robot.listen(_FAULT_S)


def _diagnose(files: list[Path], robot_config: RobotConfig) -> tuple[Diagnosis, float]:
    """What it finds, and the least CPU time that takes."""
    took_s = math.inf
    for _ in range(_RUNS):
        diagnosis = Diagnosis(robot_config)
        begin_s = time.process_time()
        for recording in open_recordings(files):
            for _ in diagnosis.run(recording.entries(diagnosis.wants)):
                pass
        took_s = min(took_s, time.process_time() - begin_s)
    return diagnosis, took_s


def _replay(files: list[Path]) -> tuple[subprocess.CompletedProcess[bytes], float]:
    command = [sys.executable, "-m", "wackel_cli", "replay", "--compare", "--json"]
    begin_s = time.monotonic()
    done = subprocess.run([*command, *map(str, files)], capture_output=True, check=False)
    return done, time.monotonic() - begin_s
