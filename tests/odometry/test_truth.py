"""The true path from a table, and runs of recorded wheels beside it."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.odometry.simulation import (
    BUS,
    START_NS,
    Robot,
    differential_drive,
    exact,
    steered_drive,
)
from wackel_odometry.calibration import misses
from wackel_odometry.recorded_runs import recorded_runs
from wackel_odometry.truth import CLOSE_NS, MARK_NS, NoTruth, Truth
from wackel_schemas.bus import BusState

DRIVE = differential_drive()


def table(*rows: tuple[object, ...], heading: str = "time,x,y,theta") -> list[str]:
    return [heading, *(",".join(map(str, row)) for row in rows)]


def moments(*seconds: float) -> np.ndarray:
    return np.array([round(each * 1e9) for each in seconds])


def test_between_close_poses_the_robot_moves_evenly() -> None:
    truth = Truth.parse(table((10.0, 0, 0, 3.1), (10.1, 0.2, 0.4, -3.1), (10.2, 0.4, 0.4, -3.1)))
    (pose,) = truth.at(moments(10.05))
    turn = 2 * math.pi - 6.2
    assert pose == pytest.approx([0.1, 0.2, 3.1 + turn / 2])


def test_before_after_and_in_gaps_the_pose_is_not_known() -> None:
    truth = Truth.parse(table(*((t, 0, 0, 0) for t in (10.0, 10.1, 12.0, 12.1))))
    known = np.isfinite(truth.at(moments(9.99, 10.05, 11.0, 12.05, 12.11))).all(axis=1)
    assert known.tolist() == [False, True, False, True, False]


def test_times_are_as_exact_as_a_float_is() -> None:
    # With a gap, so that each of its ends is the last moment or the first that is known.
    stamps = [START_NS + number * 50_000_000 + 1 for number in (*range(50), *range(100, 150))]
    truth = Truth.parse(
        table(*((stamp / 1e9, number, 0, 0) for number, stamp in enumerate(stamps)))
    )
    found = truth.at(np.array(stamps))
    assert found[:, 0] == pytest.approx(np.arange(100), abs=1e-4)


def test_a_pose_far_from_all_others_is_a_mark_of_the_step_that_ends_there() -> None:
    truth = Truth.parse(table((10.0, 1, 2, 0.5), (20.0, 3, 4, 0)))
    near = MARK_NS / 1e9 * 0.9
    found = truth.at(moments(9.0, 10.0 + near, 15.0, 20.0 - near, 20.0 + 2 * near))
    assert found[1] == pytest.approx([1, 2, 0.5])
    assert found[3] == pytest.approx([3, 4, 0])
    assert not np.isfinite(found[[0, 2, 4]]).any()


def test_a_mark_at_which_the_wheels_were_not_heard_is_none_of_the_run() -> None:
    truth = Truth.parse(table((10.0, 1, 2, 0.5), (20.0, 3, 4, 0)))
    assert not np.isfinite(truth.at(moments(20.1, 20.2))).any()


def test_columns_are_found_by_name_in_any_order_with_others_between() -> None:
    truth = Truth.parse(
        table((1, "a", 0.3, 2, 10), (2, "b", 0.4, 3, 11), heading="x,note,THETA, y ,time")
    )
    assert truth.poses.tolist() == [[1, 2, 0.3], [2, 3, 0.4]]
    assert truth.stamps.tolist() == [10**10, 11 * 10**9]


@pytest.mark.parametrize("gone", ["11,nan,0,0", "11,,0,0", "11,0,0", "11,0,0,lost", "inf,0,0,0"])
def test_a_line_without_a_pose_is_counted(gone: str) -> None:
    truth = Truth.parse([*table((10, 0, 0, 0)), gone, "", "12,0,0,0"])
    assert truth.unseen == 1
    assert len(truth.stamps) == 2


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ([], "columns time, x, y, theta; time and x and y and theta are missing"),
        (["time,x,y"], "theta is missing"),
        (table(), "needs 2 poses at least, and has 0"),
        (table((1, 0, 0, 0)), "needs 2 poses at least, and has 1"),
        (table((1, 0, 0, 0), (1, 0, 0, 0)), "line 3: its time is not after"),
        (table((1, 0, 0, 0), (START_NS, 0, 0, 0)), "line 3: 1.7e\\+18 is no time in seconds"),
        (table((-1, 0, 0, 0), (1, 0, 0, 0)), "line 2: -1 is no time"),
        (table((1, 0, 0, 0), (2, 0, -1e300, 0)), "line 3: no pose in m and rad is beyond"),
    ],
)
def test_what_is_no_path_is_refused_with_the_reason(lines: list[str], why: str) -> None:
    with pytest.raises(NoTruth, match=why):
        Truth.parse(lines)


numbers = st.floats() | st.text(max_size=5) | st.integers(-5, 50)


@given(st.lists(st.tuples(numbers, numbers, numbers, numbers), max_size=8), st.binary(max_size=30))
def test_any_table_is_read_or_refused(rows: list[tuple[object, ...]], more: bytes) -> None:
    lines = [*table(*rows), *more.decode("latin-1").splitlines(keepends=True)]
    try:
        truth = Truth.parse(lines)
    except NoTruth:
        return
    assert (np.diff(truth.stamps) > 0).all()
    assert np.isfinite(truth.poses).all()
    found = truth.at(np.arange(0, 50 * 10**9, CLOSE_NS // 3))
    assert (np.isfinite(found).all(axis=1) | np.isnan(found).all(axis=1)).all()


def driven(lost: range) -> Iterator[tuple[BusState, np.ndarray]]:
    """Ten seconds in an arc; for some cycles one servo says nothing."""
    twists = np.tile([0.3, 0.0, 0.4], (1000, 1))
    robot = Robot(DRIVE, exact(2), np.random.default_rng(1))
    for number, moment in enumerate(robot.drive(twists)):
        if number in lost:
            del moment.state.servos[0]
        yield moment.state, moment.pose


@pytest.mark.parametrize(
    ("lost", "pieces"),
    [(range(0), 1), (range(500, 501), 1), (range(500, 540), 2)],
    ids=["all heard", "one answer lost", "silent for 0.4 s"],
)
def test_a_run_is_as_long_as_all_wheels_are_heard(lost: range, pieces: int) -> None:
    path = list(driven(lost))
    truth = Truth(np.array([s.stamp for s, _ in path]), np.array([pose for _, pose in path]))
    runs = list(recorded_runs(DRIVE, ((BUS, state) for state, _ in path), truth))
    assert len(runs) == pieces
    for run, begin, end in runs:
        assert run.sound()
        # A lost answer is made up for by the next, in a step twice as long.
        assert (end - begin) / 1e7 - len(run.rolled) == pytest.approx(len(lost) % 40, abs=0.1)
        assert np.abs(misses(DRIVE, run, 100)).max() < 0.003


def test_the_offset_of_a_steering_is_left_to_the_calibration() -> None:
    drive = steered_drive(3)
    turned = replace(drive, wheels=[replace(wheel, steering_offset=0.2) for wheel in drive.wheels])
    states = [
        moment.state
        for moment in Robot(drive, exact(3), np.random.default_rng(1)).drive(np.ones((50, 3)))
    ]
    truth = Truth(np.array([0, 1]), np.zeros((2, 3)))
    plain, other = (
        next(recorded_runs(config, ((BUS, state) for state in states), truth)).run
        for config in (drive, turned)
    )
    assert other.heading == pytest.approx(plain.heading)
