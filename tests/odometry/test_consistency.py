"""That the whole odometer knows how far off it is: NEES of the pose, NIS of what each input says.

Every run is another robot, with all errors that its configuration assumes. What encoders and the
gyro's noise add is new in each step, and there the figures are those of χ². Radii, directions and
the gyro's scale are off for the whole run; the filter is cautious about these on purpose, since it
takes them for as wrong as they are in one motion that lasts, and both sides are bounded.
"""

import math
from collections import defaultdict
from dataclasses import dataclass

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
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.core import Odometer
from wackel_schemas.drive import Odometry

DRIVES = (steered_drive(3), differential_drive(), steered_drive(4))
RUNS = 54
LENGTH_M = 1.5
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


@dataclass(frozen=True)
class Found:
    """Over all runs.

    Attributes:
        off: Errors of the pose at the end of each, shape (runs, 3).
        covariance: What the odometry says of them, shape (runs, 3, 3).
        nis: Squares of the accepted innovations by their variances; by kind of drive, whether it
            stands or rolls, and kind of input.
    """

    off: Floats
    covariance: Floats
    nis: dict[tuple[str, str, str], list[float]]

    def nees(self, *axes: int) -> float:
        """Mean over the runs, of some coordinates."""
        off, covariance = self.off[:, axes], self.covariance[:, axes][:, :, axes]
        return float(
            np.mean([e @ np.linalg.solve(p, e) for e, p in zip(off, covariance, strict=True)])
        )


@pytest.fixture(scope="module")
def found() -> Found:
    """One run after the other."""
    nis: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    ends = [
        _run(DRIVES[i % len(DRIVES)], np.random.default_rng(9000 + i), nis) for i in range(RUNS)
    ]
    off, covariance = zip(*ends, strict=True)
    return Found(np.array(off), np.array(covariance), nis)


def _run(
    config: DriveConfig, rng: np.random.Generator, nis: dict[tuple[str, str, str], list[float]]
) -> tuple[Floats, Floats]:
    gyro = GyroConfig()
    errors = calibration_errors(rng, len(config.wheels), config.radius_error, config.steering_error)
    robot, odometer = Robot(config, errors, rng), Odometer(config, {GYRO: gyro})
    scale = 1 + rng.normal(0.0, gyro.scale_error)
    path = random_path(rng, LENGTH_M, sideways=config.kind == "steered")
    truth: dict[int, tuple[Floats, Floats]] = {}
    last: Odometry | None = None
    for moment in robot.drive(path):
        truth[moment.state.stamp] = moment.pose, moment.twist
        moment.sample.angular_velocity = (0.0, 0.0, scale * moment.sample.angular_velocity[2])
        for message in odometer.bus_state(BUS, moment.state) + odometer.imu(GYRO, moment.sample):
            if isinstance(message, Odometry):
                last = message
                rolls = math.hypot(*truth[last.stamp][1][:2]) > ROLLS_M_S
                if last.standing or rolls:
                    _gather(config.kind, last, nis)
    assert last is not None
    off = np.array([last.x, last.y, last.theta]) - truth[last.stamp][0]
    off[2] = math.remainder(off[2], math.tau)
    return off, np.reshape(last.pose_covariance, (3, 3))


def _gather(drive: str, odometry: Odometry, nis: dict[tuple[str, str, str], list[float]]) -> None:
    motion = "stands" if odometry.standing else "rolls"
    for each in odometry.inputs:
        if each.result == "used":
            what = "gyro" if each.name.startswith("gyro") else each.name.rpartition("/")[2]
            nis[drive, motion, what].append((each.innovation / each.sigma) ** 2)


@pytest.mark.parametrize("axes", [(2,), (0, 1), (0, 1, 2)], ids=["heading", "position", "pose"])
def test_the_pose_is_not_farther_off_than_its_covariance_says(
    found: Found, axes: tuple[int, ...]
) -> None:
    """Nor much less far. Chance moves the mean of so many runs by a tenth."""
    assert CAUTIOUS * len(axes) < found.nees(*axes) < len(axes)


def test_a_gyro_at_rest_is_as_noisy_as_configured(found: Found) -> None:
    for drive in ("steered", "differential"):
        nis = found.nis[drive, "stands", "gyro"]
        sigma = SHARED * math.sqrt(2 * ALIKE / len(nis))
        assert np.mean(nis) == pytest.approx(SHARED, abs=UNLIKELY * sigma)


def test_what_wheels_roll_is_as_exact_as_their_encoders(found: Found) -> None:
    """These are most of its error; the radius, of another robot in each run, is the rest."""
    for drive in ("steered", "differential"):
        assert np.mean(found.nis[drive, "rolls", "roll"]) == pytest.approx(1.0, abs=0.1)


def test_a_gyro_is_held_against_no_less_than_its_wheels_may_be_off(found: Found) -> None:
    """The wheels that steer say less of the yaw rate than these do, which never creep sideways."""
    assert np.mean(found.nis["differential", "rolls", "gyro"]) == pytest.approx(1.0, abs=0.15)
    assert 0.5 < np.mean(found.nis["steered", "rolls", "gyro"]) < 1.1


def test_wheels_slide_less_than_they_may(found: Found) -> None:
    """The directions are off as configured, but these wheels do not creep, and never lag."""
    assert 0.1 < np.mean(found.nis["steered", "rolls", "slide"]) < 0.5
