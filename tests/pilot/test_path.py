"""Paths: where they lead, and that wheels can follow them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_pilot import path

SPEED, RADIUS, ACCELERATION = 0.5, 1.0, 0.25
PATHS = {
    "circle": path.circle(SPEED, RADIUS, ACCELERATION),
    "eight": path.eight(SPEED, RADIUS, ACCELERATION),
    "random": path.wander(SPEED, RADIUS, ACCELERATION, seed=3),
}


def pose_after(way: path.Path, seconds: float) -> tuple[float, float, float]:
    x = y = heading = 0.0
    dt = 0.002
    for step in range(round(seconds / dt)):
        vx, vy, omega = way((step + 0.5) * dt)
        middle = heading + omega * dt / 2
        x += (vx * math.cos(middle) - vy * math.sin(middle)) * dt
        y += (vx * math.sin(middle) + vy * math.cos(middle)) * dt
        heading += omega * dt
    return x, y, heading


def test_a_circle_comes_back_to_where_it_began() -> None:
    lap_s = 2 * math.pi * RADIUS / SPEED + 1.0  # 1 s is lost by the start from rest
    x, y, heading = pose_after(PATHS["circle"], lap_s)
    assert (x, y, heading) == pytest.approx((0.0, 0.0, 2 * math.pi), abs=0.01)


def test_an_eight_turns_left_then_right_and_drifts_little() -> None:
    turns = [PATHS["eight"](time_s)[2] for time_s in (6.0, 20.0, 33.0)]
    assert turns == pytest.approx([0.5, -0.5, 0.5])
    lap_s = 4 * math.pi * RADIUS / SPEED + 1.0
    x, y, _ = pose_after(PATHS["eight"], lap_s)
    assert math.hypot(x, y) < 1.0


@pytest.mark.parametrize("name", PATHS)
def test_every_path_starts_from_rest_and_never_jumps(name: str) -> None:
    way = PATHS[name]
    assert way(0.0) == way(-1.0) == (0.0, 0.0, 0.0)
    before = way(0.0)
    for step in range(1, 6000):
        now = way(step * 0.01)
        assert all(abs(b - a) < 0.02 for a, b in zip(before, now, strict=True))
        assert math.hypot(*now[:2]) <= 1.1 * SPEED
        before = now


def test_random_paths_differ_by_seed_and_repeat_with_it() -> None:
    def way(seed: int) -> list[path.Twist]:
        wander = path.wander(SPEED, RADIUS, ACCELERATION, seed)
        return [wander(float(second)) for second in range(20)]

    assert way(1) == way(1)
    assert way(1) != way(2)


@given(
    st.floats(-10.0, 100.0),
    st.floats(0.01, 10.0),
    st.floats(0.01, 10.0),
)
def test_a_ramp_is_the_integral_of_its_speed(
    time_s: float, speed: float, acceleration: float
) -> None:
    now, way = path.ramp(time_s, speed, acceleration)
    assert 0.0 <= now <= speed
    later, further = path.ramp(time_s + 0.01, speed, acceleration)
    assert -1e-9 <= later - now <= 0.01 * acceleration + 1e-9
    # Even acceleration, or none; in between the mean speed lies between the two.
    assert 0.01 * now - 1e-9 <= further - way <= 0.01 * later + 1e-9
