import numpy as np
import pytest
from hypothesis import given, settings

from tests.kinematics.geometry import moving_drives, ring
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.inverse import inverse
from wackel_kinematics.layouts import differential, mecanum_rectangle, tricycle
from wackel_kinematics.velocity_space import velocity_space
from wackel_kinematics.wheel import Placement, steered


@settings(max_examples=50)
@given(moving_drives())
def test_aligned_wheels_are_free_along_the_twist_they_are_aligned_for(
    moving: tuple[Drive, Floats],
) -> None:
    drive, twist = moving
    space = velocity_space(drive, inverse(drive, twist, np.zeros(drive.n)).steering)
    assert space.resistance[0] == pytest.approx(0, abs=1e-7)
    if space.resistance[1] > 1e-3:
        assert np.linalg.norm(np.cross(space.directions[0], twist)) < 1e-5


def test_three_aligned_wheels_leave_one_freedom_and_a_crooked_one_locks_them() -> None:
    drive = ring(3)
    steering = inverse(drive, np.array([0.5, 0.1, 0.8]), np.zeros(3)).steering
    assert velocity_space(drive, steering).mobility == 1
    assert velocity_space(drive, steering + np.array([0.0, 0.0, 0.3])).mobility == 0


def test_less_than_a_degree_of_misalignment_is_still_aligned() -> None:
    drive = ring(3)
    steering = inverse(drive, np.array([0.5, 0.1, 0.8]), np.zeros(3)).steering
    assert velocity_space(drive, steering + np.radians([0.0, 0.0, 0.5])).mobility == 1


def test_a_single_steered_wheel_leaves_a_plane() -> None:
    drive = Drive([steered(Placement(0.3, 0.0), 0.05)])
    assert velocity_space(drive, np.zeros(1)).mobility == 2


def test_mobility_of_other_drives_is_as_in_the_textbook() -> None:
    assert velocity_space(differential(0.4, 0.1, -0.3), np.zeros(3)).mobility == 2
    assert velocity_space(tricycle(0.5, 0.4, 0.1), np.zeros(3)).mobility == 1
    assert velocity_space(mecanum_rectangle(0.6, 0.4, 0.1), np.zeros(4)).mobility == 3


def test_directions_have_length_one_as_speeds_at_the_wheels_scale() -> None:
    drive = ring(4, l_m=0.5)
    directions = velocity_space(drive, np.array([0.1, 0.7, -0.4, 2.0])).directions
    scaled = directions * [1.0, 1.0, 0.5]
    np.testing.assert_allclose(scaled @ scaled.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_steering_that_is_no_number_is_rejected(bad: float) -> None:
    with pytest.raises(ValueError, match="steering must be finite"):
        velocity_space(ring(3), np.array([0.0, bad, 0.0]))


def test_resistance_is_the_size_of_the_slide_rows_along_the_direction() -> None:
    drive = ring(4)
    steering = np.array([0.1, 0.7, -0.4, 2.0])
    space = velocity_space(drive, steering)
    normals = drive.scaled_unit(drive.rows(steering)[:4])
    along = normals @ (space.directions * [1.0, 1.0, drive.length_m]).T
    np.testing.assert_allclose(np.linalg.norm(along, axis=0), space.resistance, atol=1e-9)
