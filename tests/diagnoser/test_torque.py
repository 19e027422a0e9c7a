"""Which motors are off while others are on, from registers that are read once a second."""

import pytest

from wackel_diagnoser.torque import TorqueWatch

MOTORS = 4
PERIOD_S = 1.0


def named(switched: dict[int, list[tuple[float, bool]]], seconds: float) -> list[tuple[float, int]]:
    """When which motor is told to be off.

    Args:
        switched: Of each motor, when it is switched on or off; all are on at first.
        seconds: For how long they are read, in turn.
    """
    watch, found = TorqueWatch(MOTORS), []
    for reading in range(round(seconds * MOTORS / PERIOD_S)):
        now_s, motor = reading * PERIOD_S / MOTORS, reading % MOTORS
        on = True
        for at_s, state in switched.get(motor, []):
            on = state if now_s >= at_s else on
        before = watch.off
        watch.read(motor, on=on, stamp=round(now_s * 1e9))
        told = zip(before, watch.off, strict=True)
        found += [(now_s, each) for each, (was, off) in enumerate(told) if off and not was]
    return found


@pytest.mark.parametrize("motor", range(MOTORS))
@pytest.mark.parametrize("at_s", [5.0, 5.3, 5.6, 5.9])
def test_one_that_is_off_while_others_are_on_is_told_within_1_6_s(motor: int, at_s: float) -> None:
    ((told_s, told),) = named({motor: [(at_s, False)]}, 12.0)
    assert told == motor
    assert told_s - at_s < 1.6


@pytest.mark.parametrize("apart_s", [0.0, 0.05])
def test_all_that_are_switched_off_and_on_again_one_after_the_other_are_no_fault(
    apart_s: float,
) -> None:
    for phase in range(10):
        switched = {
            motor: [
                (5.0 + 0.1 * phase + apart_s * motor, False),
                (9.0 + 0.1 * phase + apart_s * motor, True),
            ]
            for motor in range(MOTORS)
        }
        assert named(switched, 15.0) == []


def test_it_is_sound_again_with_the_first_reading_that_says_on() -> None:
    watch = TorqueWatch(2)
    for second in range(4):
        watch.read(0, on=True, stamp=second * 10**9)
        watch.read(1, on=False, stamp=second * 10**9 + 1)
    assert watch.off == [False, True]
    watch.read(1, on=True, stamp=5 * 10**9)
    assert watch.off == [False, False]


def test_when_time_is_set_back_what_was_known_must_be_read_anew() -> None:
    watch = TorqueWatch(2)
    watch.read(0, on=True, stamp=100 * 10**9)
    watch.read(1, on=True, stamp=101 * 10**9)
    watch.read(1, on=False, stamp=10**9)
    assert watch.off == [False, False]
    for second in range(2, 4):
        watch.read(0, on=True, stamp=second * 10**9)
    watch.read(1, on=False, stamp=4 * 10**9)
    assert watch.off == [False, True]
