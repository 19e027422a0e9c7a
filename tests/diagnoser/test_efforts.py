"""What driving needs of the motors, as learnt."""

import math

import numpy as np
import pytest

from tests.odometry.simulation import differential_drive
from wackel_diagnoser.efforts import Efforts, Needs
from wackel_drive.layout import Layout
from wackel_schemas.bus import BusState, ServoState

STEP_S = 0.01
TRUE = Needs(friction=0.15, mass=0.05, turning=-0.02, unsure=0.0)


def driven(seconds: float, *, turns: bool) -> Efforts:
    """The motors of two wheels, after some driving with changes of speed."""
    config = differential_drive()
    efforts, joints = Efforts(Layout(config)), [joint for joint in Layout(config).rolling if joint]
    rng = np.random.default_rng(1)
    before = np.zeros((2, 2))
    for step in range(round(seconds / STEP_S)):
        along = np.full(2, 0.3 + 0.2 * math.sin(3.0 * step * STEP_S))
        about = np.array([-1.0, 1.0]) * 0.2 * math.sin(4.0 * step * STEP_S) * turns
        now = np.array([along + about, about])
        speeds, turning = now.tolist()
        hastens, turned = (now - before) / STEP_S
        before = now
        current = TRUE.friction * now[0] + TRUE.mass * hastens + TRUE.turning * turned
        current += rng.normal(0.0, 0.003, 2)
        state = BusState(
            stamp=step,
            servos=[
                ServoState(id=joint.servo.id, current=joint.sign * amperes)
                for joint, amperes in zip(joints, current.tolist(), strict=True)
            ],
        )
        efforts.bus_state(joints[0].servo.bus, state)
        efforts.step(STEP_S, speeds, turning, STEP_S, needed=True)
    return efforts


def test_turning_needs_less_than_driving() -> None:
    rolling = driven(21.0, turns=True).rolling()
    assert rolling is not None
    assert rolling.needs[:3] == pytest.approx(TRUE[:3], rel=0.1)
    assert max(rolling.usual) < 0.01**2


def test_what_turning_needs_is_not_guessed_by_who_goes_straight() -> None:
    rolling = driven(21.0, turns=False).rolling()
    assert rolling is not None
    assert rolling.needs[:3] == pytest.approx((TRUE.friction, TRUE.mass, 0.0), rel=0.1, abs=1e-6)


def test_who_drives_evenly_for_hours_goes_on() -> None:
    """And forgets what it needed to get there."""
    efforts = driven(21.0, turns=True)
    for _ in range(20_000):
        efforts.step(STEP_S, [0.3, 0.3], [0.0, 0.0], 1.0, needed=False)
    rolling = efforts.rolling()
    assert rolling is not None
    assert all(map(math.isfinite, rolling.needs))


def test_a_current_that_is_not_known_teaches_nothing() -> None:
    efforts = driven(21.0, turns=True)
    before = efforts.rolling()
    assert before is not None
    efforts.bus_state("main", BusState(stamp=10**9, servos=[ServoState(id=1, position=0.0)]))
    efforts.step(STEP_S, [0.3, 0.3], [0.0, 0.0], STEP_S, needed=True)
    after = efforts.rolling()
    assert after is not None
    assert after.needs == before.needs
    assert math.isnan(after.current[0])
