"""Servos that were not heard for a while, and come back."""

import math

import pytest

from tests.diagnoser.rig import SHORT_WARM_UP_S, Rig
from tests.odometry.simulation import steered_drive
from wackel_diagnoser.absences import BACK_NS, MISSED_NS, READ_NS, Absences
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_schemas import component
from wackel_schemas.virtual import Injection

STEP_NS = 10_000_000


def step(number: int, *missing: int, wheels: int = 3) -> Step:
    """One of 10 ms in which the servos of some wheels say nothing."""
    shown = [math.nan if i in missing else 1.0 for i in range(wheels)]
    begin = number * STEP_NS
    return Step(begin, begin + STEP_NS, 0.01, shown, shown.copy(), shown.copy(), [0.0])


def test_who_is_always_heard_is_left_alone() -> None:
    absences = Absences(Layout(steered_drive(3)))
    first = step(0)
    assert absences.step(first) is first


def test_who_was_silent_for_a_moment_is_believed_at_once() -> None:
    absences = Absences(Layout(steered_drive(3)))
    for number in range(MISSED_NS // STEP_NS - 1):
        absences.step(step(number, 1))
    back = step(MISSED_NS // STEP_NS - 1)
    assert absences.step(back) is back


def test_who_comes_back_counts_as_absent_for_a_while() -> None:
    layout = Layout(steered_drive(3))
    absences = Absences(layout)
    silent = MISSED_NS // STEP_NS
    for number in range(silent):
        absences.step(step(number, 1))
    last = silent - 1 + BACK_NS // STEP_NS
    seen = absences.step(step(last - 1))
    assert [math.isnan(each) for each in seen.heading] == [False, True, False]
    assert [math.isnan(each) for each in seen.steered] == [False, True, False]
    assert [math.isnan(each) for each in seen.wheel_rate] == [False, True, False]
    assert absences.absent == ["wheel/w1/drive", "wheel/w1/steering"]
    assert absences.step(step(last)).heading == [1.0, 1.0, 1.0]
    assert absences.absent == []
    # And what is known of its torque may be older.
    wheels = layout.drive.roll_wheels
    assert absences.lasting(wheels, [True, True, False]) == [True, False, False]
    absences.step(step(last + READ_NS // STEP_NS))
    assert absences.lasting(wheels, [True, True, False]) == [True, True, False]


def test_a_clock_that_was_set_back_does_not_make_it_longer() -> None:
    absences = Absences(Layout(steered_drive(3)))
    for number in range(10**6, 10**6 + MISSED_NS // STEP_NS):
        absences.step(step(number, 0))
    assert absences.absent
    assert absences.step(step(0)).wheel_rate == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("missing", [("w1",), ("w0", "w1")], ids=len)
def test_steerings_that_could_not_be_told_are_not_blamed_for_standing_off(
    missing: tuple[str, ...],
) -> None:
    rig = Rig.of("tune/absent", 4)
    rig.drive(SHORT_WARM_UP_S)
    ids = {
        servo
        for wheel in rig.config.wheels
        if wheel.name in missing
        for servo in (wheel.drive, wheel.steering)
    }
    for name in missing:
        fault = Injection(kind="steering_blocked", wheel=name, duration_s=3.5)
        rig.simulation.inject(fault)
    back_ns = rig.now_ns + 300 * STEP_NS
    for _ in range(300):
        cycle = rig.simulation.step(*rig.path[rig.cycles % len(rig.path)].tolist())
        rig.cycles += 1
        cycle.state.servos = [each for each in cycle.state.servos if each.id not in ids]
        for message in rig.feed(cycle):
            rig.take(message)
    rig.drive(5.0)
    steerings = {component.wheel_steering(name) for name in missing}
    assert not steerings & {report.component for report in rig.reports}
    assert rig.active() == []
    # They drag the robot aside; what seems to do so instead is told with them.
    meanwhile = [each for each in rig.reports if each.status == "active" and each.stamp < back_ns]
    assert meanwhile
    assert all(steerings <= set(each.suspects) for each in meanwhile)
