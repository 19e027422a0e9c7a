"""Commands that a drive cannot do."""

import math
import re

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.odometry.simulation import steered_drive
from wackel_diagnoser.commands import AT_ONCE_RAD, MOVING_M_S, CommandWatch, Complaint
from wackel_drive.layout import Layout
from wackel_schemas.drive import TwistCommand


def watched(*ways: tuple[float, float]) -> Complaint | None:
    """What is wrong with the last of some commands to go straight: speed, m/s, and way, rad."""
    watch = CommandWatch(Layout(steered_drive(3)))
    complaint = None
    for number, (speed, way) in enumerate(ways):
        vx, vy = speed * math.cos(way), speed * math.sin(way)
        command = TwistCommand(stamp=number * 10_000_000 + 1, vx=vx, vy=vy, omega=0.0)
        complaint = watch.look(command)
    return complaint


SPEEDS = st.floats(0.11, 2.0)
WAYS = st.floats(-math.pi, math.pi)


@given(SPEEDS, SPEEDS, WAYS, WAYS)
def test_a_wheel_must_not_turn_far_at_once_whichever_way_it_rolls(
    before: float, now: float, there: float, here: float
) -> None:
    turn = abs(math.remainder(here - there, math.pi))  # half a turn is to roll back
    assume(abs(turn - AT_ONCE_RAD) > 1e-6)
    complaint = watched((before, there), (now, here))
    if turn < AT_ONCE_RAD:
        assert complaint is None
    else:
        assert complaint is not None
        assert complaint.code == "command_infeasible"
        told = re.search(r" by (\d+)° at once while it rolls at ([\d.]+) m/s$", complaint.reason)
        assert told is not None
        assert float(told[1]) == pytest.approx(math.degrees(turn), abs=0.51)
        assert float(told[2]) == pytest.approx(now, abs=0.0051)


@pytest.mark.parametrize("slow", [0, 1])
def test_wheels_that_hardly_roll_may_turn(slow: int) -> None:
    speeds = [0.5, 0.5]
    speeds[slow] = 0.9 * MOVING_M_S
    assert watched((speeds[0], 0.0), (speeds[1], 1.0)) is None


def test_what_was_told_before_a_rest_does_not_count() -> None:
    assert watched((0.5, 0.0), (0.0, 0.0), (0.5, 1.0)) is None
