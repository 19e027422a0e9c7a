"""Faults of a gyro, from messages to reports."""

import math
from collections.abc import Callable
from operator import itemgetter
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from tests.odometry.simulation import (
    BUS,
    GYRO,
    START_NS,
    Robot,
    calibration_errors,
    differential_drive,
    exact,
    random_path,
    steered_drive,
)
from tests.odometry.test_core import Ride, replace_errors
from wackel_drive.alignment import Step
from wackel_node.config_drive import GyroConfig
from wackel_odometry.core import RELEARN_S, Odometer
from wackel_odometry.gyro_watch import GyroWatch
from wackel_schemas import wire
from wackel_schemas.bus import BusState
from wackel_schemas.drive import ImuSample, Odometry
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message


def quiet_ride(gyro: GyroConfig | None = None, late_s: float = 0.0) -> Ride:
    """A robot as configured, whose gyro has the noise of a common one."""
    return Ride(errors=replace_errors(exact(4), noise_density=0.0002), gyro=gyro, late_s=late_s)


def spoiled(
    spoil: Callable[[ImuSample], ImuSample | None],
    gyro: GyroConfig | None = None,
    late_s: float = 0.0,
    turning: bool = True,
) -> list[FaultReport]:
    """What is reported of a gyro whose samples are changed after 2 s at rest."""
    ride = quiet_ride(gyro, late_s)
    ride.drive(2.0, 0.0, 0.0, 0.0)
    rates = (1.0, -1.0, 0.6, -0.8, 1.2, 0.2, 0.9, -0.5) if turning else (0.0,) * 8
    for rate in rates:
        for moment in ride.moments(0.5, 0.2 if turning else 0.0, 0.0, rate):
            ride.truth[moment.state.stamp] = moment.pose
            ride.take(ride.odometer.bus_state("main", moment.state))
            sample = spoil(moment.sample)
            if sample is not None:
                ride.take(ride.odometer.imu(GYRO, sample))
    assert all(report.component == f"gyro/{GYRO}" for report in ride.reports)
    return ride.reports


def codes(reports: list[FaultReport]) -> list[tuple[str, str]]:
    return [(report.code, report.status) for report in reports]


def test_a_healthy_gyro_is_not_blamed() -> None:
    assert spoiled(lambda sample: sample) == []


def test_a_value_that_stays_the_same_while_the_robot_turns_is_frozen() -> None:
    reports = spoiled(
        lambda sample: ImuSample(stamp=sample.stamp, angular_velocity=(0.0, 0.0, 0.01))
    )
    assert codes(reports) == [("gyro_frozen", "active")]


def test_a_value_that_stays_the_same_while_the_robot_rests_is_not() -> None:
    reports = spoiled(
        lambda sample: ImuSample(stamp=sample.stamp, angular_velocity=(0.0, 0.0, 0.0)),
        turning=False,
    )
    assert reports == []


@pytest.mark.parametrize("bias", [0.12, 0.15])
def test_a_quiet_gyro_whose_bias_is_learned_is_not_frozen(bias: float) -> None:
    """Steps so coarse that noise never reaches the next."""
    ride = quiet_ride(GyroConfig(bias_limit=0.2))
    for moment in ride.moments(5.0, 0.0, 0.0, 0.0):
        moment.sample.angular_velocity = (0.0, 0.0, bias)
        ride.feed(moment)
    assert ride.now.standing
    assert ride.reports == []


def test_a_gyro_at_its_limit_is_saturated() -> None:
    reports = spoiled(lambda sample: sample, GyroConfig(saturation=1.1))
    assert codes(reports)[0] == ("gyro_saturated", "active")
    assert ("gyro_saturated", "healed") in codes(reports)
    assert {report.code for report in reports} == {"gyro_saturated"}


def test_a_gyro_that_stays_at_its_limit_is_not_late() -> None:
    reports = spoiled(
        lambda sample: ImuSample(
            stamp=sample.stamp, angular_velocity=(0.0, 0.0, 1.0 + sample.angular_velocity[2] / 100)
        ),
        GyroConfig(saturation=1.0),
    )
    assert codes(reports) == [("gyro_saturated", "active")]


@pytest.mark.parametrize(("rate", "late_ms"), [(100, 25), (416, 6), (1000, 3)])
def test_a_gyro_at_its_limit_is_not_used_though_states_come_after_many_of_its_samples(
    rate: int, late_ms: int
) -> None:
    limit = 1.0
    config = GyroConfig(rate=rate, saturation=limit)
    odometer = Odometer(differential_drive(), {GYRO: config})
    robot = Robot(differential_drive(), exact(2), np.random.default_rng(3))
    twists = np.concatenate([np.zeros((100, 3)), np.tile((0.2, 0.0, 1.5), (200, 1))])
    moments = list(robot.drive(twists))
    noise = np.random.default_rng(4).normal(0.0, 1e-4, 3 * rate)
    come: list[tuple[int, BusState | ImuSample]] = [
        (moment.state.stamp + late_ms * 1_000_000, moment.state) for moment in moments
    ]
    for number, off in enumerate(noise.tolist()):
        stamp = START_NS + round(number / rate * 1e9)
        shown = limit if number / rate > 1.0 else 0.0
        come.append((stamp, ImuSample(stamp=stamp, angular_velocity=(0.0, 0.0, shown + off))))
    told: list[Message] = []
    for _, message in sorted(come, key=itemgetter(0)):
        if isinstance(message, BusState):
            told += odometer.bus_state(BUS, message)
        else:
            told += odometer.imu(GYRO, message)
    steps = [each for each in told if isinstance(each, Odometry)]
    turning = [each for each in steps if each.stamp > START_NS + 1_100_000_000]
    assert len(turning) > 150
    assert all(each.omega == pytest.approx(1.5, abs=0.05) for each in turning)
    reports = [each for each in told if isinstance(each, FaultReport)]
    assert codes(reports) == [("gyro_saturated", "active")]


def test_a_gyro_that_falls_silent_is_told() -> None:
    reports = spoiled(lambda sample: None)
    assert codes(reports) == [("gyro_silent", "active")]
    report = reports[0]
    assert report.message == "The gyro body sends nothing."


def test_a_gyro_that_goes_on_while_the_wheels_are_silent_is_not_blamed() -> None:
    ride = Ride()
    ride.drive(3.0, 0.2, 0.0, 0.5)
    for moment in ride.moments(3.0, 0.2, 0.0, 0.5):
        ride.take(ride.odometer.imu(GYRO, moment.sample))
    for moment in ride.moments(0.2, 0.2, 0.0, 0.5):  # its samples of this time are lost
        ride.take(ride.odometer.bus_state("main", moment.state))
    ride.drive(1.0, 0.2, 0.0, 0.5)
    assert {report.component for report in ride.reports} == {"odometry"}


def test_a_gyro_at_another_rate_is_told_with_both_rates() -> None:
    (report,) = spoiled(lambda sample: sample, GyroConfig(rate=400.0))
    assert report.message == "The gyro body sends 100 samples a second instead of 400."


@pytest.mark.parametrize(
    ("configured", "well_s", "needed"),
    [(100.0, 2.0, 100), (100.0, 0.0, 100), (3.0, 0.0, 33)],
    ids=["later", "from the start", "as configured"],
)
def test_a_gyro_far_too_slow_is_told_by_its_rate(
    configured: float, well_s: float, needed: int
) -> None:
    """Its samples are too far apart to cover a step."""
    ride = quiet_ride(GyroConfig(rate=configured))
    ride.drive(well_s, 0.0, 0.0, 0.0)
    for number, moment in enumerate(ride.moments(20.0, 0.2, 0.0, 0.5)):
        ride.take(ride.odometer.bus_state(BUS, moment.state))
        if number % 33 == 0:
            ride.take(ride.odometer.imu(GYRO, moment.sample))
    (report,) = ride.reports
    told = f"The gyro body sends 3 samples a second instead of {needed}."
    assert report.message == told


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"angular_velocity": (0.0, 0.0, math.nan)}, "bad_input"),
        ({"late_s": 0.003}, "late_answers"),
    ],
    ids=str,
)
def test_samples_that_are_refused_for_what_they_are_are_not_called_silent(
    wrong: dict[str, Any], code: str
) -> None:
    ride = quiet_ride()
    ride.drive(2.0, 0.0, 0.0, 0.0)
    for moment in ride.moments(4.0, 0.2, 0.0, 0.5):
        ride.take(ride.odometer.bus_state(BUS, moment.state))
        sent = wire.encode(replace(moment.sample, **wrong))
        ride.take(ride.odometer.imu(GYRO, wire.decode(sent, ImuSample)))
    assert ride.codes() == [(code, "active")]


def test_a_bias_beyond_the_data_sheet_is_told() -> None:
    ride = Ride(gyro=GyroConfig(bias_limit=0.02))
    for moment in ride.moments(6.0, 0.0, 0.0, 0.0):
        moment.sample.angular_velocity = (0.0, 0.0, 0.025 + moment.sample.angular_velocity[2])
        ride.feed(moment)
    assert ride.codes() == [("gyro_bias", "active")]
    assert "0.025 rad/s at rest" in ride.reports[0].message


@pytest.mark.parametrize("bias", [0.15, 0.5, 1.0])
def test_a_bias_far_beyond_the_data_sheet_from_power_on_is_learned_and_told(bias: float) -> None:
    ride = quiet_ride()
    for moment in ride.moments(RELEARN_S + 2.0, 0.0, 0.0, 0.0):
        moment.sample.angular_velocity = (0.0, 0.0, bias + moment.sample.angular_velocity[2])
        ride.feed(moment)
    assert ride.codes() == [("gyro_bias", "active")]
    assert ride.now.gyros[0].bias == pytest.approx(bias, abs=0.001)
    assert ride.now.standing


@pytest.mark.parametrize("late_s", [0.04, -0.04])
def test_stamps_that_are_off_are_found_from_how_the_robot_turns(late_s: float) -> None:
    (report,) = spoiled(lambda sample: sample, late_s=late_s)
    assert report.code == "gyro_time_offset"
    told = report.evidence.values["offset_s"]
    assert isinstance(told, float)
    assert told == pytest.approx(late_s, abs=0.012)


@pytest.mark.parametrize(("late", "batch", "told_ms"), [(4, 1, -40), (6, 1, -60), (0, 5, -40)])
def test_samples_that_come_too_late_are_told_with_how_late(
    late: int, batch: int, told_ms: int
) -> None:
    """Whether their stamps are wrong or they were held back cannot be told."""
    ride = quiet_ride()
    held: list[ImuSample] = []
    for rate in (0.0, 1.0, -1.0, 0.6, -0.8):
        for moment in ride.moments(0.5, 0.2, 0.0, rate):
            ride.take(ride.odometer.bus_state(BUS, moment.state))
            held.append(moment.sample)
            if len(held) >= late + batch:
                for sample in held[:batch]:
                    ride.take(ride.odometer.imu(GYRO, sample))
                del held[:batch]
    (report,) = ride.reports
    assert report.code == "gyro_time_offset"
    assert report.evidence.values["offset_s"] == pytest.approx(told_ms / 1e3, abs=0.011)


def test_stamps_that_are_off_are_told_until_the_robot_turns_and_they_are_not() -> None:
    turns = (1.0, -1.0, 0.6, -0.8, 1.2, 0.2, 0.9, -0.5)
    ride = quiet_ride(late_s=0.04)
    ride.drive(2.0, 0.0, 0.0, 0.0)
    for rate in turns:
        ride.drive(0.5, 0.2, 0.0, rate)
    ride.drive(200.0, 0.0, 0.0, 0.0)  # more than what was learned is remembered for
    assert ride.codes() == [("gyro_time_offset", "active")]
    for rate in 4 * turns:
        for moment in ride.moments(0.5, 0.2, 0.0, rate):
            moment.sample.stamp -= 40_000_000
            ride.feed(moment)
    assert ride.codes()[1:] == [("gyro_time_offset", "healed")]


def test_stamps_of_another_clock_are_told_as_such() -> None:
    hour_ns = 3600 * 10**9

    def later(sample: ImuSample) -> ImuSample:
        return ImuSample(stamp=sample.stamp + hour_ns, angular_velocity=sample.angular_velocity)

    reports = spoiled(later)
    assert codes(reports) == [("gyro_time_offset", "active")]
    assert reports[0].message == (
        "The stamps of the gyro body are +3600 s off those of the wheels."
    )


@pytest.mark.parametrize("seed", range(3))
def test_on_a_random_path_with_calibration_errors_nothing_is_blamed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ride = Ride(steered_drive(4), calibration_errors(rng, 4))
    for moment in ride.robot.drive(random_path(rng, 5.0)):
        ride.feed(moment)
    assert ride.reports == []
    assert math.isfinite(ride.now.x)


def watched(late_s: float, for_s: float) -> list[str]:
    """Complaints about a gyro whose robot turns to and fro while its wheels seem early by so much
    for some time, as those that drag one along may seem."""
    watch, found, step_ns = GyroWatch(GyroConfig()), [], 10_000_000
    for number in range(1200):
        seconds, end = number * 0.01, START_NS + (number + 1) * step_ns
        early = late_s if 6.0 <= seconds < 6.0 + for_s else 0.0
        wheels, gyro = math.sin(2.0 * (seconds + early)), math.sin(2.0 * seconds)
        watch.sample(end, (0.0, 0.0, gyro), gyro, sound=True, newest=end)
        step = Step(end - step_ns, end, 0.01, [], [], [], [gyro])
        watch.usable(step, gyro)
        watch.step(step, wheels, gyro, 0.0)
        found += watch.complaints(end, 0.0, 0.001)
    return sorted({complaint.code for complaint in found})


def test_stamps_that_seem_off_for_a_moment_are_not() -> None:
    assert watched(0.3, for_s=1.0) == []
    assert watched(0.3, for_s=6.0) == ["gyro_time_offset"]
