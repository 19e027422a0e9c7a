"""Samples with their own stamps become steps that share them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import astuple

from wackel_drive.alignment import AHEAD_NS, TO_RESTART, WAIT_NS, Alignment, Step
from wackel_drive.layout import Layout
from wackel_node.config_drive import DriveConfig, GyroConfig, WheelConfig
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.drive import ImuSample

MS = 1_000_000
START = 1_700_000_000_000_000_000
RATE = 2.0  # rad/s of every wheel unless stated


def drive(*buses: str) -> DriveConfig:
    """Two wheels; left servo 1 and right servo 2, each on its bus."""
    left, right = buses or ("main", "main")
    return DriveConfig(
        kind="differential",
        wheels=[
            WheelConfig(name="left", x=0.0, y=0.2, radius=0.05, bus=left, drive=1),
            WheelConfig(name="right", x=0.0, y=-0.2, radius=0.05, bus=right, drive=2),
        ],
    )


def alignment(config: DriveConfig | None = None, gyro: bool = False) -> Alignment:
    gyros = {"body": GyroConfig(axis="-z")} if gyro else {}
    return Alignment(Layout(config or drive()), gyros)


def state(ms: float, *ids: int, rate: float = RATE) -> BusState:
    """Positions of wheels that turn evenly."""
    return BusState(
        stamp=START + round(ms * MS),
        servos=[ServoState(id=i, position=rate * ms / 1e3 % (2 * math.pi)) for i in ids or (1, 2)],
    )


def imu(ms: float, rate: float) -> ImuSample:
    return ImuSample(stamp=START + round(ms * MS), angular_velocity=(9.0, 9.0, rate))


def steps(aligned: Alignment) -> list[Step]:
    found = []
    while (step := aligned.step()) is not None:
        found.append(step)
    return found


def ends(found: list[Step]) -> list[float]:
    return [(step.end - START) / MS for step in found]


def test_each_state_of_all_wheels_ends_a_step_at_once() -> None:
    aligned = alignment()
    for ms in (0, 10, 20):
        aligned.bus_state("main", state(ms))
    found = steps(aligned)
    assert ends(found) == [10, 20]
    for step in found:
        assert step.seconds == pytest.approx(0.01)
        assert step.wheel_rate == pytest.approx([RATE, RATE])


def test_states_at_100_hz_end_a_step_each_in_spite_of_jitter() -> None:
    aligned = alignment()
    stamps = [0, 12.9, 20, 29, 41.4, 48.6, 60]
    for ms in stamps:
        aligned.bus_state("main", state(ms))
    found = steps(aligned)
    assert ends(found) == stamps[1:]
    for step in found:
        assert step.wheel_rate == pytest.approx([RATE, RATE])


def test_states_at_200_hz_end_a_step_every_other_time_and_are_all_counted_in() -> None:
    aligned = alignment()
    for ms in range(0, 65, 5):
        aligned.bus_state("main", state(ms))
    found = steps(aligned)
    assert ends(found) == [10, 20, 30, 40, 50, 60]
    for step in found:
        assert step.wheel_rate == pytest.approx([RATE, RATE])


def test_a_step_waits_for_the_gyro_and_takes_its_mean_over_the_step() -> None:
    aligned = alignment(gyro=True)
    aligned.gyro("body", imu(-3, 0.0))
    aligned.bus_state("main", state(0))
    aligned.bus_state("main", state(10))
    aligned.gyro("body", imu(2, 0.0))
    assert steps(aligned) == []
    aligned.gyro("body", imu(12, -1.0))
    (step,) = steps(aligned)
    # The sensor's z points down. Between 2 and 12 ms it goes from 0 to 1 rad/s.
    assert step.gyro_rate == pytest.approx([0.5 * 0.8])


def test_two_buses_that_read_at_different_times_share_steps() -> None:
    aligned = alignment(drive("front", "rear"))
    for ms in range(0, 60, 10):
        aligned.bus_state("front", state(ms, 1))
        aligned.bus_state("rear", state(ms + 4, 2))
    found = steps(aligned)
    assert ends(found) == [10, 20, 30, 40, 50]
    for step in found[1:]:
        assert step.wheel_rate == pytest.approx([RATE, RATE])


def test_speeds_in_states_of_their_own_do_not_come_between_positions() -> None:
    """A control may read both in turn, each in an instruction of its own."""
    aligned = alignment()
    for ms in range(0, 500, 10):
        speeds = [ServoState(id=i, velocity=9.0) for i in (1, 2)]
        if ms < 200:
            aligned.bus_state("main", state(ms))
        aligned.bus_state("main", BusState(stamp=START + (ms + 1) * MS, servos=speeds))
    found = steps(aligned)
    assert ends(found)[:19] == [*range(10, 200, 10)]
    assert np.array([step.wheel_rate for step in found[:19]]) == pytest.approx(RATE)
    # Without positions they are what there is, though none leads there from the last position.
    assert np.isnan(found[19].wheel_rate).all()
    assert found[-1].wheel_rate == pytest.approx([9.0, 9.0])


def test_an_answer_that_was_lost_once_is_made_up_for_by_the_next() -> None:
    aligned = alignment()
    aligned.bus_state("main", state(0))
    aligned.bus_state("main", state(10, 1))
    assert steps(aligned) == []
    aligned.bus_state("main", state(20))
    found = steps(aligned)
    assert ends(found) == [10, 20]
    assert found[0].wheel_rate == pytest.approx([RATE, RATE])


def test_a_servo_that_stays_away_is_waited_for_once() -> None:
    aligned = alignment()
    aligned.bus_state("main", state(0))
    waited = []
    for ms in range(10, 100, 10):
        aligned.bus_state("main", state(ms, 1))
        waited.append(len(steps(aligned)))
    assert waited == [0, 0, 0, 4, 1, 1, 1, 1, 1][: len(waited)]
    aligned.bus_state("main", state(100))
    aligned.bus_state("main", state(110))
    step = steps(aligned)[-1]
    assert step.wheel_rate == pytest.approx([RATE, RATE])


def test_without_the_first_wheel_the_next_one_sets_the_pace() -> None:
    aligned = alignment()
    aligned.bus_state("main", state(0))
    for ms in range(10, 100, 10):
        aligned.bus_state("main", state(ms, 2))
    found = steps(aligned)
    assert found
    assert np.isnan(found[-1].wheel_rate[0])
    assert found[-1].wheel_rate[1] == pytest.approx(RATE)


def test_a_gap_costs_one_step_without_wheels() -> None:
    aligned = alignment()
    for ms in (0, 10, 610, 620):
        aligned.bus_state("main", state(ms))
    found = steps(aligned)
    assert ends(found) == [10, 610, 620]
    assert np.isnan(found[1].wheel_rate).all()
    assert found[2].wheel_rate == pytest.approx([RATE, RATE])


def test_background_reads_end_no_step() -> None:
    aligned = alignment()
    aligned.bus_state("main", state(0))
    warm = BusState(stamp=START + 5 * MS, servos=[ServoState(id=1, temperature=40.0)])
    aligned.bus_state("main", warm)
    aligned.bus_state("other", state(6))
    aligned.bus_state("main", state(10))
    assert ends(steps(aligned)) == [10]


def test_late_repeated_and_reordered_states_are_counted_and_spoil_nothing() -> None:
    aligned = alignment()
    for ms in (0, 10, 10, 30, 20, 15, 40):
        aligned.bus_state("main", state(ms))
    aligned.bus_state("main", state(50))
    found = steps(aligned)
    aligned.bus_state("main", state(45, rate=77.0))
    assert steps(aligned) == []
    for step in found:
        assert step.wheel_rate == pytest.approx([RATE, RATE])
    assert aligned.counts["bus/main/servo/1", "repeated"] == 1
    assert aligned.counts["bus/main/servo/1", "reordered"] == 2
    assert aligned.counts["bus/main/servo/1", "late"] == 1


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
def test_a_value_that_cannot_be_is_refused_with_its_source(value: float) -> None:
    aligned = alignment(gyro=True)
    aligned.bus_state("main", state(0))
    bad = BusState(
        stamp=START + 10 * MS,
        servos=[ServoState(id=1, position=value), ServoState(id=2, position=0.02)],
    )
    aligned.bus_state("main", bad)
    assert aligned.gyro("body", imu(5, value)) is None
    assert aligned.refused == [
        ("bus/main/servo/1", "implausible"),
        ("gyro/body", "implausible"),
    ]


@pytest.mark.parametrize("late_s", [0.005, 1e9, math.inf, math.nan])
def test_a_state_of_doubtful_time_is_left_out(late_s: float) -> None:
    aligned = alignment()
    aligned.bus_state("main", state(0))
    moved_on = state(14)
    moved_on.stamp, moved_on.late_s = state(10).stamp, late_s
    aligned.bus_state("main", moved_on)
    aligned.bus_state("main", state(20))
    (step,) = steps(aligned)
    assert ends([step]) == [20]
    assert step.wheel_rate == pytest.approx([RATE, RATE])
    assert aligned.refused == [("bus/main", "uncertain")]


def test_wheels_that_were_asked_again_are_left_out_and_nobody_is_blamed() -> None:
    aligned = alignment()
    again = state(10)
    again.asked_again = True
    moved_on = again.servos[1]
    assert moved_on.position is not None
    moved_on.position += RATE * 0.0015  # it answers so much later where all answer one by one
    for each in (state(0), again, state(20)):
        aligned.bus_state("main", each)
    (step,) = steps(aligned)
    assert ends([step]) == [20]
    assert step.wheel_rate == pytest.approx([RATE, RATE])
    assert (aligned.refused, aligned.counts) == ([], {("bus/main", "asked_again"): 1})


@pytest.mark.parametrize("late_s", [0.005, 1e9, math.inf, math.nan])
def test_a_gyro_sample_of_doubtful_time_is_left_out(late_s: float) -> None:
    aligned = alignment(gyro=True)
    doubtful = imu(5, 3.0)
    doubtful.late_s = late_s
    aligned.gyro("body", imu(0, -1.0))
    aligned.bus_state("main", state(0))
    assert aligned.gyro("body", doubtful) is None
    aligned.gyro("body", imu(10, -1.0))
    aligned.bus_state("main", state(10))
    (step,) = steps(aligned)
    assert step.gyro_rate == pytest.approx([1.0])
    assert aligned.refused == [("gyro/body", "uncertain")]


def test_one_stamp_of_the_future_is_refused_and_time_goes_on() -> None:
    aligned = alignment()
    aligned.bus_state("main", state(0))
    aligned.bus_state("main", state(10**7))
    aligned.bus_state("main", state(10))
    assert ends(steps(aligned)) == [10]
    assert aligned.refused == [("bus/main", "ahead")]
    assert aligned.restarts == 0


@pytest.mark.parametrize("jump_ms", [-3_600_000, 5_000, 3_600_000])
def test_a_clock_that_was_set_is_followed_once_several_states_agree(jump_ms: int) -> None:
    aligned = alignment(gyro=True)
    aligned.bus_state("main", state(0))
    aligned.bus_state("main", state(10))
    for i in range(TO_RESTART + 2):
        aligned.bus_state("main", state(jump_ms + 10 * i))
    assert aligned.restarts == 1
    assert ends(steps(aligned)) == [jump_ms + 10 * (TO_RESTART + i) for i in range(2)]


def test_a_stamp_that_repeats_itself_is_not_followed() -> None:
    aligned = alignment()
    aligned.bus_state("main", state(0))
    for _ in range(3 * TO_RESTART):
        aligned.bus_state("main", state(3_600_000))
    assert aligned.restarts == 0


@pytest.mark.parametrize("right_ms", [0, 1, -1, -9])
def test_two_buses_follow_a_clock_that_was_set_in_whatever_order_they_tell(right_ms: int) -> None:
    """Stamps are of when the gateway asks, and it tells once all have answered."""
    aligned = alignment(drive("a", "b"))
    for i in range(3 * TO_RESTART):
        jump_ms = 5_000 if i > 1 else 0
        aligned.bus_state("a", state(10 * i + jump_ms, 1))
        aligned.bus_state("b", state(10 * i + jump_ms + right_ms, 2))
    assert aligned.restarts == 1
    assert steps(aligned)[-1].wheel_rate == pytest.approx([RATE, RATE])


def test_states_that_come_twice_follow_a_clock_that_was_set() -> None:
    aligned = alignment()
    for i in range(3 * TO_RESTART):
        for _ in range(2):
            aligned.bus_state("main", state(10 * i + (5_000 if i > 1 else 0)))
    assert aligned.restarts == 1
    assert ends(steps(aligned))[-1] == 10 * (3 * TO_RESTART - 1) + 5_000


@pytest.mark.parametrize("off_ms", [-3_600_000, 3_600_000])
def test_a_gyro_that_was_wrong_before_the_wheels_were_heard_is_used_once_it_is_right(
    off_ms: int,
) -> None:
    aligned = alignment(gyro=True)
    aligned.gyro("body", imu(off_ms, 1.0))
    for ms in range(0, 60, 10):
        aligned.gyro("body", imu(ms, 1.0))
        aligned.bus_state("main", state(ms))
    assert aligned.newest == START + 50 * MS
    assert steps(aligned)[-1].gyro_rate == pytest.approx([-1.0])


def test_a_gyro_with_another_clock_does_not_stop_the_steps() -> None:
    aligned = alignment(gyro=True)
    found = []
    for ms in range(0, 200, 10):
        aligned.bus_state("main", state(ms))
        aligned.gyro("body", imu(ms + 2 * AHEAD_NS / MS, 1.0))
        found += steps(aligned)
    assert ends(found)[-1] == 190
    assert np.isnan(found[-1].gyro_rate).all()


def test_a_gyro_that_was_never_heard_is_not_waited_for() -> None:
    aligned = alignment(gyro=True)
    aligned.bus_state("main", state(0))
    aligned.bus_state("main", state(10))
    assert ends(steps(aligned)) == [10]


def test_an_unknown_gyro_is_refused() -> None:
    with pytest.raises(KeyError):
        alignment().gyro("body", imu(0, 0.0))


def test_steering_is_told_in_the_middle_of_the_step() -> None:
    wheels = [
        WheelConfig(
            name=f"w{i}",
            l=0.3,
            alpha=2.0 * i,
            radius=0.05,
            bus="main",
            drive=i,
            steering=10 + i,
            steering_direction=-1,
            steering_offset=0.5,
        )
        for i in range(3)
    ]
    aligned = alignment(DriveConfig(kind="steered", wheels=wheels))
    for ms, angle in ((0, 0.0), (10, 0.2)):
        servos = [ServoState(id=i + part, position=angle) for i in range(3) for part in (0, 10)]
        aligned.bus_state("main", BusState(stamp=START + ms * MS, servos=servos))
    (step,) = steps(aligned)
    assert step.heading == pytest.approx([0.4] * 3)
    assert step.steered == pytest.approx([-0.2] * 3)


@settings(max_examples=40)
@given(st.lists(st.integers(0, WAIT_NS // MS // 2 - 1), min_size=30, max_size=30))
def test_the_order_of_arrival_does_not_matter(delays: list[int]) -> None:
    """As long as each sensor's own samples come in order, and not later than is waited for."""

    def run(arrivals: list[tuple[float, int]]) -> list[Step]:
        aligned, found = alignment(gyro=True), []
        aligned.gyro("body", imu(-3, 0.5))
        aligned.bus_state("main", state(0))
        for _, k in sorted(arrivals):
            if k % 2:
                aligned.gyro("body", imu(5 * k - 3, math.sin(k)))
            else:
                aligned.bus_state("main", state(5 * k))
            found += steps(aligned)
        return found

    prompt = run([(5 * k, k) for k in range(1, 31)])
    latest = [0, 0]
    arrivals = []
    for k in range(1, 31):
        latest[k % 2] = max(latest[k % 2], 5 * k + delays[k - 1])
        arrivals.append((latest[k % 2], k))
    delayed = run(arrivals)
    for one, other in zip(prompt, delayed, strict=False):
        assert (one.begin, one.end) == (other.begin, other.end)
        np.testing.assert_array_equal(one.wheel_rate, other.wheel_rate)
        np.testing.assert_array_equal(one.gyro_rate, other.gyro_rate)
    assert abs(len(prompt) - len(delayed)) <= 1


@settings(max_examples=40)
@given(st.lists(st.lists(st.sampled_from([1, 2]), unique=True), min_size=12, max_size=12))
def test_servos_of_one_state_are_as_if_each_had_a_state_of_its_own(heard: list[list[int]]) -> None:
    together, apart = alignment(), alignment()
    for k, ids in enumerate([[1, 2], *heard, *[[1, 2]] * 4]):
        at_once = state(10 * k, 1, 2, rate=RATE + k)
        at_once.servos = [servo for servo in at_once.servos if servo.id in ids]
        together.bus_state("main", at_once)
        for servo in at_once.servos:
            apart.bus_state("main", BusState(stamp=at_once.stamp, servos=[servo]))
    ones, others = steps(together), steps(apart)
    assert together.counts == apart.counts
    assert ends(ones) == ends(others) != []
    for one, other in zip(ones, others, strict=True):
        for mine, same in zip(astuple(one)[2:], astuple(other)[2:], strict=True):
            np.testing.assert_array_equal(mine, same)
