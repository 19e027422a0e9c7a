import math

import pytest

from wackel_kinematics.wheel import Placement, Wheel, castor, fixed, mecanum, steered

HERE = Placement(0.3, 0.5)


def test_polar_and_cartesian_placement_are_the_same_place() -> None:
    place = Placement.cartesian(-0.2, 0.15)
    assert (place.x_m, place.y_m) == pytest.approx((-0.2, 0.15))
    assert place.l_m == pytest.approx(0.25)
    assert place.alpha_rad == pytest.approx(math.atan2(0.15, -0.2))


def test_a_wheel_at_the_origin_has_a_direction_too() -> None:
    assert Placement.cartesian(0.0, 0.0) == Placement(0.0, 0.0)


def test_a_fixed_wheel_that_points_ahead_at_the_left_has_beta_zero_like_the_paper() -> None:
    left = Placement.cartesian(0.0, 0.2)
    assert fixed(left, 0.05).beta_rad == pytest.approx(0.0)


@pytest.mark.parametrize("l_m", [-0.1, math.nan, math.inf])
def test_a_placement_without_a_distance_is_rejected(l_m: float) -> None:
    with pytest.raises(ValueError, match="expected a finite distance"):
        Placement(l_m, 0.0)


@pytest.mark.parametrize("alpha_rad", [math.nan, -math.inf])
def test_a_placement_without_a_direction_is_rejected(alpha_rad: float) -> None:
    with pytest.raises(ValueError, match="alpha"):
        Placement(0.3, alpha_rad)


@pytest.mark.parametrize("radius_m", [0.0, -0.05, math.nan, math.inf])
def test_a_wheel_without_a_size_is_rejected(radius_m: float) -> None:
    with pytest.raises(ValueError, match="radius is"):
        steered(HERE, radius_m)


def test_a_heading_that_is_no_number_is_rejected() -> None:
    with pytest.raises(ValueError, match="heading"):
        fixed(HERE, 0.05, math.nan)


@pytest.mark.parametrize("roller_rad", [math.pi / 2, -1.5, math.nan])
def test_rollers_that_turn_along_the_heading_are_rejected(roller_rad: float) -> None:
    with pytest.raises(ValueError, match="roller angle"):
        mecanum(HERE, 0.05, roller_rad)


def test_a_wheel_with_rollers_cannot_resist_sideways() -> None:
    with pytest.raises(ValueError, match="sideways"):
        Wheel(HERE, 0.05, 0.0, slide=True, roller_rad=0.5)


def test_a_castor_has_neither_row() -> None:
    assert castor(HERE).radius_m is None
    assert not castor(HERE).slide
