import numpy as np
import pytest

from tests.kinematics.geometry import ring
from wackel_kinematics.array import Bools, Floats
from wackel_kinematics.candidates import Candidates
from wackel_kinematics.drive import Drive
from wackel_kinematics.inverse import WheelMotion, inverse
from wackel_kinematics.signatures import as_text, drive_signatures, steering_signatures

CIRCLE = np.array([1.5, 0.0, 1.5])
"""The paper's test drive: 1 m radius at 1.5 m/s (section 5)."""

DRIVE = {3: ["101000", "010010", "000101"]}
DRIVE[4] = ["101010000000", "010000101000", "000100010010", "000001000101"]
STEERING = {3: ["111100", "110011", "001111"]}
STEERING[4] = ["111111000000", "110000111100", "001100110011", "000011001111"]


def spoilt(drive: Drive, steering: Floats, wheel_rate: Floats) -> Bools:
    """Step II: candidates that differ from the command by more than 1 mm/s or 1 mrad/s."""
    found = Candidates(drive).twists(drive.rows(steering), drive.values(wheel_rate))
    differs: Bools = np.any(np.abs(found - CIRCLE) > 1e-3, axis=-1)
    return differs


def on_the_circle(n: int) -> tuple[Drive, WheelMotion]:
    drive = ring(n)
    return drive, inverse(drive, CIRCLE, np.zeros(n))


@pytest.mark.parametrize("n", [3, 4])
def test_tables_of_signatures(n: int) -> None:
    candidates = Candidates(ring(n))
    assert [as_text(row) for row in drive_signatures(candidates)] == DRIVE[n]
    assert [as_text(row) for row in steering_signatures(candidates)] == STEERING[n]


@pytest.mark.parametrize("n", [3, 4, 8])
def test_each_wheel_rate_is_used_n_minus_1_times_and_each_steering_angle_twice_that(n: int) -> None:
    candidates = Candidates(ring(n))
    np.testing.assert_array_equal(drive_signatures(candidates).sum(axis=-1), n - 1)
    np.testing.assert_array_equal(steering_signatures(candidates).sum(axis=-1), 2 * (n - 1))


@pytest.mark.parametrize("n", [3, 4])
def test_a_healthy_drive_on_the_paper_s_circle_has_an_empty_signature(n: int) -> None:
    drive, motion = on_the_circle(n)
    assert as_text(spoilt(drive, motion.steering, motion.wheel_rate)) == "0" * (n * (n - 1))


@pytest.mark.parametrize(("n", "i"), [(n, i) for n in (3, 4) for i in range(n)])
def test_a_wrong_wheel_rate_shows_the_signature_of_its_drive(n: int, i: int) -> None:
    drive, motion = on_the_circle(n)
    rate = motion.wheel_rate.copy()
    rate[i] *= 0.8
    assert as_text(spoilt(drive, motion.steering, rate)) == DRIVE[n][i]


@pytest.mark.parametrize(("n", "i"), [(n, i) for n in (3, 4) for i in range(n)])
def test_a_wrong_steering_angle_shows_the_signature_of_its_steering(n: int, i: int) -> None:
    drive, motion = on_the_circle(n)
    steering = motion.steering.copy()
    steering[i] += 0.1
    assert as_text(spoilt(drive, steering, motion.wheel_rate)) == STEERING[n][i]


def test_a_drive_and_the_steering_of_the_same_wheel_look_like_the_steering_alone() -> None:
    drive, motion = on_the_circle(4)
    steering, rate = motion.steering.copy(), motion.wheel_rate.copy()
    steering[2] += 0.1
    rate[2] *= 0.8
    assert as_text(spoilt(drive, steering, rate)) == STEERING[4][2]
