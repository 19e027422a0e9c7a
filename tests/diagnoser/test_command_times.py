"""When commands came: fresh, old, overtaken, missing."""

import math

import pytest

from wackel_diagnoser.command_times import (
    DOUBTFUL_NS,
    FRESH_NS,
    LONGEST_NS,
    TURNING_RAD_S,
    CommandTimes,
)

STEP_NS, STEP_S = 10_000_000, 0.01
AT_REST = [0.0, 0.0]


def regular(count: int = 50) -> tuple[CommandTimes, int]:
    """Commands came once a step; and the stamp of the last."""
    times = CommandTimes([0, 1])
    for i in range(1, count + 1):
        assert not times.follow(i * STEP_NS)
        times.pass_to(i * STEP_NS)
    return times, count * STEP_NS


def test_a_command_drives_the_robot_until_it_is_old() -> None:
    times, latest = regular()
    assert times.is_known(latest, AT_REST, STEP_S)
    assert times.is_known(latest + FRESH_NS, AT_REST, STEP_S)
    assert not times.is_known(latest + FRESH_NS + 1, AT_REST, STEP_S)
    assert not times.is_known(latest - 1, AT_REST, STEP_S)
    assert not CommandTimes([0, 1]).is_known(latest, AT_REST, STEP_S)


def test_an_older_command_is_overtaken() -> None:
    times, latest = regular()
    assert times.is_overtaken(latest)
    assert times.is_overtaken(latest - 1)
    assert not times.is_overtaken(latest + 1)
    times.forget()
    assert not times.is_overtaken(1)


@pytest.mark.parametrize(
    ("interval", "missed"), [(STEP_NS, False), (STEP_NS * 14 // 10, False), (2 * STEP_NS, True)]
)
def test_an_interval_that_is_longer_than_usual_has_missed_one(interval: int, missed: bool) -> None:
    times, latest = regular()
    assert times.follow(latest + interval) is missed


def test_one_that_comes_after_its_time_is_late() -> None:
    times, latest = regular()
    times.pass_to(latest + STEP_NS)
    assert times.follow(latest + STEP_NS)


def test_doubt_lasts_until_no_wheel_turns() -> None:
    times, latest = regular()
    times.doubt(latest)
    turning = [0.0, 1.1 * TURNING_RAD_S * STEP_S]
    assert not times.is_known(latest + DOUBTFUL_NS - 1, AT_REST, STEP_S)
    assert not times.is_known(latest + DOUBTFUL_NS, turning, STEP_S)
    assert not times.is_known(latest + DOUBTFUL_NS, [0.0, math.nan], STEP_S)
    assert times.is_known(latest + DOUBTFUL_NS, AT_REST, STEP_S)
    assert times.is_known(latest + DOUBTFUL_NS, turning, STEP_S)  # it does not come back


def test_doubt_does_not_last_for_ever() -> None:
    times, latest = regular()
    times.doubt(latest)
    late = latest + LONGEST_NS
    times.follow(late)
    assert times.is_known(late, [math.nan] * 2, STEP_S)
