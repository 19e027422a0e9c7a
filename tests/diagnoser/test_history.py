"""The last seconds of each wheel: what they say of one that stands, of its steering, and of which
time."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from tests.odometry.simulation import steered_drive
from wackel_diagnoser.history import MOST_STEPS, History
from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import Measured, Rows, Spread
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_node.config_drive import GyroConfig
from wackel_virtual.drive_simulation import START_NS

STEP_NS = 10_000_000
WHEEL = 1


class Driven:
    """Three wheels, of which one may not do what it is told."""

    def __init__(self, begin: int = 0) -> None:
        config = steered_drive(3)
        layout = Layout(config)
        self.history = History(layout)
        self.end = begin
        rows = Rows(layout, config, {"body": GyroConfig()})
        nothing = np.zeros(rows.count)
        self._measured = Measured(
            nothing,
            np.zeros((rows.count, 3)),
            nothing[rows.gyros.start :].tolist(),
            [0.0] * 3,
            [0.0] * 3,
            0.0,
            0.0,
            False,
            rows.every,
            [0.0] * 3,
            [0.0] * 3,
            lambda: Spread(nothing, nothing, nothing),
        )

    def step(
        self, *, told: float = 0.0, heading: float = 0.0, speed: float = 0.5, rolled: float = 0.5
    ) -> None:
        """A step of that wheel; the others go straight on."""
        begin, self.end = self.end, self.end + STEP_NS
        still = [0.0] * 3
        shown, should = [0.0, heading, 0.0], [0.0, told, 0.0]
        rates = [0.5, speed, 0.5]
        step = Step(begin, self.end, STEP_NS / 1e9, shown, still, still, [0.0])
        target = Target(should, still, still, rates, still, still, should, (0.0, 0.0, 0.0), 0.0)
        self.history.add(step, target, replace(self._measured, rolled=[0.5, rolled, 0.5]))


@pytest.mark.parametrize("begin", [0, START_NS, 2**63 - 1, 2**63])
@pytest.mark.parametrize("steps", [20, 10 * MOST_STEPS + 7])
def test_a_wheel_stands_for_a_share_of_the_time_in_which_it_should_roll(
    steps: int, begin: int
) -> None:
    driven = Driven(begin)
    for _ in range(steps):
        driven.step()
    since = driven.end + STEP_NS // 2
    assert driven.history.standing_share(WHEEL, since) is None
    for rolled in (0.5, 0.04, -0.04, 0.5, 0.0):
        driven.step(rolled=rolled)
        driven.step(speed=0.02, rolled=0.0)  # too slow to tell
    assert driven.history.standing_share(WHEEL, since) == pytest.approx(0.6)
    assert driven.history.standing_share(WHEEL + 1, since) == 0.0


def test_what_is_longer_ago_than_it_holds_is_forgotten() -> None:
    driven = Driven()
    driven.step(rolled=0.0)
    for _ in range(MOST_STEPS - 1):
        driven.step()
    assert driven.history.standing_share(WHEEL, 0) == pytest.approx(1 / MOST_STEPS)
    driven.step()
    assert driven.history.standing_share(WHEEL, 0) == 0.0


def test_a_steering_is_frozen_that_stays_while_it_is_told_to_turn() -> None:
    driven = Driven()
    assert not driven.history.steering_frozen(WHEEL, 0)
    for angle in np.linspace(0.0, 0.3, 20).tolist():
        driven.step(told=angle, heading=0.1)
    since = driven.end + STEP_NS // 2
    assert driven.history.steering_frozen(WHEEL, 0)
    assert not driven.history.steering_frozen(WHEEL + 1, 0)  # nobody told it to turn
    for angle in np.linspace(0.0, 0.3, 20).tolist():
        driven.step(told=angle, heading=angle - 0.02)
    assert not driven.history.steering_frozen(WHEEL, since)


def test_how_far_a_steering_stands_off_is_the_mean_of_what_is_known() -> None:
    driven = Driven()
    assert driven.history.off(WHEEL, 0) == 0.0
    for heading in (0.1, math.nan, 0.2):
        driven.step(heading=heading)
    driven.step(told=math.nan, heading=0.2)
    assert driven.history.off(WHEEL, 0) == pytest.approx(0.15)
    assert driven.history.off(WHEEL, driven.end) == 0.0
