"""How quickly drives follow, learnt from how they do."""

import math

import numpy as np
import pytest

from tests.odometry.simulation import differential_drive, steered_drive
from wackel_diagnoser.reference import FAR_RAD, Reference
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_node.config_drive import DriveConfig
from wackel_schemas.drive import TwistCommand

STEP_S = 0.01


class Straight:
    """A robot that drives ahead, whose wheels follow what they are told with a lag."""

    def __init__(self, config: DriveConfig) -> None:
        layout = Layout(config)
        self.reference = Reference(layout, config)
        self._radius = float(layout.drive.roll_radius[0])
        self._n = layout.drive.n
        self._heading: list[float] = np.where(layout.drive.steers, 0.0, np.nan).tolist()
        self._speed = 0.0
        self._now_ns = 1_000_000_000

    def drive(self, speed: float, seconds: float, lag_s: float, direction: float = 0.0) -> None:
        """Drives at a speed, m/s, for a while; told to go a little to the left of ahead, rad."""
        for _ in range(round(seconds / STEP_S)):
            begin, self._now_ns = self._now_ns, self._now_ns + round(STEP_S * 1e9)
            missing = speed - self._speed
            moved = -missing * math.expm1(-STEP_S / lag_s)
            mean = speed - lag_s / STEP_S * moved
            self._speed += moved
            rate = [mean / self._radius] * self._n
            self.reference.command(
                TwistCommand(stamp=begin, vx=speed, vy=speed * direction, omega=0.0)
            )
            step = Step(begin, self._now_ns, STEP_S, self._heading, self._heading, rate, [0.0])
            self.reference.step(step, STEP_S)

    def shuttle(self, seconds: float, lag_s: float) -> None:
        """Drives to and fro."""
        for turn in range(round(seconds / 0.5)):
            self.drive(0.3 * (-1) ** turn, 0.5, lag_s)


@pytest.mark.parametrize("config", [steered_drive(3), differential_drive()], ids=["3", "2 fixed"])
@pytest.mark.parametrize("lag_s", [0.015, 0.023, 0.05, 0.057, 0.12, 0.15])
def test_the_lag_of_a_drive_is_learnt(config: DriveConfig, lag_s: float) -> None:
    robot = Straight(config)
    robot.shuttle(5.0, lag_s)
    assert robot.reference.lags_s[1] == pytest.approx(lag_s, rel=0.05)


def test_one_start_after_a_rest_makes_no_drive_late() -> None:
    robot = Straight(steered_drive(3))
    robot.shuttle(5.0, 0.05)
    robot.drive(0.0, 60.0, 0.05)
    robot.drive(0.3, 1.0, 0.066)
    assert robot.reference.lags_s[1] == pytest.approx(0.05, rel=0.05)


def test_a_steering_told_to_turn_by_less_than_its_encoder_shows_is_not_late() -> None:
    config = steered_drive(3)
    robot = Straight(config)
    for turn in range(20):
        robot.drive(0.3 * (-1) ** turn, 0.5, 0.05, direction=config.encoder_step / 3)
    assert robot.reference.lags_s[0] == Straight(config).reference.lags_s[0]


def test_a_drive_that_became_slower_is_followed() -> None:
    robot = Straight(steered_drive(3))
    robot.shuttle(5.0, 0.05)
    robot.shuttle(15.0, 0.12)
    assert robot.reference.lags_s[1] == pytest.approx(0.12, rel=0.05)


def test_a_command_that_another_has_overtaken_is_not_followed() -> None:
    config = steered_drive(3)
    reference = Reference(Layout(config), config)
    still = [0.0] * 3
    for stamp_ms, vx in ((100, 0.3), (200, 0.5), (150, 0.1)):
        reference.command(TwistCommand(stamp=stamp_ms * 1_000_000, vx=vx, vy=0.0, omega=0.0))
        step = Step(300_000_000, 310_000_000, STEP_S, still, still, still, [0.0])
        twist = reference.step(step, 0.0).twist
    assert twist == (0.5, 0.0, 0.0)


@pytest.mark.parametrize("late_ns", [0, 2_000_000])
def test_a_steering_that_turns_faster_than_was_known_is_followed_from_where_it_began(
    late_ns: int,
) -> None:
    """By what it may have turned before a stamp that came late, it is behind."""
    config = steered_drive(3)
    reference = Reference(Layout(config), config)
    rate, still, end, heading = 6.28, [0.0] * 3, 10_000_000, 0.0
    for number in range(1, 115):
        way = math.radians(80.0) * (number >= 100)
        vx, vy = 0.3 * math.cos(way), 0.3 * math.sin(way)
        reference.command(TwistCommand(stamp=number * 10_000_000, vx=vx, vy=vy, omega=0.0))
        begin, end = end, (number + 1) * 10_000_000 + (number % 3 == 0) * late_ns
        turned = rate * STEP_S * (number >= 100)
        heading += turned
        step = Step(begin, end, (end - begin) / 1e9, [heading] * 3, [turned] * 3, still, [0.0])
        target = reference.step(step, 0.0)
    middle = heading - 0.5 * rate * STEP_S
    late_s = late_ns / 1e9
    assert target.heading == pytest.approx([middle] * 3, abs=rate * late_s + math.radians(0.5))


@pytest.mark.parametrize("lag_s", [0.02, 0.03, 0.08])
def test_steerings_show_their_lag_in_their_first_turns_and_not_only_how_fast_they_are(
    lag_s: float,
) -> None:
    config = steered_drive(3)
    reference = Reference(Layout(config), config)
    most, still, heading = 6.28 * STEP_S, [0.0] * 3, 0.0
    for number in range(1, 300):
        way = math.radians(70.0) * (100 <= number < 200)
        stamp = number * 10_000_000
        vx, vy = 0.3 * math.cos(way), 0.3 * math.sin(way)
        reference.command(TwistCommand(stamp=stamp, vx=vx, vy=vy, omega=0.0))
        turned = min(max((heading - way) * math.expm1(-STEP_S / lag_s), -most), most)
        held = abs(turned) == most
        middle = heading + turned / 2 if held else way - lag_s / STEP_S * turned
        heading += turned
        shown = [middle] * 3, [turned] * 3
        reference.step(Step(stamp, stamp + 10_000_000, STEP_S, *shown, still, [0.0]), STEP_S)
    assert reference.lags_s[0] == pytest.approx(lag_s, rel=0.1)


@pytest.mark.parametrize(("missing", "known"), [(0, True), (1, False), (5, False)])
def test_after_a_command_that_did_not_come_it_is_not_known_which_way_wheels_turn(
    missing: int, known: bool
) -> None:
    config = steered_drive(3)
    reference = Reference(Layout(config), config)
    still = [0.0] * 3
    for number in range(1, 200):
        begin = number * 10_000_000
        turned = number > 100
        way = math.radians(120.0) * turned
        if not 100 < number <= 100 + missing:
            vx, vy = 0.3 * math.cos(way), 0.3 * math.sin(way)
            reference.command(TwistCommand(stamp=begin, vx=vx, vy=vy, omega=0.0))
        step = Step(begin, begin + 10_000_000, STEP_S, [way] * 3, still, still, [0.0])
        target = reference.step(step, 0.0)
        if number in (100, 160):
            assert target.known
        if number == 101 + missing:
            assert target.known is known


@pytest.mark.parametrize(("missing", "known"), [(0, True), (1, False)])
def test_nor_is_it_where_a_wheel_goes_back_after_it(missing: int, known: bool) -> None:
    """It may have turned half round, either way, to do so."""
    config = steered_drive(3)
    reference = Reference(Layout(config), config)
    still = [0.0] * 3
    for number in range(1, 200):
        begin = number * 10_000_000
        if not 100 < number <= 100 + missing:
            vx = 0.02 if number <= 100 else -0.02
            reference.command(TwistCommand(stamp=begin, vx=vx, vy=0.0, omega=0.0))
        step = Step(begin, begin + 10_000_000, STEP_S, still, still, still, [0.0])
        target = reference.step(step, 0.0)
        if number in (100, 160):
            assert target.known
        if number == 101 + missing:
            assert target.known is known


def test_how_far_a_steering_has_yet_to_turn_is_not_known_while_it_turns_as_fast_as_it_can() -> None:
    """And only then, and only as long as no command tells."""
    config = steered_drive(3)
    reference = Reference(Layout(config), config)
    still, fast, heading = [0.0] * 3, 6.28 * STEP_S, 0.0
    for number in range(1, 250):
        begin = number * 10_000_000
        way = math.radians(80.0) * (number // 30 % 2)
        if number < 150:
            vx, vy = 0.3 * math.cos(way), 0.3 * math.sin(way)
            reference.command(TwistCommand(stamp=begin, vx=vx, vy=vy, omega=0.0))
            turned = [max(-fast, min(way - heading, fast))] * 3
        else:
            turned = [fast, -fast, 0.5 * fast]
        heading += turned[0]
        shown = [heading] * 3, turned, still, [0.0]
        target = reference.step(Step(begin, begin + 10_000_000, STEP_S, *shown), 0.0)
        if number == 120:
            assert target.known
            assert max(target.heading_gap) > 1.0
        if number == 149:
            assert target.known
            assert max(target.heading_gap) < 0.5
    assert not target.known
    assert target.heading_gap == [FAR_RAD, FAR_RAD, 0.0]


def test_where_commands_come_seldom_none_is_missing() -> None:
    config = steered_drive(3)
    reference = Reference(Layout(config), config)
    still = [0.0] * 3
    for number in range(1, 200):
        begin = number * 10_000_000
        if number % 10 == 1:
            way = math.radians(50.0) * (number // 10)
            vx, vy = 0.3 * math.cos(way), 0.3 * math.sin(way)
            reference.command(TwistCommand(stamp=begin, vx=vx, vy=vy, omega=0.0))
        step = Step(begin, begin + 10_000_000, STEP_S, still, still, still, [0.0])
        assert reference.step(step, 0.0).known
