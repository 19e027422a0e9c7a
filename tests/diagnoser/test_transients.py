"""How far drives are from their goals, as nobody tells."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from tests.diagnoser.driving import DRIVING
from tests.diagnoser.fleet import Member
from tests.diagnoser.rig import SHORT_WARM_UP_S, Rig
from tests.odometry.simulation import differential_drive, other_drives, steered_drive
from wackel_diagnoser.transients import LAG_S, SETTLING_S, Transients
from wackel_schemas.message import Message
from wackel_virtual.drive_simulation import Cycle

STEP_S = 0.01
DRIVES = {"steered": steered_drive(3), "differential": differential_drive(), **other_drives()}


class Untold(Rig):
    """A robot whose control publishes no command."""

    def feed(self, cycle: Cycle) -> Iterator[Message]:
        yield from self.diagnoser.imu(self.simulation.gyro, cycle.imu)
        yield from self.diagnoser.bus_state(self.simulation.bus, cycle.state)


def test_a_drive_that_follows_with_this_lag_is_as_far_off_as_it_seems() -> None:
    transients, shown, goal = Transients([0.0]), 0.0, 0.0
    fade = math.exp(-STEP_S / LAG_S)
    for number in range(300):
        goal = 0.3 * number * STEP_S  # a ramp, which it follows at its lag behind
        shown = goal + (shown - goal) * fade
        (gap,) = transients.step([shown], STEP_S)
    assert gap == pytest.approx(goal - shown, rel=0.15)


def test_what_has_ended_fades() -> None:
    transients = Transients([0.0])
    transients.step([0.0], STEP_S)
    (first,) = transients.step([1.0], STEP_S)
    assert first == pytest.approx(1.0)
    for _ in range(round(5 * SETTLING_S / STEP_S)):
        (gap,) = transients.step([1.0], STEP_S)
    assert 0.0 < gap < 0.01


def test_what_is_told_to_be_far_is_so_whatever_it_shows() -> None:
    transients = Transients([0.0, 0.0])
    transients.step([0.0, 0.0], STEP_S)
    assert transients.step([0.1, 0.1], STEP_S, [1.5, 0.0]) == pytest.approx([1.5, 0.1])
    assert transients.step([0.1, 0.1], STEP_S)[0] == pytest.approx(1.5, rel=0.1)


def test_rounding_is_no_motion() -> None:
    transients, rng = Transients([0.01]), np.random.default_rng(1)
    gaps = [transients.step([0.5 + rng.normal(0.0, 0.01)], STEP_S)[0] for _ in range(1000)]
    assert max(gaps) < 0.015
    assert sum(gap > 1e-3 for gap in gaps) < 100


def test_what_is_not_known_leaves_what_was() -> None:
    transients = Transients([0.0, 0.0])
    transients.step([math.nan, 1.0], STEP_S)
    assert transients.step([1.0, math.nan], STEP_S) == [0.0, 0.0]
    gaps = transients.step([3.0, 1.5], STEP_S)
    assert gaps == pytest.approx([2.0, 0.5])


@pytest.mark.parametrize("driving", [*DRIVING, "random"])
@pytest.mark.parametrize("name", ["steered", "differential", "ackermann", "mecanum"])
def test_a_sound_robot_whose_commands_are_not_known_has_no_fault(name: str, driving: str) -> None:
    robot = Untold.of(f"tune/untold/{name}", DRIVES[name], driving=driving)
    robot.drive(25.0)
    assert robot.reports == []


def test_a_wheel_that_turns_all_round_while_commands_are_missing_is_no_fault() -> None:
    rig = Member.of("473cdf606486db43", 107).rig()
    rig.drive(165.0)
    assert rig.reports == []


@pytest.mark.parametrize("kind", ["wheel_blocked", "drive_sensor_stuck", "steering_blocked"])
def test_what_wheels_contradict_each_other_by_is_seen_even_so(kind: str) -> None:
    robot = Untold.of("tune/untold/0", 4)
    robot.drive(SHORT_WARM_UP_S)
    assert robot.reports == []
    robot.inject(kind, "w2")
    robot.drive(5.0)
    part = "steering" if kind.startswith("steering") else "drive"
    assert {component for _, component in robot.active()} == {f"wheel/w2/{part}"}
