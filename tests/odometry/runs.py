"""Whole runs through the odometry, and how far off it ends: shared by tests and measurements."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from tests.odometry.simulation import (
    BUS,
    GYRO,
    START_NS,
    Errors,
    Robot,
    differential_drive,
    random_path,
)
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.calibration import Run, calibrate
from wackel_odometry.core import Odometer
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.drive import Exclusion, Exclusions, ImuSample, Odometry

DATA = Path(__file__).parents[2].parent / "shared" / "data"
HUSKY = DATA / "husky_skid_steer" / "husky.csv"
OPTIODOM = DATA / "optiodom_diff"


@dataclass(frozen=True)
class End:
    """How a run ended.

    Attributes:
        drift: Error of position by distance driven.
        heading: Error, rad.
        nees: Normalised square of the error of the pose; 3 on average if the covariance is true.
        rejections: How often a gate rejected an input, by the steps.
        odometry: The last.
    """

    drift: float
    heading: float
    nees: float
    rejections: float
    odometry: Odometry


def ride(
    config: DriveConfig,
    errors: Errors,
    rng: np.random.Generator,
    *,
    true_config: DriveConfig | None = None,
    excluded: Collection[str] = (),
    stuck: int | None = None,
) -> End:
    """A random path of 17 m.

    Args:
        config: As the odometry has it.
        errors: Of the true robot against ``true_config``, by default ``config``.
        rng: For path and noise.
        true_config: As the robot's control has it.
        excluded: Components of which only the sensor is faulty.
        stuck: Servo whose position and velocity stay as at the start.
    """
    length_m = 17.0
    robot = Robot(true_config or config, errors, rng)
    odometer = Odometer(config, {GYRO: GyroConfig()})
    odometer.exclusions(
        Exclusions(
            stamp=0,
            excluded=[Exclusion(component=c, fault="sensor", reason="") for c in excluded],
        )
    )
    truth, steps, last = {}, 0, None
    for moment in robot.drive(random_path(rng, length_m)):
        truth[moment.state.stamp] = moment.pose
        for servo in moment.state.servos:
            if servo.id == stuck:
                servo.position, servo.velocity = 0.0, 0.0
        messages = odometer.bus_state(BUS, moment.state) + odometer.imu(GYRO, moment.sample)
        for message in messages:
            if isinstance(message, Odometry):
                last = message
                steps += 1
    if last is None:
        raise RuntimeError("no step was made")
    off = np.array([last.x, last.y, last.theta]) - truth[last.stamp]
    off[2] = math.remainder(off[2], math.tau)
    covariance = np.reshape(last.pose_covariance, (3, 3))
    return End(
        float(np.hypot(off[0], off[1])) / length_m,
        float(off[2]),
        float(off @ np.linalg.solve(covariance, off)),
        sum(each.rejections for each in last.inputs) / steps,
        last,
    )


def recorded(
    config: DriveConfig, errors: Errors, rng: np.random.Generator, noise: float = 1.0
) -> Run:
    """A run of 10 m whose true path is recorded to 3 mm and 5 mrad, or a multiple of that."""
    robot = Robot(config, errors, rng)
    poses, angles = [], []
    for moment in robot.drive(random_path(rng, 10.0)):
        poses.append(moment.pose + rng.normal(0.0, (0.003, 0.003, 0.005)) * noise)
        angles.append({servo.id: servo.position or 0.0 for servo in moment.state.servos})
    drives = [wheel.drive for wheel in config.wheels if wheel.drive is not None]
    steerings = [wheel.steering for wheel in config.wheels if wheel.steering is not None]
    rolled, heading = [], []
    for before, after in pairwise(angles):
        rolled.append([math.remainder(after[i] - before[i], math.tau) for i in drives])
        heading.append([(before[i] + after[i]) / 2 for i in steerings])
    return Run(np.array(poses), np.array(rolled), np.array(heading))


def calibrated(config: DriveConfig, errors: Errors, rng: np.random.Generator) -> DriveConfig:
    """The drive after one recorded run, from poses 3 s apart."""
    return calibrate(config, [recorded(config, errors, rng)], stretch=300)


@dataclass(frozen=True)
class Windows:
    """Errors of heading at the end of the windows, rad."""

    fused: Floats
    gyro: Floats


def husky(every: int = 1) -> Windows:
    """The Husky's windows, or one of so many: each with an odometry that starts anew."""
    table = np.loadtxt(HUSKY, delimiter=",", skiprows=1)
    # The wheels skid: effective track 2 to 2.5 times the nominal 0.55 m, and that only roughly.
    config = differential_drive(
        track=2.2 * 0.55, radius=0.165, radius_error=0.2, encoder_step=0.0146
    )
    gyro = GyroConfig(rate=20.0, noise_density=0.005, bias_limit=0.01, scale_error=0.01)
    fused, alone = [], []
    for window in np.unique(table[:, 0])[::every]:
        rows = table[table[:, 0] == window]
        odometer = Odometer(config, {GYRO: gyro})
        last: Odometry | None = None
        for row in rows:
            stamp = START_NS + round(row[4] * 1e9)
            speeds = enumerate(row[7:9].tolist(), 1)
            servos = [ServoState(id=i, velocity=speed) for i, speed in speeds]
            sample = ImuSample(stamp=stamp, angular_velocity=(0.0, 0.0, float(row[9])))
            messages = odometer.bus_state(BUS, BusState(stamp=stamp, servos=servos))
            for message in messages + odometer.imu(GYRO, sample):
                if isinstance(message, Odometry):
                    last = message
        if last is None:
            raise RuntimeError("no step was made")
        true = rows[-1, 12] - rows[0, 12]
        turned = float(np.sum((rows[1:, 9] + rows[:-1, 9]) / 2 * np.diff(rows[:, 4])))
        fused.append(math.remainder(last.theta - true, math.tau))
        alone.append(math.remainder(turned - true, math.tau))
    return Windows(np.array(fused), np.array(alone))


OPTIODOM_STEP = 2 * math.pi / (43.7 * 64)
"""rad of the wheel for one count of the encoder."""


def optiodom_run(name: str) -> Run:
    """A recorded run of the differential robot."""
    table = np.loadtxt(OPTIODOM / f"{name}.csv", delimiter=",")
    rolled = table[1:, [5, 4]] * OPTIODOM_STEP  # the file has the right wheel first
    return Run(table[:, 1:4], rolled, np.zeros_like(rolled))


def optiodom_nominal() -> DriveConfig:
    """The robot as its makers describe it; its two wheels are of one make."""
    return differential_drive(
        track=0.2, radius=0.042, encoder_step=OPTIODOM_STEP, radius_error=0.001
    )


def optiodom_calibrated() -> DriveConfig:
    """From the circular run alone, lap by lap."""
    runs = [optiodom_run(f"circular_231220200121_run-0{i}") for i in (1, 2)]
    turns = np.diff(np.unwrap(runs[0].poses[:, 2]))
    lap = round(len(turns) * math.tau / abs(float(turns.sum())))
    return calibrate(optiodom_nominal(), runs, stretch=lap)


def optiodom_end(config: DriveConfig, run: Run) -> tuple[float, float]:
    """Errors of position, m, and heading, rad, at the end of a run through the odometry."""
    odometer = Odometer(config, {})
    angles = np.concatenate([np.zeros((1, 2)), np.cumsum(run.rolled, axis=0)])
    last: Odometry | None = None
    for k, angle in enumerate(angles):
        servos = [ServoState(id=i, position=float(a)) for i, a in enumerate(angle, 1)]
        state = BusState(stamp=START_NS + k * 50_000_000, servos=servos)
        for message in odometer.bus_state(BUS, state):
            if isinstance(message, Odometry):
                last = message
    if last is None:
        raise RuntimeError("no step was made")
    (x, y, theta), end = run.poses[0], run.poses[-1]
    cos, sin = math.cos(theta), math.sin(theta)
    position = math.hypot(
        x + cos * last.x - sin * last.y - end[0], y + sin * last.x + cos * last.y - end[1]
    )
    return position, math.remainder(theta + last.theta - end[2], math.tau)
