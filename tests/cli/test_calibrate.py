"""`wackel calibrate`: from a recording and the true path to a configuration."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from tests.cli.test_replay import recorded, write
from tests.odometry.runs import OPTIODOM, optiodom_calibrated, optiodom_nominal, optiodom_run
from tests.odometry.simulation import (
    BUS,
    START_NS,
    Errors,
    Robot,
    differential_drive,
    exact,
    other_drives,
    random_path,
    steered_drive,
)
from wackel_cli.calibrate import NotUsable, main
from wackel_kinematics.array import Floats
from wackel_node.config import BusConfig, ConfigError, RobotConfig, ServoConfig, dump, load
from wackel_node.config_drive import DriveConfig
from wackel_node.errors import NotWritable
from wackel_odometry.calibration import measures
from wackel_recording.reader import Unreadable
from wackel_schemas import wire
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.fault import Evidence, FaultReport

LEFT, RIGHT = 0.012, -0.008
"""What is wrong with the radii of the robot below, as shares."""


def robot_of(drive: DriveConfig) -> RobotConfig:
    ids = [servo for wheel in drive.wheels for _, servo in wheel.servos()]
    buses = {BUS: BusConfig(port="p", servos=[ServoConfig(id=each) for each in ids])}
    return RobotConfig(robot="testbot", buses=buses, drive=drive)


DIFFERENTIAL = robot_of(differential_drive(radius_error=0.01))


@dataclass
class Ride:
    """A recorded run: its file, and where the robot really was, UTC s, m, m, rad."""

    recording: Path
    truth: Floats

    def csv(self, path: Path, rows: "slice | list[int]" = slice(None)) -> Path:
        """Writes the true path, or some of its rows, beside what motion capture tells else."""
        lines = [f"{time:.9f},7,{x},{y},{theta}" for time, x, y, theta in self.truth[rows]]
        path.write_text("\n".join(["time,markers,x,y,theta", *lines]))
        return path


def ride(
    path: Path, config: RobotConfig, errors: Errors, length_m: float, after_s: int = 0
) -> Ride:
    assert config.drive is not None
    rng = np.random.default_rng(after_s)
    robot = Robot(config.drive, errors, rng)
    sideways = config.drive.kind in ("steered", "mecanum", "omni")
    messages, truth = [], []
    for moment in robot.drive(random_path(rng, length_m, sideways=sideways)):
        moment.state.stamp += after_s * 1_000_000_000
        messages.append((f"bus/{BUS}/state", wire.encode(moment.state)))
        pose = moment.pose + rng.normal(0.0, (0.002, 0.002, 0.003))
        pose[2] = math.remainder(pose[2], math.tau)
        truth.append([moment.state.stamp / 1e9, *pose])
    return Ride(write(path, messages, config), np.array(truth))


@pytest.fixture(scope="module")
def differential(tmp_path_factory: pytest.TempPathFactory) -> Ride:
    errors = Errors(np.array([LEFT, RIGHT]), np.zeros(2))
    return ride(tmp_path_factory.mktemp("run") / "run.mcap", DIFFERENTIAL, errors, 30.0)


def test_radii_are_found_and_written_and_nothing_else_changes(
    differential: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, written = differential.csv(tmp_path / "path.csv"), tmp_path / "new.toml"
    arguments = [str(differential.recording), "--truth", str(path)]
    assert main([*arguments, "--write", str(written)]) == 0
    assert "left.radius" in capsys.readouterr().out
    config = load(written)
    assert config.drive is not None
    left, right = (wheel.radius / 0.05 - 1 for wheel in config.drive.wheels)
    assert left == pytest.approx(LEFT, abs=0.001)
    assert right == pytest.approx(RIGHT, abs=0.001)
    restored = [replace(wheel, radius=0.05) for wheel in config.drive.wheels]
    drive = replace(config.drive, wheels=restored, track=None)
    assert replace(config, drive=drive) == DIFFERENTIAL


def test_marks_at_which_the_robot_stands_are_enough(
    differential: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    every_5_s = list(range(0, len(differential.truth), 500))
    path = differential.csv(tmp_path / "marks.csv", every_5_s)
    assert main([str(differential.recording), "--truth", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["stretches"] == len(every_5_s) - 1
    left = told["measures"]["left.radius"]
    assert left["found"] / left["configured"] - 1 == pytest.approx(LEFT, abs=0.003)
    assert left["told"]


def test_how_well_a_measure_is_known_is_true(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The squares of what six robots' measures are off, by what is told of that: 1 on average."""
    config, off = robot_of(steered_drive(3)), []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        errors = Errors(rng.normal(0.0, 0.003, 3), rng.normal(0.0, 0.0035, 3))
        driven = ride(tmp_path / f"{seed}.mcap", config, errors, 15.0, seed)
        path = driven.csv(tmp_path / f"{seed}.csv")
        assert main([str(driven.recording), "--truth", str(path), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["verdict"] == "confirmed"
        assert told["calibrated"]["position_m"] < told["configured"]["position_m"]
        for i in range(3):
            radius = told["measures"][f"w{i}.radius"]
            off.append((radius["found"] - 0.05 * (1 + errors.radius[i])) / radius["sigma"])
            steering = told["measures"][f"w{i}.steering_offset"]
            off.append((steering["found"] - errors.direction[i]) / steering["sigma"])
    assert 0.4 < float(np.mean(np.square(off))) < 2.0


def in_degrees(truth: Floats) -> Floats:
    return np.column_stack([truth[:, :3], np.degrees(truth[:, 3])])


def late(truth: Floats) -> Floats:
    return np.array([truth[:-200, 0], *truth[200:, 1:].T]).T


def mirrored(truth: Floats) -> Floats:
    return truth * [1, 1, -1, 1]


def in_millimetres(truth: Floats) -> Floats:
    return truth * [1, 1e3, 1e3, 1]


@pytest.mark.parametrize("mistake", [in_degrees, late, mirrored, in_millimetres])
def test_a_path_that_is_not_that_of_the_wheels_is_told_and_nothing_is_written(
    differential: Ride,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    mistake: Callable[[Floats], Floats],
) -> None:
    wrong = Ride(differential.recording, mistake(differential.truth))
    path, written = wrong.csv(tmp_path / "path.csv"), tmp_path / "new.toml"
    arguments = [str(wrong.recording), "--truth", str(path), "--write", str(written)]
    assert main(arguments) == 1
    assert "another way than the wheels have gone" in capsys.readouterr().out
    assert not written.exists()


def test_halves_that_contradict_each_other_are_told(
    differential: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Someone kicked the camera: from then on it sees the way 5 % longer, before 5 % shorter."""
    kicked = Ride(differential.recording, differential.truth.copy())
    half = len(kicked.truth) // 2
    kicked.truth[:half, 1:3] *= 0.95
    kicked.truth[half:, 1:3] *= 1.05
    path, written = kicked.csv(tmp_path / "path.csv"), tmp_path / "new.toml"
    arguments = [str(kicked.recording), "--truth", str(path), "--write", str(written)]
    assert main(arguments) == 1
    assert "explains the other half no better" in capsys.readouterr().out
    assert not written.exists()


def test_a_robot_that_stands_tells_nothing(tmp_path: Path) -> None:
    robot = Robot(differential_drive(), exact(2), np.random.default_rng(1))
    moments = list(robot.drive(np.zeros((1000, 3))))
    messages = [(f"bus/{BUS}/state", wire.encode(moment.state)) for moment in moments]
    stamps = [moment.state.stamp / 1e9 for moment in moments]
    still = Ride(
        write(tmp_path / "run.mcap", messages, DIFFERENTIAL),
        np.column_stack([stamps, np.zeros((1000, 3))]),
    )
    path = still.csv(tmp_path / "path.csv")
    with pytest.raises(NotUsable, match="hardly drove"):
        main([str(still.recording), "--truth", str(path)])


@pytest.mark.parametrize("kind", [*other_drives()])
def test_a_drive_of_each_kind_can_be_calibrated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    drive = other_drives()[kind]
    count = len(drive.wheels)
    errors = Errors(np.resize([0.01, -0.006, 0.003], count), np.zeros(count))
    driven = ride(tmp_path / "run.mcap", robot_of(drive), errors, 15.0)
    path = driven.csv(tmp_path / "path.csv")
    assert main([str(driven.recording), "--truth", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    wheels = {wheel.name for wheel in drive.wheels if wheel.drive is not None}
    assert {name[: -len(".radius")] for name in told["measures"] if "radius" in name} == wheels
    assert told["calibrated"]["position_m"] < 0.8 * told["configured"]["position_m"]


def test_a_short_run_says_that_nothing_confirms_it(
    differential: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = differential.csv(tmp_path / "path.csv", [0, 1000])
    assert main([str(differential.recording), "--truth", str(path)]) == 0
    said = capsys.readouterr().out
    assert "From 1 stretch of 3 s" in said
    assert "Too short" in said


def test_a_wheel_that_was_faulty_meanwhile_is_told(
    differential: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = FaultReport(
        stamp=1,
        code="wheel_blocked",
        component="wheel/left/drive",
        status="active",
        confidence=1.0,
        message="wheel left does not turn",
        remedy="",
        evidence=Evidence(summary=""),
        since=1,
    )
    messages = [*recorded(differential.recording), ("fault/diagnoser", wire.encode(report))]
    spoiled = [*messages, (f"bus/{BUS}/state", b"\xff")]
    recording = write(tmp_path / "faulty.mcap", spoiled, DIFFERENTIAL)
    path = differential.csv(tmp_path / "path.csv")
    assert main([str(recording), "--truth", str(path)]) == 0
    said = capsys.readouterr().err
    assert "not all wheels were sound meanwhile: wheel left does not turn" in said
    assert "1 messages cannot be read" in said


def test_a_path_of_another_time_is_refused_with_both_times(
    differential: Ride, tmp_path: Path
) -> None:
    early = Ride(differential.recording, differential.truth - [3600.0, 0, 0, 0])
    path = early.csv(tmp_path / "path.csv")
    with pytest.raises(NotUsable, match=r"heard from 2023-11-14 22:13:20.* leads from .* 21:13:20"):
        main([str(early.recording), "--truth", str(path)])


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n", b"\xff\xfe\x00", b"time,x,y,theta\n"])
def test_what_is_no_path_is_refused_in_one_line(
    differential: Ride, tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "path.csv"
    path.write_bytes(content)
    with pytest.raises(NotUsable, match=r"path\.csv: ") as refused:
        main([str(differential.recording), "--truth", str(path)])
    assert "\n" not in str(refused.value)


def test_files_that_are_not_there_or_none_of_these_are_refused(
    differential: Ride, tmp_path: Path
) -> None:
    path = differential.csv(tmp_path / "path.csv")
    with pytest.raises(NotUsable, match="No such file"):
        main([str(differential.recording), "--truth", str(tmp_path / "none.csv")])
    with pytest.raises(Unreadable, match="not an MCAP file"):
        main([str(path), "--truth", str(path)])
    with pytest.raises(NotWritable, match="exists"):
        main([str(differential.recording), "--truth", str(path), "--write", str(path)])
    beat = ("alive/gateway/main", b"")
    empty = write(tmp_path / "empty.mcap", [beat], DIFFERENTIAL)
    with pytest.raises(NotUsable, match="nowhere in the recording were all servos"):
        main([str(empty), "--truth", str(path)])
    wheelless = write(tmp_path / "arm.mcap", [beat], replace(DIFFERENTIAL, drive=None))
    with pytest.raises(ConfigError, match="no \\[drive\\]"):
        main([str(wheelless), "--truth", str(path)])


def test_recordings_of_one_drive_are_taken_together(
    differential: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    errors = Errors(np.array([LEFT, RIGHT]), np.zeros(2))
    second = ride(tmp_path / "2.mcap", DIFFERENTIAL, errors, 10.0, after_s=600)
    both = Ride(second.recording, np.concatenate([differential.truth, second.truth]))
    path = both.csv(tmp_path / "path.csv")
    files = [str(differential.recording), str(second.recording)]
    assert main([*files, "--truth", str(path), "--json"]) == 0
    together = json.loads(capsys.readouterr().out)["stretches"]
    assert main([files[0], "--truth", str(path), "--json"]) == 0
    assert together > json.loads(capsys.readouterr().out)["stretches"]

    other = replace(DIFFERENTIAL, drive=differential_drive(track=0.5))
    third = ride(tmp_path / "3.mcap", other, errors, 2.0, after_s=1200)
    with pytest.raises(NotUsable, match="another drive was configured"):
        main([files[0], str(third.recording), "--truth", str(path)])
    toml = tmp_path / "robot.toml"
    toml.write_text(dump(DIFFERENTIAL))
    arguments = [files[0], str(third.recording), "--truth", str(path), "--config", str(toml)]
    assert main(arguments) == 0


@pytest.mark.skipif(not OPTIODOM.exists(), reason=f"no recorded robot at {OPTIODOM}")
def test_recorded_circles_give_the_same_as_without_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, files, truth = robot_of(optiodom_nominal()), [], []
    for number in (1, 2):
        run, messages = optiodom_run(f"circular_231220200121_run-0{number}"), []
        turned = np.concatenate([np.zeros((1, 2)), np.cumsum(run.rolled, axis=0)])
        for step, angles in enumerate(turned.tolist()):
            stamp = START_NS + number * 1_000_000_000_000 + step * 50_000_000
            servos = [ServoState(id=i, position=angle) for i, angle in enumerate(angles, 1)]
            messages.append((f"bus/{BUS}/state", wire.encode(BusState(stamp=stamp, servos=servos))))
            truth.append([stamp / 1e9, *run.poses[step]])
        files.append(write(tmp_path / f"{number}.mcap", messages, config))
    path = Ride(files[0], np.array(truth)).csv(tmp_path / "path.csv")
    lap = ["--apart", "52.3"]
    assert main([*map(str, files), "--truth", str(path), *lap, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["measures"]
    assert {name: each["found"] for name, each in told.items()} == pytest.approx(
        measures(optiodom_calibrated()), rel=1e-6
    )
