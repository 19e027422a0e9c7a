import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.geometry import twists
from wackel_kinematics.array import Floats
from wackel_kinematics.planar import compose, exponential, instantaneous_centre, velocity_at


@settings(max_examples=50)
@given(twists.filter(lambda twist: bool(abs(twist[2]) > 1e-3)))
def test_the_instantaneous_centre_stands_still(twist: Floats) -> None:
    np.testing.assert_allclose(velocity_at(twist, instantaneous_centre(twist)), 0, atol=1e-12)


def test_the_paper_s_circle_has_its_centre_one_metre_to_the_left() -> None:
    np.testing.assert_allclose(instantaneous_centre(np.array([1.5, 0.0, 1.5])), [0, 1])


def test_a_pure_translation_has_no_centre() -> None:
    centres = instantaneous_centre(np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 2.0]]))
    assert np.isnan(centres[:2]).all()
    np.testing.assert_allclose(centres[2], [0, 0.5])


def test_a_centre_too_far_for_a_number_is_infinite() -> None:
    assert np.isinf(instantaneous_centre(np.array([1.0, 1.0, 1e-310]))).all()


@settings(max_examples=50)
@given(twists)
def test_the_exponential_is_many_small_steps_along_the_twist(displacement: Floats) -> None:
    pose = np.zeros(3)
    for _ in range(64):
        pose = compose(pose, exponential(displacement / 64))
    np.testing.assert_allclose(pose, exponential(displacement), atol=1e-12)


@settings(max_examples=50)
@given(twists)
def test_going_there_and_back_ends_where_it_began(displacement: Floats) -> None:
    back = compose(exponential(displacement), exponential(-displacement))
    np.testing.assert_allclose(back, 0, atol=1e-12)


def test_a_quarter_circle_ends_at_its_radius() -> None:
    np.testing.assert_allclose(
        exponential(np.array([math.pi / 2, 0, math.pi / 2])), [1, 1, math.pi / 2]
    )


@given(st.floats(-1e-7, 1e-7))
def test_the_exponential_is_exact_where_the_turn_vanishes(theta: float) -> None:
    np.testing.assert_allclose(
        exponential(np.array([1.0, 0.0, theta])), [1, theta / 2, theta], rtol=1e-9, atol=1e-15
    )
