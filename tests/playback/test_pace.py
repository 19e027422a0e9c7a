"""When a recorded message is due."""

import pytest

from wackel_playback.pace import FASTEST, SLOWEST, Pace, timed
from wackel_playback.service import is_played
from wackel_recording.reader import Entry


def test_a_message_is_due_at_its_recorded_time() -> None:
    pace = Pace(100.0)
    assert pace.wait_s(2.5, 100.0) == pytest.approx(2.5)
    assert pace.wait_s(2.5, 102.0) == pytest.approx(0.5)


def test_a_late_message_delays_none_behind_it() -> None:
    pace = Pace(100.0)
    assert pace.wait_s(1.0, 103.0) == pytest.approx(-2.0)
    assert pace.wait_s(4.0, 103.0) == pytest.approx(1.0)


def test_double_speed_halves_what_is_left() -> None:
    pace = Pace(100.0)
    pace.scale(2.0, 104.0)
    assert pace.wait_s(10.0, 104.0) == pytest.approx(3.0)
    pace.scale(0.5, 105.0)  # now at 6 recorded seconds
    assert pace.wait_s(10.0, 105.0) == pytest.approx(4.0)


def test_recorded_time_stands_still_in_a_pause() -> None:
    pace = Pace(100.0)
    pace.toggle(101.0)
    assert pace.wait_s(1.5, 150.0) == float("inf")
    pace.scale(2.0, 160.0)
    pace.toggle(200.0)
    assert pace.wait_s(2.0, 200.0) == pytest.approx(0.5)


def test_playback_can_begin_with_a_pause() -> None:
    pace = Pace(100.0, paused=True)
    pace.toggle(110.0)
    assert pace.wait_s(1.0, 110.0) == pytest.approx(1.0)


def test_speed_stays_within_its_limits() -> None:
    pace = Pace(0.0)
    for _ in range(50):
        pace.scale(2.0, 0.0)
    assert pace.speed == FASTEST
    for _ in range(50):
        pace.scale(0.5, 0.0)
    assert pace.speed == SLOWEST


def recording(*seconds: float, start_s: float = 1e9) -> list[Entry]:
    return [Entry("bus/main/state", int((start_s + s) * 1e9), 0, b"") for s in seconds]


def times(*recordings: list[Entry], from_s: float = 0.0, to_s: float = float("inf")) -> list[float]:
    return [at_s for at_s, _ in timed(recordings, from_s, to_s)]


def test_time_begins_with_the_first_message() -> None:
    assert times(recording(0, 1, 2.5)) == [0, 1, 2.5]


def test_the_years_between_two_recordings_are_left_out() -> None:
    assert times(recording(0, 1), recording(0, 2, start_s=2e9)) == [0, 1, 1, 3]


def test_only_what_lies_between_from_and_to_is_played_at_once() -> None:
    assert times(recording(0, 1, 2, 3, 4), from_s=1.5, to_s=3.5) == [0.5, 1.5]


def test_a_clock_that_ran_backwards_stops_nothing() -> None:
    assert times(recording(0, 5, 1, 6)) == [0, 5, 5, 6]


@pytest.mark.parametrize(
    ("key", "usually", "with_derived"),
    [
        ("bus/main/transaction", True, True),
        ("bus/left_arm/state", True, True),
        ("fault/classifier", False, True),
        ("health", False, True),
        ("alive/gateway/main", False, False),
        ("camera/front", False, True),
    ],
)
def test_inputs_are_played_conclusions_on_request_and_signs_of_life_never(
    key: str, usually: bool, with_derived: bool
) -> None:
    assert is_played(key, False) is usually
    assert is_played(key, True) is with_derived
