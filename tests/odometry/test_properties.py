"""Whatever comes in, what goes out are numbers, and time goes on."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.odometry.simulation import BUS, GYRO, START_NS, Robot, exact, steered_drive
from tests.odometry.test_core import statistics
from wackel_node.config_drive import GyroConfig
from wackel_odometry.core import Odometer
from wackel_schemas import wire
from wackel_schemas.bus import BusState, BusStatistics, ServoState
from wackel_schemas.drive import Exclusion, Exclusions, ImuSample, Odometry, OdometryRequest
from wackel_schemas.message import Message

MS = 1_000_000
NUMBER = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-10.0, 10.0),
    st.sampled_from([0.0, 1e300, -1e300, 1e8, 1e-300]),
)
STAMP = st.one_of(
    st.integers(0, 300).map(lambda ms: START_NS + ms * MS),
    st.integers(0, 300_000).map(lambda us: START_NS + us * 1000),
    st.integers(-(2**63), 2**64 - 1),
)
SERVO = st.builds(
    ServoState,
    id=st.sampled_from([0, 1, 2, 100, 101, 102, 55, -1]),
    position=st.none() | NUMBER,
    velocity=st.none() | NUMBER,
)
STATE = st.builds(BusState, stamp=STAMP, servos=st.lists(SERVO, max_size=6))
IMU = st.builds(ImuSample, stamp=STAMP, angular_velocity=st.tuples(NUMBER, NUMBER, NUMBER))
STATISTICS = st.builds(statistics, STAMP)
EXCLUDED = st.builds(
    Exclusion,
    component=st.sampled_from(
        ["wheel/w0/drive", "wheel/w1/steering", "gyro/body", "wheel/x/drive", ""]
    ),
    fault=st.sampled_from(["sensor", "actuator"]),
    reason=st.text(max_size=5),
)
EXCLUSIONS = st.builds(Exclusions, stamp=STAMP, excluded=st.lists(EXCLUDED, max_size=4))
REQUEST = st.builds(
    OdometryRequest,
    operation=st.sampled_from(["get", "reset", "set_pose"]),
    x=NUMBER,
    y=NUMBER,
    theta=NUMBER,
    position_sigma=NUMBER,
    heading_sigma=NUMBER,
)
ANYTHING = st.lists(STATE | IMU | STATISTICS | EXCLUSIONS | REQUEST, max_size=60)


def numbers_of(odometry: Odometry) -> list[float]:
    inputs = [each for one in odometry.inputs for each in (one.innovation, one.sigma)]
    slips = [each for one in odometry.slip for each in (one.along, one.across)]
    return [
        odometry.x,
        odometry.y,
        odometry.theta,
        odometry.vx,
        odometry.vy,
        odometry.omega,
        odometry.age_s,
        *odometry.pose_covariance,
        *odometry.twist_covariance,
        *(each for gyro in odometry.gyros for each in (gyro.bias, gyro.sigma)),
        *(each for each in (*inputs, *slips) if each is not None),
    ]


def feed(odometer: Odometer, messages: list[Message | OdometryRequest]) -> list[Message]:
    told: list[Message] = []
    for message in messages:
        match message:
            case BusState():
                told += odometer.bus_state(BUS, message)
            case ImuSample():
                told += odometer.imu(GYRO, message)
            case BusStatistics():
                told += odometer.bus_statistics(BUS, message)
            case Exclusions():
                odometer.exclusions(message)
            case OdometryRequest():
                told.append(odometer.request(message, 0))
    return told


@settings(max_examples=150, deadline=None)
@given(ANYTHING)
def test_out_of_anything_come_numbers(messages: list[Message | OdometryRequest]) -> None:
    told = feed(Odometer(steered_drive(3), {GYRO: GyroConfig()}), messages)
    for message in told:
        wire.decode(wire.encode(message), type(message))
        if isinstance(message, Odometry):
            assert all(math.isfinite(number) for number in numbers_of(message))


@settings(max_examples=15, deadline=None)
@given(ANYTHING)
def test_after_anything_the_odometry_works_again(
    messages: list[Message | OdometryRequest],
) -> None:
    odometer = Odometer(steered_drive(3), {GYRO: GyroConfig()})
    feed(odometer, messages)
    odometer.exclusions(Exclusions(stamp=0))
    robot = Robot(steered_drive(3), exact(3), np.random.default_rng(1))
    told: list[Message] = []
    for number, moment in enumerate(robot.drive(np.tile((0.3, 0.0, 0.2), (250, 1)))):
        if number == 150:
            odometer.request(OdometryRequest(operation="reset"), 0)
        told += odometer.bus_state(BUS, moment.state)
        told += odometer.imu(GYRO, moment.sample)
    latest = [message for message in told if isinstance(message, Odometry)][-1]
    assert latest.valid
    assert latest.vx == abs(latest.vx)
    assert abs(latest.vx - 0.3) < 0.05
    assert latest.x > 0.1
