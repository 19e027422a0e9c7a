"""That the whole odometer knows how far off it is: NEES of the pose, NIS of what each input says.

Every run is another robot, with all errors that its configuration assumes. What encoders and the
gyro's noise add is new in each step, and there the figures are those of χ²: of robots that do what
they are told at once, and do not slip. The pose is that of robots whose servos lag, and whose
wheels pull each other. Radii, directions and the gyro's scale are off for the whole run, and floors
may hold worse than these; the filter is cautious about that on purpose, and both sides are bounded.
"""

import math
from collections import defaultdict
from dataclasses import dataclass
from random import Random

import numpy as np
import pytest

from tests.odometry.simulation import (
    BUS,
    GYRO,
    Robot,
    calibration_errors,
    differential_drive,
    random_path,
    steered_drive,
)
from wackel_kinematics.array import Floats
from wackel_node.config import RobotConfig
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.core import Odometer
from wackel_schemas.drive import Odometry
from wackel_virtual.build import Build
from wackel_virtual.drive_simulation import DriveSimulation

DRIVES = (steered_drive(3), differential_drive(), steered_drive(4))
RUNS, LENGTH_M = 54, 1.5
LAGGING_RUNS, LAGGING_M = 36, 8.0
"""Longer, since at the start and the end, where they hasten most, the filter is most cautious."""
ROLLS_M_S = 0.1
"""Below, an encoder stays on a step for several cycles: its error is no longer new in each."""
UNLIKELY = 3.29
"""Standard deviations beyond which a normal number is once in a thousand times."""
CAUTIOUS = 0.4
"""Share of the covariance that errors have at least: a σ at most 1.6 times too large."""
SHARED = (1 + 2**2 + 1) / 4**2
"""Three samples of the gyro have part in a step, as the borders of steps lie between samples: its
variance by that of a sample."""
ALIKE = 1 + 2 * ((2 / 3) ** 2 + (1 / 6) ** 2)
"""So steps are alike, and so many of them count as one: the sum of their squared correlations."""


Squares = dict[tuple[str, str, str], list[float]]
"""Of the accepted innovations by their variances; by kind of drive, whether it stands or rolls, and
kind of input."""


@dataclass(frozen=True)
class Ends:
    """Of the runs of robots that lag and slip.

    Attributes:
        off: Errors of the pose, shape (runs, 3).
        covariance: What the odometry says of them, shape (runs, 3, 3).
    """

    off: Floats
    covariance: Floats

    def nees(self, *axes: int) -> float:
        """Mean over the runs, of some coordinates."""
        off, covariance = self.off[:, axes], self.covariance[:, axes][:, :, axes]
        return float(
            np.mean([e @ np.linalg.solve(p, e) for e, p in zip(off, covariance, strict=True)])
        )


@pytest.fixture(scope="module")
def ends() -> Ends:
    """One run after the other."""
    off, covariance = zip(
        *(_lagging(DRIVES[i % len(DRIVES)], i) for i in range(LAGGING_RUNS)), strict=True
    )
    return Ends(np.array(off), np.array(covariance))


def _lagging(config: DriveConfig, number: int) -> tuple[Floats, Floats]:
    gyro, seed = GyroConfig(), f"consistency/{number}"
    simulation = DriveSimulation(
        RobotConfig(drive=config, gyros={GYRO: gyro}), seed, build=Build.drawn(Random(seed))
    )
    odometer = Odometer(config, {GYRO: gyro})
    poses: dict[int, Floats] = {}
    last: Odometry | None = None
    path = random_path(np.random.default_rng(number), LAGGING_M, sideways=config.kind == "steered")
    for twist in path.tolist():
        cycle = simulation.step(*twist)
        poses[cycle.state.stamp] = cycle.pose
        for message in odometer.imu(GYRO, cycle.imu) + odometer.bus_state(BUS, cycle.state):
            if isinstance(message, Odometry):
                last = message
    assert last is not None
    off = np.array([last.x, last.y, last.theta]) - poses[last.stamp]
    off[2] = math.remainder(off[2], math.tau)
    return off, np.reshape(last.pose_covariance, (3, 3))


@pytest.fixture(scope="module")
def nis() -> Squares:
    """One run after the other."""
    found: Squares = defaultdict(list)
    for i in range(RUNS):
        _run(DRIVES[i % len(DRIVES)], np.random.default_rng(9000 + i), found)
    return found


def _run(config: DriveConfig, rng: np.random.Generator, nis: Squares) -> None:
    gyro = GyroConfig()
    errors = calibration_errors(rng, len(config.wheels), config.radius_error, config.steering_error)
    robot, odometer = Robot(config, errors, rng), Odometer(config, {GYRO: gyro})
    scale = 1 + rng.normal(0.0, gyro.scale_error)
    path = random_path(rng, LENGTH_M, sideways=config.kind == "steered")
    twists: dict[int, Floats] = {}
    for moment in robot.drive(path):
        twists[moment.state.stamp] = moment.twist
        moment.sample.angular_velocity = (0.0, 0.0, scale * moment.sample.angular_velocity[2])
        for message in odometer.bus_state(BUS, moment.state) + odometer.imu(GYRO, moment.sample):
            if isinstance(message, Odometry):
                rolls = math.hypot(*twists[message.stamp][:2]) > ROLLS_M_S
                if message.standing or rolls:
                    _gather(config.kind, message, nis)


def _gather(drive: str, odometry: Odometry, nis: Squares) -> None:
    motion = "stands" if odometry.standing else "rolls"
    for each in odometry.inputs:
        if each.result == "used":
            what = "gyro" if each.name.startswith("gyro") else each.name.rpartition("/")[2]
            nis[drive, motion, what].append((each.innovation / each.sigma) ** 2)


@pytest.mark.parametrize("axes", [(2,), (0, 1), (0, 1, 2)], ids=["heading", "position", "pose"])
def test_the_pose_is_not_farther_off_than_its_covariance_says(
    ends: Ends, axes: tuple[int, ...]
) -> None:
    """Nor much less far. Chance moves the mean of so many runs by a tenth."""
    assert CAUTIOUS * len(axes) < ends.nees(*axes) < len(axes)


def test_a_gyro_at_rest_is_as_noisy_as_configured(nis: Squares) -> None:
    for drive in ("steered", "differential"):
        squares = nis[drive, "stands", "gyro"]
        sigma = SHARED * math.sqrt(2 * ALIKE / len(squares))
        assert np.mean(squares) == pytest.approx(SHARED, abs=UNLIKELY * sigma)


def test_what_wheels_roll_is_as_exact_as_their_encoders(nis: Squares) -> None:
    """These are most of its error; the radius, of another robot in each run, is the rest."""
    for drive in ("steered", "differential"):
        assert np.mean(nis[drive, "rolls", "roll"]) == pytest.approx(1.0, abs=0.1)


def test_a_gyro_is_held_against_no_less_than_its_wheels_may_be_off(nis: Squares) -> None:
    """The wheels that steer say less of the yaw rate than these do, which never creep sideways."""
    assert np.mean(nis["differential", "rolls", "gyro"]) == pytest.approx(1.0, abs=0.15)
    assert 0.5 < np.mean(nis["steered", "rolls", "gyro"]) < 1.1


def test_wheels_slide_less_than_they_may(nis: Squares) -> None:
    """The directions are off as configured, but these wheels do not creep, and never lag."""
    assert 0.1 < np.mean(nis["steered", "rolls", "slide"]) < 0.5
