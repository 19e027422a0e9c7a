"""How far off the odometry ends: seeded simulated runs, and recorded robots.

The aims are those that ``tests/bench/odometry.py`` prints, over fewer runs.
"""

import math

import numpy as np
import pytest

from tests.diagnoser.rig import Rig
from tests.odometry.runs import (
    HUSKY,
    OPTIODOM,
    End,
    calibrated,
    husky,
    optiodom_calibrated,
    optiodom_end,
    optiodom_run,
    ride,
)
from tests.odometry.simulation import (
    BUS,
    GYRO,
    calibration_errors,
    differential_drive,
    steered_drive,
)
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.core import Odometer
from wackel_schemas import component
from wackel_schemas.drive import Odometry

RUNS = 3


@pytest.fixture(scope="module")
def uncalibrated() -> list[End]:
    """Runs with errors of 0.2° and 0.3 %."""
    ends = []
    for seed in range(RUNS):
        rng = np.random.default_rng(1000 + seed)
        ends.append(ride(steered_drive(4), calibration_errors(rng, 4), rng))
    return ends


def test_uncalibrated_drift_is_half_a_percent_at_most(uncalibrated: list[End]) -> None:
    assert np.median([end.drift for end in uncalibrated]) <= 0.005


def test_gates_hardly_ever_reject_a_healthy_wheel(uncalibrated: list[End]) -> None:
    assert np.mean([end.rejections for end in uncalibrated]) < 0.002


def test_calibrated_drift_is_a_fifth_of_a_percent_at_most() -> None:
    drifts = []
    for seed in range(RUNS):
        rng = np.random.default_rng(2000 + seed)
        config = steered_drive(4)
        errors = calibration_errors(rng, 4)
        found = calibrated(config, errors, rng)
        drifts.append(ride(found, errors, rng, true_config=config).drift)
    assert np.median(drifts) <= 0.002


def test_with_a_stuck_wheel_sensor_excluded_drift_is_half_a_percent_at_most() -> None:
    drifts = []
    for seed in range(RUNS):
        rng = np.random.default_rng(3000 + seed)
        errors = calibration_errors(rng, 4)
        excluded = [component.wheel_drive("w1")]
        end = ride(steered_drive(4), errors, rng, excluded=excluded, stuck=1)
        drifts.append(end.drift)
    assert np.median(drifts) <= 0.005


@pytest.mark.parametrize("drive", [steered_drive(3), steered_drive(4), differential_drive()])
@pytest.mark.parametrize(
    ("fault", "first", "value"),
    [("wheel_blocked", True, None), ("push", False, None), ("gyro_offset", False, 0.3)],
)
def test_neither_wheels_that_slip_together_nor_a_gyro_that_jumps_turns_the_heading(
    drive: DriveConfig, fault: str, *, first: bool, value: float | None
) -> None:
    rig = Rig.of("dd/1", drive, shown=False, course_s=60.0)
    odometer, off, valid = Odometer(rig.config, {GYRO: GyroConfig()}), [0.0], []
    for number in range(2000):
        if number == 1500:
            rig.inject(fault, drive.wheels[0].name if first else None, value)
        cycle = rig.cycle()
        if rig.exclusions is not None:
            odometer.exclusions(rig.exclusions)
        for message in (*odometer.bus_state(BUS, cycle.state), *odometer.imu(GYRO, cycle.imu)):
            if isinstance(message, Odometry) and number >= 1500:
                off.append(message.theta - cycle.pose[2])
                valid.append(message.valid)
    assert abs(math.remainder(off[-1] - off[1], math.tau)) < math.radians(5.0)
    assert np.mean(valid) > 0.9


@pytest.mark.skipif(not HUSKY.exists(), reason=f"no recorded robot at {HUSKY}")
def test_on_a_robot_that_skids_the_wheels_do_not_spoil_the_gyro() -> None:
    windows = husky(every=5)
    ratio = np.sqrt(np.mean(windows.fused**2) / np.mean(windows.gyro**2))
    assert ratio <= 1.2
    assert np.median(np.abs(windows.fused)) <= 1.2 * np.median(np.abs(windows.gyro))


@pytest.mark.skipif(not OPTIODOM.exists(), reason=f"no recorded robot at {OPTIODOM}")
def test_a_calibration_from_circles_holds_on_a_free_run() -> None:
    config = optiodom_calibrated()
    position, heading = optiodom_end(config, optiodom_run("free_030120210001_run-01"))
    assert position <= 0.019
    assert abs(heading) <= math.radians(5.7)
