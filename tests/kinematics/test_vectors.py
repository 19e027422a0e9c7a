"""Vectors recorded from WPILib's own library."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.forward import forward
from wackel_kinematics.inverse import inverse
from wackel_kinematics.layouts import differential
from wackel_kinematics.planar import compose, exponential, velocity_at
from wackel_kinematics.wheel import Placement, steered

FILE = Path(__file__).parents[2].parent / "shared" / "data" / "kinematics_vectors.json"
TYPES = ("swerve_inverse", "swerve_forward", "swerve_odometry", "diff_odometry")
VECTORS: list[dict[str, Any]] = json.loads(FILE.read_text())["vectors"] if FILE.exists() else []

pytestmark = pytest.mark.skipif(not VECTORS, reason=f"no recorded vectors at {FILE}")


def of(kind: str) -> list[Any]:
    return [
        pytest.param(vector, id=f"{i} {vector['name'][:24]}")
        for i, vector in enumerate(VECTORS)
        if vector["type"] == kind
    ]


def swerve(vector: dict[str, Any]) -> Drive:
    """Steered wheels of radius 1, so that wheel rates are speeds."""
    return Drive([steered(Placement.cartesian(*xy), 1.0) for xy in vector["modules_xy"]])


def as_vectors(speed: Floats, heading: Floats) -> Floats:
    """Speed −v at an angle is +v at the opposite angle, so wheels compare as vectors."""
    vectors: Floats = speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return vectors


def test_no_vector_is_left_out() -> None:
    assert {vector["type"] for vector in VECTORS} == set(TYPES)


@pytest.mark.parametrize("vector", of("swerve_inverse"))
def test_wheels_for_a_twist_about_any_centre(vector: dict[str, Any]) -> None:
    drive = swerve(vector)
    given = np.array(vector["twist"])
    centre = np.array(vector["center_of_rotation"], dtype=np.float64)
    # The twist is stated for a point; the same motion stated for the origin:
    twist = np.append(velocity_at(given, -centre), given[2])
    motion = inverse(drive, twist, np.zeros(drive.n))
    expected = np.array(vector["expected_speed_angle_deg"])
    np.testing.assert_allclose(
        as_vectors(motion.wheel_rate, drive.heading(motion.steering)),
        as_vectors(expected[:, 0], np.radians(expected[:, 1])),
        atol=vector["tol_speed"],
    )
    turn = drive.heading(motion.steering) - np.radians(expected[:, 1])
    away = np.abs(turn - np.pi * np.round(turn / np.pi))
    assert away[np.abs(expected[:, 0]) > 1e-3].max(initial=0.0) < np.radians(
        vector["tol_angle_deg"]
    )


@pytest.mark.parametrize("vector", of("swerve_forward"))
def test_the_twist_that_fits_the_wheels_best(vector: dict[str, Any]) -> None:
    drive = swerve(vector)
    wheels = np.array(vector["module_speed_angle_deg"])
    estimate = forward(drive, drive.steering(np.radians(wheels[:, 1])), wheels[:, 0])
    assert estimate.rank == 3
    np.testing.assert_allclose(estimate.twist, vector["expected_twist"], atol=vector["tol"])


def reached(displacements: Floats, gyro_deg: list[float]) -> Floats:
    """Pose after steps whose turn the gyro says."""
    heading = np.radians(gyro_deg)
    pose = np.array([0.0, 0.0, heading[0]])
    for displacement, turn in zip(displacements, np.diff(heading), strict=True):
        pose = compose(pose, exponential(np.append(displacement[:2], turn)))
    return pose


def check_pose(pose: Floats, vector: dict[str, Any]) -> None:
    x, y, heading_deg = vector["expected_pose_xy_deg"]
    np.testing.assert_allclose(pose[:2], [x, y], atol=vector["tol"])
    away = np.degrees(pose[2]) - heading_deg
    assert abs(away - 360 * round(away / 360)) < vector["tol"]


@pytest.mark.parametrize("vector", of("swerve_odometry"))
def test_a_path_of_steered_wheels_and_a_gyro(vector: dict[str, Any]) -> None:
    drive = swerve(vector)
    steps = vector["steps"]
    wheels = np.array([step["module_pos_angle_deg"] for step in steps])
    distance = np.diff(np.concatenate([[vector["initial_module_pos"]], wheels[..., 0]]), axis=0)
    steering = drive.steering(np.radians(wheels[..., 1]))
    gyro = [vector["initial_gyro_deg"], *(step["gyro_deg"] for step in steps)]
    check_pose(reached(forward(drive, steering, distance).twist, gyro), vector)


@pytest.mark.parametrize("vector", of("diff_odometry"))
def test_a_path_of_two_wheels_and_a_gyro(vector: dict[str, Any]) -> None:
    drive = differential(track_m=1.0, radius_m=1.0, castor_x_m=-0.5)
    steps = vector["steps"]
    wheels = np.array([[0.0, 0.0, 0.0], *([step["left"], step["right"], 0.0] for step in steps)])
    distance = np.diff(wheels, axis=0)
    gyro = [vector["initial_gyro_deg"], *(step["gyro_deg"] for step in steps)]
    check_pose(reached(forward(drive, np.zeros(3), distance).twist, gyro), vector)
