import numpy as np
import pytest

from tests.kinematics.geometry import ring
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.inverse import inverse
from wackel_kinematics.redundancy import redundancy


def aligned(n: int) -> tuple[Drive, Floats]:
    drive = ring(n)
    return drive, inverse(drive, np.array([0.5, 0.1, 0.8]), np.zeros(n)).steering


@pytest.mark.parametrize(
    ("n", "drives", "steerings", "left"),
    [
        (3, (), (), 3),
        (3, (0,), (), 2),
        (3, (), (0,), 1),
        (3, (0, 1), (), 1),
        (3, (0,), (1,), 0),
        (4, (), (), 5),
        (4, (0,), (), 4),
        (4, (), (0,), 3),
        (4, (0, 1), (), 3),
        (4, (0,), (1,), 2),
        (4, (), (0, 1), 1),
    ],
)
def test_a_steering_fault_costs_two_checks_and_a_drive_fault_one(
    n: int, drives: tuple[int, ...], steerings: tuple[int, ...], left: int
) -> None:
    drive, steering = aligned(n)
    alone = redundancy(drive, steering, drives, steerings)
    assert (alone.left, alone.determined) == (left, True)
    with_gyro = redundancy(drive, steering, drives, steerings, gyro=True)
    assert (with_gyro.left, with_gyro.determined) == (left + 1, True)


def test_a_single_wheel_says_the_twist_only_together_with_a_gyro() -> None:
    drive, steering = aligned(3)
    alone = redundancy(drive, steering, steerings=(0, 1))
    assert (alone.rows, alone.left, alone.determined) == (2, 0, False)
    with_gyro = redundancy(drive, steering, steerings=(0, 1), gyro=True)
    assert (with_gyro.rows, with_gyro.left, with_gyro.determined) == (3, 0, True)


def test_a_drive_fault_on_the_wheel_of_a_steering_fault_costs_nothing_more() -> None:
    drive, steering = aligned(3)
    both = redundancy(drive, steering, drives=(1,), steerings=(1,))
    assert both == redundancy(drive, steering, steerings=(1,))


def test_without_roll_rows_the_speed_is_unknown_however_many_checks_are_left() -> None:
    drive, steering = aligned(4)
    without_drives = redundancy(drive, steering, drives=range(4))
    assert without_drives.left == 2
    assert not without_drives.determined
    assert redundancy(drive, steering, drives=range(4), gyro=True).determined


def test_without_any_row_nothing_is_known() -> None:
    drive, steering = aligned(3)
    assert redundancy(drive, steering, steerings=range(3)) == (0, 0)


@pytest.mark.parametrize("wheel", [-1, 3])
def test_a_wheel_that_is_not_there_is_rejected(wheel: int) -> None:
    drive, steering = aligned(3)
    with pytest.raises(ValueError, match=f"no wheel {wheel}, expected 0 to 2"):
        redundancy(drive, steering, drives=(wheel,))
    with pytest.raises(ValueError, match=f"no wheel {wheel}, expected 0 to 2"):
        redundancy(drive, steering, steerings=(wheel,))


def test_steering_that_is_no_number_is_rejected() -> None:
    with pytest.raises(ValueError, match="steering must be finite"):
        redundancy(ring(3), np.array([0.0, np.inf, 0.0]))
