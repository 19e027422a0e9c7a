"""A gyro whose value is stuck."""

import pytest

from wackel_drive.stuck import LASTS_NS, SAMPLES, TURN, StuckValue

PERIOD_NS = 10_000_000
ENOUGH = max(SAMPLES, LASTS_NS // PERIOD_NS + 1)
VALUES = (0.01, -0.02, 0.3)


def stuck_after(samples: int, turn: float, period_ns: int = PERIOD_NS) -> bool:
    value = StuckValue()
    for number in range(samples):
        value.sample(number * period_ns, VALUES)
        value.turns(number * period_ns, turn * number / (samples - 1))
    return value.stuck


def test_the_same_value_again_and_again_while_the_robot_turns_is_stuck() -> None:
    assert stuck_after(ENOUGH, 1.01 * TURN)


@pytest.mark.parametrize(
    ("samples", "turn", "period_ns"),
    [
        (ENOUGH - 1, 1.0, PERIOD_NS),
        (ENOUGH, 0.99 * TURN, PERIOD_NS),
        (SAMPLES - 1, 1.0, LASTS_NS // 10),  # a slow gyro
        (10 * SAMPLES, 1.0, LASTS_NS // (11 * SAMPLES)),  # one that is read more often than it says
    ],
)
def test_less_is_not(samples: int, turn: float, period_ns: int) -> None:
    assert not stuck_after(samples, turn, period_ns)


def test_another_value_on_any_axis_begins_anew() -> None:
    value = StuckValue()
    for number in range(4 * ENOUGH):
        x, y, z = VALUES
        shown = (x + 0.001 * (number % ENOUGH == 0), y, z)
        value.sample(number * PERIOD_NS, shown)
        value.turns(number * PERIOD_NS, float(number))
        assert not value.stuck


def test_what_turns_while_nothing_is_sent_does_not_count() -> None:
    value = StuckValue()
    for number in range(ENOUGH):
        value.sample(number * PERIOD_NS, VALUES)
    value.turns(ENOUGH * PERIOD_NS, 0.0)
    value.turns(10 * ENOUGH * PERIOD_NS, 1.0)
    assert not value.stuck
