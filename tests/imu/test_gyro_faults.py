"""Every fault of a gyro is seen on samples that come from a servo bus and from the kernel."""

import struct
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from tests.imu.tree import SCALE, SCAN
from tests.odometry.test_core import Ride
from tests.odometry.test_gyro_faults import codes, spoiled
from wackel_gateway.gyro import BusGyro
from wackel_imu.core import AXES, Decoder, Now, Scale
from wackel_imu.scan import Layout, element
from wackel_node.config_drive import GyroConfig, GyroRegister
from wackel_schemas.drive import ImuSample

Source = Callable[[ImuSample], ImuSample]

LATENCY_NS = 4_000_000
"""From taking a sample to reading it."""
LAYOUT = Layout(
    [
        *(element(name, str(i), "le:s16/16>>0") for i, name in enumerate(AXES)),
        element("in_timestamp", "3", "le:s64/64>>0"),
    ]
)


def kernel() -> Source:
    """As an LSM6DSL's driver gives it: steps of 8.75 mdps."""
    decoder = Decoder(LAYOUT, dict.fromkeys(AXES, Scale(SCALE)), 100.0)

    def pass_on(sample: ImuSample) -> ImuSample:
        raw = (round(rate / SCALE) for rate in sample.angular_velocity)
        now = Now(utc_ns=sample.stamp + LATENCY_NS, device_ns=77_000_000 + LATENCY_NS)
        (read,) = decoder.samples(SCAN.pack(*raw, 77_000_000), now)
        return read

    return pass_on


def opencr() -> Source:
    """As an OpenCR's registers hold it."""
    registers = {axis: GyroRegister(address=60 + 4 * i) for i, axis in enumerate("xyz")}
    gyro = BusGyro(GyroConfig(source="bus", bus="main", id=200, registers=registers))  # type: ignore[arg-type]
    return lambda sample: gyro.sample(
        struct.pack("<3f", *sample.angular_velocity), sample.stamp, 0.0
    )


@pytest.fixture(params=[kernel, opencr])
def source(request: pytest.FixtureRequest) -> Source:
    made: Source = request.param()
    return made


def shifted(seconds: float) -> Source:
    return lambda sample: replace(sample, stamp=sample.stamp + round(seconds * 1e9))


def test_a_healthy_gyro_is_not_blamed(source: Source) -> None:
    assert spoiled(source) == []


def test_frozen(source: Source) -> None:
    reports = spoiled(lambda s: source(replace(s, angular_velocity=(0.0, 0.0, 0.01))))
    assert ("gyro_frozen", "active") in codes(reports)


def test_saturated(source: Source) -> None:
    reports = spoiled(source, GyroConfig(saturation=1.1))
    assert codes(reports)[0] == ("gyro_saturated", "active")


def test_at_another_rate(source: Source) -> None:
    assert codes(spoiled(source, GyroConfig(rate=400.0))) == [("gyro_rate", "active")]


def test_biased(source: Source) -> None:
    ride = Ride(gyro=GyroConfig(bias_limit=0.02))
    for moment in ride.moments(6.0, 0.0, 0.0, 0.0):
        shown = moment.sample.angular_velocity[2] + 0.025
        moment.sample = source(replace(moment.sample, angular_velocity=(0.0, 0.0, shown)))
        ride.feed(moment)
    assert ride.codes() == [("gyro_bias", "active")]


@pytest.mark.parametrize("late_s", [0.04, -0.04])
def test_stamped_late_or_early(source: Source, late_s: float) -> None:
    reports = spoiled(source, late_s=late_s)
    assert codes(reports) == [("gyro_time_offset", "active")]


def test_silent() -> None:
    assert codes(spoiled(lambda _: None)) == [("gyro_silent", "active")]
