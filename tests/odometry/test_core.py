"""The odometry of one robot, from messages."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from tests.odometry.simulation import (
    BUS,
    GYRO,
    START_NS,
    Errors,
    Moment,
    Robot,
    calibration_errors,
    differential_drive,
    exact,
    random_path,
    steered_drive,
)
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.core import RELEARN_S, Odometer
from wackel_schemas import component, wire
from wackel_schemas.bus import BusStatistics
from wackel_schemas.drive import Exclusion, Exclusions, ImuSample, Odometry, OdometryRequest
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message

SECOND = 1_000_000_000


def statistics(stamp: int) -> BusStatistics:
    return BusStatistics(stamp=stamp, mode="poll", port="p", connected=False, baud_rate=1_000_000)


class Ride:
    """A robot and its odometry."""

    def __init__(
        self,
        config: DriveConfig | None = None,
        errors: Errors | None = None,
        gyro: GyroConfig | None = None,
        late_s: float = 0.0,
    ) -> None:
        config = config or steered_drive(4)
        gyro = gyro or GyroConfig()
        self.robot = Robot(
            config,
            errors or exact(len(config.wheels)),
            np.random.default_rng(3),
            gyro_late_s=late_s,
        )
        self.odometer = Odometer(config, {GYRO: gyro})
        self.told: list[Odometry] = []
        self.reports: list[FaultReport] = []
        self.truth: dict[int, Floats] = {}

    def take(self, messages: list[Message]) -> None:
        for message in messages:
            if isinstance(message, Odometry):
                self.told.append(message)
            elif isinstance(message, FaultReport):
                self.reports.append(message)

    def feed(self, moment: Moment) -> None:
        self.truth[moment.state.stamp] = moment.pose
        self.take(self.odometer.bus_state(BUS, moment.state))
        self.take(self.odometer.imu(GYRO, moment.sample))

    def drive(self, seconds: float, *twist: float) -> None:
        for moment in self.moments(seconds, *twist):
            self.feed(moment)

    def moments(self, seconds: float, *twist: float) -> list[Moment]:
        return list(self.robot.drive(np.tile(np.array(twist), (round(seconds * 100), 1))))

    @property
    def now(self) -> Odometry:
        return self.told[-1]

    def off(self) -> tuple[float, float]:
        """Errors of position, m, and heading, rad."""
        x, y, theta = self.truth[self.now.stamp]
        turn = math.remainder(self.now.theta - theta, math.tau)
        return math.hypot(self.now.x - x, self.now.y - y), abs(turn)

    @property
    def robot_ns(self) -> int:
        """The robot's time."""
        return max(self.truth, default=START_NS)

    def beat(self, stamp: int) -> None:
        """The gateway tells the statistics of the bus."""
        self.take(self.odometer.bus_statistics(BUS, statistics(stamp)))

    def codes(self) -> list[tuple[str, str]]:
        return [(report.code, report.status) for report in self.reports]

    def result(self, name: str) -> str:
        return next(each.result for each in self.now.inputs if each.name == name)


def test_a_robot_as_configured_is_followed_within_its_noise() -> None:
    ride = Ride()
    ride.drive(1.0, 0.0, 0.0, 0.0)
    ride.drive(6.0, 0.4, 0.1, 0.5)
    position, heading = ride.off()
    assert position < 0.005
    assert heading < 0.003
    assert ride.now.valid
    assert ride.now.vx == pytest.approx(0.4, abs=0.005)
    assert ride.now.omega == pytest.approx(0.5, abs=0.005)
    assert ride.reports == []
    assert {each.result for each in ride.now.inputs} == {"used"}


def test_the_first_reading_is_an_offset() -> None:
    ride = Ride()
    ride.drive(0.03, 0.0, 0.0, 0.0)
    assert (ride.now.x, ride.now.y, ride.now.theta) == pytest.approx((0, 0, 0), abs=1e-6)


def test_the_bias_of_the_gyro_is_learned_at_rest_and_kept_while_driving() -> None:
    ride = Ride(errors=replace_errors(exact(4), bias=0.05, noise_density=0.0002))
    ride.drive(2.0, 0.0, 0.0, 0.0)
    (gyro,) = ride.now.gyros
    assert ride.now.standing
    assert gyro.bias == pytest.approx(0.05, abs=4 * gyro.sigma)
    assert gyro.sigma < 0.0005
    before = gyro.bias
    ride.drive(5.0, 0.3, 0.0, 1.0)
    assert not ride.now.standing
    assert ride.now.gyros[0].bias == before


def test_a_robot_that_is_turned_by_hand_teaches_the_bias_nothing() -> None:
    """The wheels are off the floor and still; the gyro feels it."""
    ride = Ride()
    ride.drive(2.0, 0.0, 0.0, 0.0)
    before = ride.now.gyros[0].bias
    for moment in ride.moments(RELEARN_S / 2, 0.0, 0.0, 0.0):
        moment.sample.angular_velocity = (0.0, 0.0, 0.5)
        ride.feed(moment)
    assert not ride.now.standing
    assert ride.now.gyros[0].bias == pytest.approx(before, abs=1e-6)


def test_a_bias_that_jumps_is_learned_anew_after_some_seconds_of_rest() -> None:
    ride = Ride(gyro=GyroConfig(bias_limit=0.1))
    ride.drive(2.0, 0.0, 0.0, 0.0)
    for moment in ride.moments(RELEARN_S + 2.0, 0.0, 0.0, 0.0):
        moment.sample.angular_velocity = (0.0, 0.0, 0.08)
        ride.feed(moment)
    assert ride.now.gyros[0].bias == pytest.approx(0.08, abs=0.002)
    assert ride.now.standing


def test_a_wheel_that_suddenly_spins_is_rejected_counted_and_shown_as_slip() -> None:
    ride = Ride()
    ride.drive(1.0, 0.4, 0.0, 0.3)
    spun = 0.0
    for moment in ride.moments(0.5, 0.4, 0.0, 0.3):
        spun += 0.1
        servo = next(each for each in moment.state.servos if each.id == 2)
        servo.position = (servo.position or 0.0) + spun
        servo.velocity = (servo.velocity or 0.0) + 10.0
        ride.feed(moment)
    assert ride.result("wheel/w2/roll") == "rejected"
    rejected = next(each for each in ride.now.inputs if each.name == "wheel/w2/roll")
    assert rejected.rejections > 40
    assert rejected.innovation == pytest.approx(0.5, abs=0.05)
    slip = next(each for each in ride.now.slip if each.name == "w2")
    assert slip.along == pytest.approx(0.5, abs=0.05)
    assert ride.off()[0] < 0.01


def test_an_exclusion_holds_from_the_next_step_and_is_taken_back() -> None:
    ride = Ride()
    ride.drive(0.5, 0.4, 0.0, 0.0)
    drive = Exclusion(component=component.wheel_drive("w1"), fault="sensor", reason="stuck")
    steering = Exclusion(
        component=component.wheel_steering("w3"), fault="actuator", reason="blocked"
    )
    stranger = Exclusion(component="wheel/w9/drive", fault="sensor", reason="?")
    ride.odometer.exclusions(Exclusions(stamp=0, excluded=[drive, steering, stranger]))
    ride.drive(0.05, 0.4, 0.0, 0.0)
    assert ride.now.excluded == [drive, steering]
    assert ride.result("wheel/w1/roll") == "excluded"
    assert ride.result("wheel/w1/slide") == "used"
    assert ride.result("wheel/w3/roll") == ride.result("wheel/w3/slide") == "excluded"
    ride.odometer.exclusions(Exclusions(stamp=0))
    ride.drive(0.05, 0.4, 0.0, 0.0)
    assert {each.result for each in ride.now.inputs} == {"used"}


def test_an_excluded_gyro_is_not_used() -> None:
    ride = Ride()
    gyro = Exclusion(component=component.gyro(GYRO), fault="sensor", reason="drifts")
    ride.odometer.exclusions(Exclusions(stamp=0, excluded=[gyro]))
    for moment in ride.moments(1.0, 0.4, 0.0, 0.3):
        moment.sample.angular_velocity = (0.0, 0.0, 3.0)
        ride.feed(moment)
    assert ride.result(component.gyro(GYRO)) == "excluded"
    assert ride.off()[1] < 0.01


def test_an_actuator_fault_makes_the_other_wheels_less_certain() -> None:
    sigmas = {}
    for fault in ("sensor", "actuator"):
        ride = Ride()
        one = Exclusion(component=component.wheel_drive("w0"), fault=fault, reason="")  # type: ignore[arg-type]
        ride.odometer.exclusions(Exclusions(stamp=0, excluded=[one]))
        ride.drive(2.0, 0.4, 0.0, 0.0)
        sigmas[fault] = math.sqrt(ride.now.pose_covariance[0])
    assert sigmas["actuator"] > 5 * sigmas["sensor"]


def test_with_most_wheels_excluded_the_twist_is_unknown_and_the_reason_told() -> None:
    ride = Ride()
    ride.drive(0.5, 0.4, 0.0, 0.0)
    all_wheels = [
        Exclusion(component=component.wheel_steering(f"w{i}"), fault="sensor", reason="")
        for i in range(4)
    ]
    ride.odometer.exclusions(Exclusions(stamp=0, excluded=all_wheels))
    ride.drive(1.0, 0.4, 0.0, 0.0)
    assert not ride.now.valid
    assert ride.now.reason == "too few inputs: excluded wheel/w0, wheel/w1, wheel/w2, wheel/w3"
    assert ("pose_unknown", "active") in ride.codes()
    ride.odometer.exclusions(Exclusions(stamp=0))
    ride.drive(0.5, 0.4, 0.0, 0.0)
    assert ride.now.valid
    assert ride.codes()[-1] == ("pose_unknown", "healed")


def test_what_is_missing_is_told_by_wheels_or_where_only_one_row_is_by_that() -> None:
    ride = Ride()
    ride.drive(0.5, 0.4, 0.0, 0.0)
    faulty = [component.wheel_steering("w0"), component.wheel_drive("w1"), component.gyro(GYRO)]
    faulty += [component.wheel_steering("w2"), component.wheel_steering("w3")]
    excluded = [Exclusion(component=each, fault="sensor", reason="") for each in faulty]
    ride.odometer.exclusions(Exclusions(stamp=0, excluded=excluded))
    ride.drive(1.0, 0.4, 0.0, 0.0)
    assert ride.now.reason == (
        "too few inputs: excluded wheel/w0, wheel/w2, wheel/w3, wheel/w1/roll, gyro/body"
    )


def test_a_request_moves_the_pose_and_keeps_twist_and_bias() -> None:
    ride = Ride(errors=replace_errors(exact(4), bias=0.02))
    ride.drive(1.0, 0.0, 0.0, 0.0)
    ride.drive(1.0, 0.4, 0.0, 0.3)
    before = ride.now
    asked = OdometryRequest(
        operation="set_pose", x=1.0, y=2.0, theta=3.0, position_sigma=0.1, heading_sigma=0.2
    )
    reply = ride.odometer.request(asked, stamp=7)
    assert reply.ok
    assert reply.odometry is not None
    assert (reply.odometry.x, reply.odometry.y, reply.odometry.theta) == (1.0, 2.0, 3.0)
    assert np.diag(np.reshape(reply.odometry.pose_covariance, (3, 3))) == pytest.approx(
        [0.01, 0.01, 0.04]
    )
    assert (reply.odometry.vx, reply.odometry.omega) == (before.vx, before.omega)
    assert reply.odometry.gyros == before.gyros
    reply = ride.odometer.request(OdometryRequest(operation="reset"), stamp=8)
    assert reply.odometry is not None
    assert (reply.odometry.x, reply.odometry.y, reply.odometry.theta) == (0.0, 0.0, 0.0)
    assert reply.odometry.pose_covariance == [0.0] * 9


@pytest.mark.parametrize(
    "asked",
    [
        OdometryRequest(operation="set_pose", x=math.nan),
        OdometryRequest(operation="set_pose", theta=math.inf),
        OdometryRequest(operation="set_pose", y=1e300),
        OdometryRequest(operation="set_pose", position_sigma=-1.0),
        OdometryRequest(operation="set_pose", heading_sigma=math.nan),
    ],
)
def test_a_pose_that_is_none_is_refused(asked: OdometryRequest) -> None:
    ride = Ride()
    ride.drive(0.5, 0.4, 0.0, 0.0)
    reply = ride.odometer.request(asked, stamp=7)
    assert not reply.ok
    assert "numbers" in reply.text
    ride.drive(0.1, 0.4, 0.0, 0.0)
    assert ride.off()[0] < 0.01


def test_before_the_first_step_there_is_nothing_to_get() -> None:
    reply = Ride().odometer.request(OdometryRequest(), stamp=1)
    assert (reply.ok, reply.odometry) == (True, None)


def test_while_the_wheels_are_silent_the_gyro_tells_that_nothing_is_known() -> None:
    ride = Ride()
    ride.drive(1.0, 0.4, 0.0, 0.0)
    for moment in ride.moments(0.8, 0.4, 0.0, 0.0):
        ride.take(ride.odometer.imu(GYRO, moment.sample))
    assert not ride.now.valid
    assert ride.now.reason.startswith("the wheels have said nothing for 0.")
    assert ride.now.age_s > 0.6
    assert ride.codes() == [("pose_unknown", "active")]
    assert ride.reports[0].message == (
        "Odometry cannot tell where the robot is: the wheels say nothing."
    )
    ride.drive(1.0, 0.4, 0.0, 0.0)
    assert ride.now.valid
    assert ride.codes()[-1] == ("pose_unknown", "healed")


def test_where_no_gyro_goes_on_the_time_of_the_bus_tells_that_nothing_is_known() -> None:
    ride = Ride()
    for _ in range(3):
        ride.drive(1.0, 0.4, 0.0, 0.0)
        ride.beat(ride.robot_ns)
    assert ride.now.valid
    ride.drive(0.2, 0.4, 0.0, 0.0)
    told = len(ride.told)
    ride.beat(ride.robot_ns + 800_000_000)
    assert len(ride.told) == told + 1
    assert not ride.now.valid
    assert ride.now.reason == "the wheels have said nothing for 0.8 s"
    assert ride.codes() == [("pose_unknown", "active")]
    ride.drive(1.0, 0.4, 0.0, 0.0)
    assert ride.now.valid
    assert ride.codes()[-1] == ("pose_unknown", "healed")


def test_a_bus_that_is_silent_from_the_start_is_told() -> None:
    ride = Ride()
    for second in range(3):
        ride.beat(ride.robot_ns + second * SECOND)
    assert (ride.codes(), ride.told) == ([("pose_unknown", "active")], [])
    ride.moments(3.0, 0.0, 0.0, 0.0)
    ride.drive(1.0, 0.4, 0.0, 0.0)
    assert ride.codes()[-1] == ("pose_unknown", "healed")
    assert ride.now.valid


def test_a_bus_that_moves_no_wheel_tells_nothing() -> None:
    ride = Ride()
    for second in range(3):
        ride.take(ride.odometer.bus_statistics("arm", statistics(second * SECOND)))
    assert ride.reports == []


def test_a_gyro_that_is_back_after_a_second_tells_that_the_wheels_are_not() -> None:
    ride = Ride()
    ride.drive(1.0, 0.4, 0.0, 0.0)
    ride.moments(1.5, 0.4, 0.0, 0.0)
    for moment in ride.moments(1.0, 0.4, 0.0, 0.0):
        ride.take(ride.odometer.imu(GYRO, moment.sample))
    assert not ride.now.valid
    assert ride.now.age_s > 2.0
    assert ride.codes() == [("pose_unknown", "active")]


@pytest.mark.parametrize("shown", [0.01, 100.0])
def test_a_gyro_of_no_use_still_tells_that_the_wheels_are_silent(shown: float) -> None:
    """One that is frozen or at its limit."""
    ride = Ride()
    for rate in (0.0, 1.0, -1.0, 1.0):
        for moment in ride.moments(1.0, 0.2, 0.0, rate):
            moment.sample.angular_velocity = (0.0, 0.0, shown)
            ride.feed(moment)
    for moment in ride.moments(1.0, 0.2, 0.0, 0.0):
        moment.sample.angular_velocity = (0.0, 0.0, shown)
        ride.take(ride.odometer.imu(GYRO, moment.sample))
    assert ride.codes()[-1] == ("pose_unknown", "active")
    assert not ride.now.valid


def test_a_gyro_whose_clock_was_always_wrong_does_not_tell_how_long_the_wheels_are_silent() -> None:
    ride = Ride(late_s=3600.0)
    ride.drive(1.0, 0.4, 0.0, 0.0)
    for moment in ride.moments(1.0, 0.4, 0.0, 0.0):
        ride.take(ride.odometer.imu(GYRO, moment.sample))
    assert {report.component for report in ride.reports} == {"gyro/body"}


def test_clocks_that_are_set_do_not_make_wheels_silent() -> None:
    """Each process takes over a clock that was set when it looks, within half a second."""
    ride = Ride()
    ride.drive(0.5, 0.4, 0.0, 0.0)
    ride.beat(ride.robot_ns)
    for moment in ride.moments(2.5, 0.4, 0.0, 0.0):
        ride.take(ride.odometer.bus_state(BUS, moment.state))
        moment.sample.stamp += 3600 * SECOND
        for later_ms in range(10):
            sample = replace(moment.sample, stamp=moment.sample.stamp + later_ms * 1_000_000)
            ride.take(ride.odometer.imu(GYRO, sample))
    ride.beat(ride.robot_ns + 3600 * SECOND)
    assert ride.now.valid
    assert {report.component for report in ride.reports} == {"gyro/body"}


def test_who_asks_after_a_minute_of_silence_is_told_so() -> None:
    ride = Ride()
    ride.drive(1.0, 0.4, 0.0, 0.0)
    minute_later = ride.now.stamp + 60 * SECOND

    reply = ride.odometer.request(OdometryRequest(), minute_later)
    assert reply.odometry is not None
    assert not reply.odometry.valid
    assert reply.odometry.reason == "the wheels have said nothing for 60.0 s"
    assert reply.odometry.age_s == 60.0

    # In a playback that is as fast as the robot was.
    reply = ride.odometer.request(OdometryRequest(), minute_later, ride.now.stamp + 50_000_000)
    assert reply.stamp == minute_later
    assert reply.odometry is not None
    assert reply.odometry.valid
    assert reply.odometry.age_s == 0.05


def test_after_a_long_gap_the_pose_is_as_uncertain_as_the_robot_was_free_to_move() -> None:
    ride = Ride()
    ride.drive(1.0, 0.0, 0.0, 0.0)
    ride.moments(10.0, 0.0, 0.0, 0.0)
    ride.drive(0.5, 0.0, 0.0, 0.0)
    assert ride.now.restarts == 1
    assert math.sqrt(ride.now.pose_covariance[0]) == pytest.approx(5.0, rel=0.05)
    assert not ride.now.valid
    assert ride.now.reason == "time went on by 10.1 s at once; the robot may have moved unseen"
    ride.drive(1.5, 0.0, 0.0, 0.0)
    assert ride.now.valid
    assert ride.codes() == [("pose_unknown", "active"), ("pose_unknown", "healed")]


def test_a_clock_that_is_set_back_is_told_until_the_pose_is_set() -> None:
    ride = Ride()
    ride.drive(1.0, 0.2, 0.0, 0.0)
    hour_ns = 3600 * SECOND
    for moment in ride.moments(0.3, 0.2, 0.0, 0.0):
        moment.state.stamp -= hour_ns
        moment.sample.stamp -= hour_ns
        ride.feed(moment)
    assert ride.now.reason.startswith("time went back by 3599.9 s at once")
    assert ride.reports[-1].code == "pose_unknown"
    reply = ride.odometer.request(OdometryRequest(operation="reset"), ride.now.stamp)
    assert reply.odometry is not None
    assert reply.odometry.valid
    for moment in ride.moments(0.3, 0.2, 0.0, 0.0):
        moment.state.stamp -= hour_ns
        ride.take(ride.odometer.bus_state(BUS, moment.state))
    assert ride.now.valid
    assert ride.codes()[-1] == ("pose_unknown", "healed")


def test_wheels_that_fall_silent_while_the_clock_is_set_back_are_told() -> None:
    ride = Ride()
    ride.drive(1.0, 0.2, 0.0, 0.0)
    back = ride.now.stamp - 3600 * SECOND
    for second in range(3):
        ride.beat(back + second * SECOND)
    assert ride.now.reason == "the wheels have said nothing since the clock was set back"
    assert ride.codes() == [("pose_unknown", "active")]
    reply = ride.odometer.request(OdometryRequest(), back)
    assert reply.odometry is not None
    assert not reply.odometry.valid


def test_a_gyro_that_is_not_believed_does_not_keep_the_robot_from_standing() -> None:
    config = differential_drive()
    odometer = Odometer(config, {"good": GyroConfig(), "noisy": GyroConfig()})
    noisy = Exclusion(component="gyro/noisy", fault="sensor", reason="noise")
    odometer.exclusions(Exclusions(stamp=START_NS, excluded=[noisy]))
    random = np.random.default_rng(1)
    told: list[Message] = []
    for moment in Robot(config, exact(2), random).drive(np.zeros((200, 3))):
        told += odometer.bus_state(BUS, moment.state)
        for name, rate in (("good", 0.03), ("noisy", random.normal(0.0, 0.5))):
            sample = ImuSample(stamp=moment.sample.stamp, angular_velocity=(0.0, 0.0, rate))
            told += odometer.imu(name, sample)
    now = told[-1]
    assert isinstance(now, Odometry)
    assert now.standing
    assert now.gyros[0].bias == pytest.approx(0.03, abs=0.001)


def test_rests_on_what_turns_the_robot_do_not_add_up_to_a_bias() -> None:
    ride = Ride(differential_drive(), replace_errors(exact(2), noise_density=0.0002))
    ride.drive(3.0, 0.0, 0.0, 0.0)
    for _ in range(2 * math.ceil(RELEARN_S)):
        ride.drive(1.0, 0.3, 0.0, 0.0)
        for moment in ride.moments(1.0, 0.0, 0.0, 0.0):
            moment.sample.angular_velocity = (0.0, 0.0, 0.3 + moment.sample.angular_velocity[2])
            ride.feed(moment)
    assert ride.now.gyros[0].bias == pytest.approx(0.0, abs=0.001)
    assert ride.reports == []


@pytest.mark.parametrize(("every", "told"), [(90, False), (5, True)])
def test_only_more_repeated_samples_than_a_busy_computer_causes_are_told(
    every: int, told: bool
) -> None:
    ride = Ride()
    for number, moment in enumerate(ride.moments(20.0, 0.2, 0.0, 0.1)):
        ride.feed(moment)
        if number % every == 0:
            ride.take(ride.odometer.imu(GYRO, moment.sample))
    assert ride.codes() == ([("bad_input", "active")] if told else [])


@pytest.mark.parametrize("silent_s", [(0.0, 1.5), (1.0, 1.9)], ids=["at first", "later"])
def test_a_fast_gyro_is_not_blamed_for_samples_that_wait_for_silent_wheels(
    silent_s: tuple[float, float],
) -> None:
    """In 0.9 s one of 1660 Hz takes more than are kept for a step."""
    ride = Ride(gyro=GyroConfig(rate=1660.0))
    begin, end = silent_s
    for number, moment in enumerate(ride.moments(3.0, 0.2, 0.0, 0.0)):
        if not begin <= number / 100 < end:
            ride.take(ride.odometer.bus_state(BUS, moment.state))
        for part in range(16 + number % 2):
            stamp = moment.sample.stamp + part * 600_000
            ride.take(ride.odometer.imu(GYRO, replace(moment.sample, stamp=stamp)))
    assert ride.now.valid
    assert {report.component for report in ride.reports} <= {"odometry"}


def test_a_flood_of_samples_is_told() -> None:
    ride = Ride()
    ride.drive(0.5, 0.2, 0.0, 0.0)
    sample = ride.moments(0.01, 0.2, 0.0, 0.0)[0].sample
    for number in range(2000):
        stamp = sample.stamp + number * 1000
        ride.take(ride.odometer.imu(GYRO, replace(sample, stamp=stamp)))
    assert ride.codes() == [("bad_input", "active")]
    assert "more samples than it can have taken" in ride.reports[0].message


def test_a_servo_that_does_not_answer_is_missing_and_the_rest_goes_on() -> None:
    ride = Ride()
    ride.drive(1.0, 0.4, 0.0, 0.3)
    for moment in ride.moments(1.0, 0.4, 0.0, 0.3):
        moment.state.servos = [each for each in moment.state.servos if each.id not in (1, 101)]
        ride.feed(moment)
    assert ride.result("wheel/w1/roll") == ride.result("wheel/w1/slide") == "missing"
    slip = next(each for each in ride.now.slip if each.name == "w1")
    assert (slip.along, slip.across) == (None, None)
    assert ride.now.valid
    assert ride.off()[0] < 0.01


def test_a_sample_of_an_unknown_sensor_is_ignored() -> None:
    sample = ImuSample(stamp=1, angular_velocity=(0.0, 0.0, 1.0))
    assert Ride().odometer.imu("stranger", sample) == []


def test_without_a_gyro_the_wheels_do() -> None:
    config = differential_drive()
    robot = Robot(config, exact(2), np.random.default_rng(1))
    odometer = Odometer(config, {})
    told: list[Message] = []
    rest, ride = np.zeros((50, 3)), np.tile((0.3, 0.0, 0.4), (300, 1))
    for moment in robot.drive(np.concatenate([rest, ride])):
        told += odometer.bus_state(BUS, moment.state)
    latest = told[-1]
    assert isinstance(latest, Odometry)
    assert (latest.x, latest.y) == pytest.approx(tuple(robot.pose[:2]), abs=0.005)
    assert latest.gyros == []


def test_the_same_messages_give_the_same_bytes() -> None:
    def run() -> list[bytes]:
        rng = np.random.default_rng(5)
        config = steered_drive(3)
        robot = Robot(config, calibration_errors(rng, 3), rng)
        odometer = Odometer(config, {GYRO: GyroConfig()})
        messages: list[Message] = []
        for moment in robot.drive(random_path(rng, 1.0)):
            messages += odometer.imu(GYRO, moment.sample)
            messages += odometer.bus_state(BUS, moment.state)
        return [wire.encode(message) for message in messages]

    assert run() == run()


def test_values_that_cannot_be_are_reported_and_the_pose_goes_on() -> None:
    ride = Ride()
    ride.drive(1.0, 0.4, 0.0, 0.0)
    moment = ride.moments(0.01, 0.4, 0.0, 0.0)[0]
    moment.state.servos[0].position = math.nan
    ride.feed(moment)
    (report,) = ride.reports
    assert (report.code, report.component) == ("bad_input", "bus/main/servo/0")
    assert "no numbers" in report.message
    ride.drive(2.0, 0.4, 0.0, 0.0)
    assert ride.codes()[-1] == ("bad_input", "healed")
    assert ride.now.discarded == {"bus/main/servo/0: implausible": 1}
    assert ride.off()[0] < 0.01


@pytest.mark.parametrize(("every", "told"), [(20, False), (5, True)])
def test_answers_that_often_come_late_are_told_and_their_publisher_is_not_blamed(
    every: int, told: bool
) -> None:
    """More of them than a busy computer causes."""
    ride = Ride()
    for number, moment in enumerate(ride.moments(5.0, 0.4, 0.0, 0.0)):
        moment.state.late_s = 0.0 if number % every else 0.005
        ride.feed(moment)
    assert ride.codes() == ([("late_answers", "active")] if told else [])
    ride.drive(3.0, 0.4, 0.0, 0.0)
    assert ride.codes()[1:] == ([("late_answers", "healed")] if told else [])
    assert ride.now.discarded == {"bus/main: uncertain": 500 // every}


def test_a_sample_that_cannot_be_is_told_beside_answers_that_come_late() -> None:
    ride = Ride()
    for number, moment in enumerate(ride.moments(2.0, 0.4, 0.0, 0.0)):
        moment.sample.late_s = 0.0 if number % 3 else 0.005
        if number == 100:
            moment.sample.angular_velocity = (0.0, 0.0, math.nan)
        ride.feed(moment)
    assert {report.code for report in ride.reports} == {"late_answers", "bad_input"}
    assert {report.component for report in ride.reports} == {component.gyro(GYRO)}


def test_active_faults_can_be_told_again() -> None:
    ride = Ride()
    ride.drive(0.5, 0.4, 0.0, 0.0)
    sample = ImuSample(stamp=ride.now.stamp, angular_velocity=(math.nan, 0.0, 0.0))
    ride.take(ride.odometer.imu(GYRO, sample))
    assert [report.code for report in ride.odometer.active()] == ["bad_input"]


def replace_errors(errors: Errors, **changes: float) -> Errors:
    return Errors(
        errors.radius,
        errors.direction,
        **{"bias": errors.bias, "noise_density": errors.noise_density, **changes},
    )


def test_a_pose_stays_a_pose_however_the_robot_is_told_to_be() -> None:
    """The published heading is within half a turn, whatever was set."""
    ride = Ride()
    ride.drive(0.5, 0.4, 0.0, 0.0)
    asked = OdometryRequest(operation="set_pose", theta=1000.0)
    reply = ride.odometer.request(asked, stamp=ride.now.stamp)
    assert reply.odometry is not None
    assert abs(reply.odometry.theta) <= math.pi
    assert replace(reply.odometry, theta=0.0).valid
