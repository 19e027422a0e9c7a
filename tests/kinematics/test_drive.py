import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.geometry import ring, steered_drives, steering_of
from wackel_kinematics.drive import Drive
from wackel_kinematics.wheel import Placement, castor, fixed, mecanum, omni, steered


@settings(max_examples=50)
@given(st.data())
def test_rows_are_equations_3_and_4_as_printed(data: st.DataObject) -> None:
    drive = data.draw(steered_drives)
    beta = data.draw(steering_of(drive))
    length = np.array([wheel.place.l_m for wheel in drive.wheels])
    axle = drive.alpha + beta
    slide = np.stack([np.cos(axle), np.sin(axle), length * np.sin(beta)], axis=-1)
    roll = np.stack([np.sin(axle), -np.cos(axle), -length * np.cos(beta)], axis=-1)
    np.testing.assert_allclose(drive.rows(beta), np.concatenate([slide, roll]), atol=1e-13)


@settings(max_examples=50)
@given(st.data())
def test_the_derivative_of_c_is_minus_j_and_that_of_j_is_c(data: st.DataObject) -> None:
    drive = data.draw(steered_drives)
    beta = data.draw(steering_of(drive))
    step = 1e-5
    slope = (drive.rows(beta + step) - drive.rows(beta - step)) / (2 * step)
    rows = drive.rows(beta)
    np.testing.assert_allclose(slope[: drive.n], -rows[drive.n :], atol=1e-9)
    np.testing.assert_allclose(slope[drive.n :], rows[: drive.n], atol=1e-9)


def test_roll_rows_equal_the_rolling_speed_and_slide_rows_nothing() -> None:
    drive = Drive([steered(Placement(0.3, a), r) for a, r in [(0.0, 0.05), (2.0, 0.1), (4.0, 0.2)]])
    values = drive.values(np.array([1.0, 2.0, -3.0]))
    np.testing.assert_allclose(values, [0, 0, 0, 0.05, 0.2, -0.6])


def test_each_kind_of_wheel_brings_its_own_rows() -> None:
    drive = Drive(
        [
            castor(Placement(0.4, math.pi)),
            steered(Placement(0.3, 0.0), 0.05),
            fixed(Placement(0.3, 1.0), None),
            omni(Placement(0.3, 2.0), 0.04, 0.0),
            mecanum(Placement(0.3, 3.0), 0.03, 0.5),
        ]
    )
    assert drive.slide_wheels.tolist() == [1, 2]
    assert drive.roll_wheels.tolist() == [1, 3, 4]
    assert drive.row_wheels.tolist() == [1, 2, 1, 3, 4]
    assert drive.slide_count == 2
    assert drive.steers.tolist() == [False, True, False, False, False]
    assert drive.rows(np.zeros(5)).shape == (5, 3)
    np.testing.assert_allclose(drive.values(np.ones(5)), [0, 0, 0.05, 0.04, 0.03])


def test_steering_of_wheels_that_do_not_steer_is_ignored() -> None:
    drive = Drive([steered(Placement(0.3, 0.0), 0.05), fixed(Placement(0.3, 2.0), 0.05, 0.4)])
    np.testing.assert_array_equal(
        drive.rows(np.array([0.3, 0.0])), drive.rows(np.array([0.3, 7.0]))
    )


def test_heading_and_steering_are_each_others_inverse() -> None:
    drive = ring(4)
    heading = np.array([0.0, 1.0, -2.0, 9.0])
    np.testing.assert_allclose(drive.heading(drive.steering(heading)), heading)


def test_a_fixed_wheel_keeps_its_heading() -> None:
    drive = Drive([fixed(Placement(0.3, 2.0), 0.05, 0.4)])
    assert drive.heading(np.array([9.0]))[0] == pytest.approx(0.4)


def test_a_recording_gives_what_its_samples_give() -> None:
    drive = ring(4)
    steering = np.linspace(-3, 3, 24).reshape(2, 3, 4)
    rate = np.linspace(-5, 5, 24).reshape(2, 3, 4)
    for at in np.ndindex(2, 3):
        np.testing.assert_array_equal(drive.rows(steering)[at], drive.rows(steering[at]))
        np.testing.assert_array_equal(drive.values(rate)[at], drive.values(rate[at]))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_angle_that_is_no_number_spoils_the_rows_of_its_wheel_only(bad: float) -> None:
    rows = ring(3).rows(np.array([0.0, bad, 0.0]))
    assert np.isnan(rows).all(axis=-1).tolist() == [False, True, False, False, True, False]


@pytest.mark.parametrize("shape", [(), (3,), (5,), (4, 1)])
def test_a_wrong_number_of_wheels_is_rejected(shape: tuple[int, ...]) -> None:
    drive = ring(4)
    with pytest.raises(ValueError, match=r"steering has shape .* expected \(\.\.\., 4\)"):
        drive.rows(np.zeros(shape))
    with pytest.raises(ValueError, match=r"wheel rate has shape .* expected \(\.\.\., 4\)"):
        drive.values(np.zeros(shape))


@pytest.mark.parametrize(
    "wheels", [[], [castor(Placement(0.3, 0.0))], [steered(Placement(0.0, 0.0), 0.05)]]
)
def test_wheels_that_bind_no_motion_are_no_drive(wheels: list[object]) -> None:
    with pytest.raises(ValueError, match="no wheel away from the origin"):
        Drive(wheels)  # type: ignore[arg-type]


@given(st.data())
def test_rows_of_known_headings_are_the_same_in_less_time(data: st.DataObject) -> None:
    drive = data.draw(steered_drives)
    headings = np.array([drive.heading(data.draw(steering_of(drive))) for _ in range(2)])
    for rows in (drive.known_rows(*headings.tolist()), drive.many_known_rows(headings)):
        np.testing.assert_allclose(rows, drive.rows_along(headings), atol=1e-13)
