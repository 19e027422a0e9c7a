"""One sensor's angle over time."""

import copy
import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_drive.track import LONGEST_GAP_NS, MOST, TURN, Arrival, Track

MS = 1_000_000


def track_of(*samples: tuple[int, float | None, float | None]) -> Track:
    track = Track()
    for stamp, angle, rate in samples:
        track.add(stamp, angle, rate, done=-1)
    return track


def passed(track: Track, begin: int, end: int) -> tuple[float | None, float | None]:
    """Angle at the begin and angle turned; the track keeps what it had."""
    return copy.deepcopy(track).pass_by(begin, end)


def turned(track: Track, begin: int, end: int) -> float | None:
    return passed(track, begin, end)[1]


def test_the_first_reading_is_an_offset_and_not_a_motion() -> None:
    track = track_of((0, 1000.0, None))
    assert turned(track, 0, 10 * MS) is None
    track.add(10 * MS, 1000.25, None, done=0)
    assert turned(track, 0, 10 * MS) == pytest.approx(0.25)


def test_between_samples_the_angle_changes_evenly() -> None:
    track = track_of((0, 0.0, None), (10 * MS, 0.2, None), (20 * MS, 0.6, None))
    assert turned(track, 5 * MS, 15 * MS) == pytest.approx(0.1 + 0.2)
    assert passed(track, 15 * MS, 20 * MS)[0] == pytest.approx(0.4)


def test_nothing_is_told_of_times_that_no_sample_covers() -> None:
    track = track_of((10 * MS, 0.0, None), (20 * MS, 1.0, None))
    assert turned(track, 5 * MS, 15 * MS) is None
    assert turned(track, 15 * MS, 25 * MS) is None
    assert passed(track, 5 * MS, 20 * MS)[0] is None
    assert passed(Track(), 0, 10 * MS) == (None, None)


@pytest.mark.parametrize("counter", [TURN, 2**32 * TURN / 4096])
def test_a_counter_that_wraps_is_no_jump(counter: float) -> None:
    track = track_of((0, counter / 2 - 0.1, None), (10 * MS, -counter / 2 + 0.1, None))
    assert turned(track, 0, 10 * MS) == pytest.approx(0.2)


def test_a_servo_that_starts_anew_within_its_turn_is_no_jump() -> None:
    track = track_of((0, 7 * TURN + 1.0, None), (10 * MS, 1.1, None))
    assert turned(track, 0, 10 * MS) == pytest.approx(0.1)


def test_the_velocity_tells_how_many_turns_a_fast_wheel_made() -> None:
    rate = 100.0
    track = track_of((0, 0.0, rate), (100 * MS, math.remainder(10.0, TURN), rate))
    assert turned(track, 0, 100 * MS) == pytest.approx(10.0)


def test_without_positions_the_rate_is_summed_up() -> None:
    track = track_of((0, None, 1.0), (10 * MS, None, 3.0))
    assert turned(track, 0, 10 * MS) == pytest.approx(0.02)
    assert passed(track, 0, 10 * MS)[0] is None


def test_after_a_long_gap_nothing_is_assumed() -> None:
    track = track_of((0, 0.0, None), (LONGEST_GAP_NS + 1, 0.1, None))
    assert turned(track, 0, LONGEST_GAP_NS + 1) is None


def test_a_position_that_came_without_one_before_is_an_offset_again() -> None:
    track = track_of((0, None, None), (10 * MS, 5.0, None), (20 * MS, 5.5, None))
    assert turned(track, 0, 10 * MS) is None
    assert turned(track, 10 * MS, 20 * MS) == pytest.approx(0.5)


def test_each_way_of_arriving_has_its_outcome() -> None:
    track = Track()
    assert track.add(10 * MS, 0.0, None, done=0) == "kept"
    assert track.add(30 * MS, 0.3, None, done=0) == "kept"
    assert track.add(30 * MS, 9.9, None, done=0) == "repeated"
    assert track.add(20 * MS, 0.1, None, done=0) == "reordered"
    assert turned(track, 10 * MS, 20 * MS) == pytest.approx(0.1)
    assert track.add(15 * MS, 9.9, None, done=16 * MS) == "late"
    assert turned(track, 10 * MS, 30 * MS) == pytest.approx(0.3)


def test_what_no_step_takes_does_not_pile_up() -> None:
    track = Track()
    assert [track.add(i, 0.0, None, done=-1) for i in range(MOST)] == ["kept"] * MOST
    assert track.add(MOST, 0.0, None, done=-1) == "flood"
    track.forget(MOST - 1)
    assert track.add(MOST, 0.0, None, done=-1) == "kept"


def test_what_a_step_has_passed_makes_room() -> None:
    for end in (MOST - 1, MOST):  # covered by samples, and not
        track = track_of(*((i, 0.0, None) for i in range(MOST)))
        track.pass_by(0, end)
        assert track.add(MOST, 0.0, None, done=end) == "kept"


def test_forgetting_keeps_what_the_next_step_begins_with() -> None:
    track = track_of((0, 0.0, None), (10 * MS, 0.1, None), (20 * MS, 0.3, None))
    track.forget(15 * MS)
    assert turned(track, 15 * MS, 20 * MS) == pytest.approx(0.1)
    assert turned(track, 5 * MS, 20 * MS) is None


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=20),
    st.integers(0, 10**9),
    st.integers(0, 10**9),
)
def test_parts_add_up_to_the_whole_however_it_is_cut(
    changes: list[float], one: int, other: int
) -> None:
    angles = [sum(changes[:i]) for i in range(len(changes))]
    track = track_of(*((i * 10 * MS, angle % TURN, None) for i, angle in enumerate(angles)))
    end = (len(angles) - 1) * 10 * MS
    first, second = sorted((one * end // 10**9, other * end // 10**9))
    parts = 0.0
    for a, b in pairwise(sorted({0, first, second, end})):
        angle, part = track.pass_by(a, b)
        assert angle is not None and part is not None
        assert math.remainder(angle - parts, TURN) == pytest.approx(0.0, abs=1e-6)
        parts += part
    assert parts == pytest.approx(angles[-1], abs=1e-6)


class AllKept:
    """A track that drops nothing and works out everything anew when a step passes."""

    def __init__(self) -> None:
        self.samples: dict[int, tuple[float | None, float | None]] = {}
        self.done = 0
        self.needed = 0  # stamp of the first sample that a step after the last one needs

    def add(self, stamp: int, angle: float | None, rate: float | None) -> Arrival:
        if stamp in self.samples and stamp >= self.needed:
            return "repeated"
        newest = max(self.samples, default=-1)
        if stamp < newest and stamp <= self.done:
            return "late"
        self.samples[stamp] = angle, rate
        return "kept" if stamp > newest else "reordered"

    def pass_by(self, begin: int, end: int) -> tuple[float | None, float | None]:
        self.done = end
        stamps = sorted(self.samples)
        self.needed = max((stamp for stamp in stamps if stamp <= end), default=0)
        if not stamps or stamps[0] > begin or stamps[-1] < end:
            return None, None
        first = max(stamp for stamp in stamps if stamp <= begin)
        angle, turned = self.samples[first][0], 0.0
        for low, high in pairwise(stamps):
            if high <= begin or low >= end:
                continue
            part = self._between(low, high)
            if part is None:
                return None, None
            if angle is not None:
                angle += part * max(0, begin - low) / (high - low)
            turned += part * (min(high, end) - max(low, begin)) / (high - low)
        return angle, turned

    def _between(self, low: int, high: int) -> float | None:
        (angle, rate), (next_angle, next_rate) = self.samples[low], self.samples[high]
        if high - low > LONGEST_GAP_NS:
            return None
        told = None
        if rate is not None and next_rate is not None:
            told = (rate + next_rate) / 2 * (high - low) / 1e9
        if angle is None or next_angle is None:
            return told
        turns = round((next_angle - angle - (told or 0.0)) / TURN)
        return next_angle - angle - TURN * turns


def test_a_sample_that_no_step_has_dropped_is_repeated_however_late() -> None:
    track, kept = Track(), AllKept()
    assert track.pass_by(0, 5 * MS) == kept.pass_by(0, 5 * MS)
    for stamp, arrival in (0, "kept"), (5 * MS, "kept"), (0, "repeated"):
        assert track.add(stamp, 0.0, None, 5 * MS) == arrival == kept.add(stamp, 0.0, None)


@given(st.data())
def test_what_arrives_in_any_order_is_as_if_all_had_been_kept(data: st.DataObject) -> None:
    track, kept, done = Track(), AllKept(), 0
    values = st.none() | st.floats(-9.0, 9.0).map(lambda value: round(value, 3))
    for _ in range(data.draw(st.integers(1, 30))):
        if data.draw(st.integers(0, 2)):
            stamp = max(0, done + 5 * MS * data.draw(st.integers(-3, 9) | st.just(60)))
            angle, rate = data.draw(values), data.draw(values)
            assert track.add(stamp, angle, rate, done) == kept.add(stamp, angle, rate)
        else:
            begin, done = done, done + MS * data.draw(st.sampled_from([5, 7, 10, 20]))
            found, expected = track.pass_by(begin, done), kept.pass_by(begin, done)
            if expected[1] is None:
                assert found[1] is None
            else:
                assert found == pytest.approx(expected, abs=1e-9)
