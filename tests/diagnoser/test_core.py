"""The steps of a simulated robot's diagnoser, from messages to messages."""

import math

import numpy as np
import pytest

from tests.diagnoser.rig import SEED, Rig
from tests.odometry.simulation import differential_drive
from wackel_diagnoser.core import LOOK_EVERY
from wackel_schemas import component
from wackel_schemas.drive import TwistCommand


def test_a_differential_drive_cannot_go_sideways() -> None:
    rig = Rig.of(SEED, differential_drive())
    rig.drive(2.0, np.array([0.3, 0.0, 0.0]))
    rig.drive(0.5, np.array([0.3, 0.2, 0.0]))
    assert ("command_infeasible", component.COMMAND) in rig.active()
    rig.drive(1.0, np.array([0.3, 0.0, 0.0]))
    assert ("command_infeasible", component.COMMAND) not in rig.active()


def silent_control(rig: Rig, seconds: float) -> None:
    """It drives on, and nobody says what it was told."""
    for _ in range(round(100 * seconds)):
        cycle = rig.simulation.step(0.3, 0.0, 0.0)
        rig.cycles += 1
        rig.diagnoser.imu(rig.simulation.gyro, cycle.imu)
        rig.diagnoser.bus_state(rig.simulation.bus, cycle.state)


def test_what_is_wrong_with_a_command_ends_with_it() -> None:
    rig = Rig.of(SEED, differential_drive())
    rig.drive(2.0, np.array([0.3, 0.0, 0.0]))
    rig.drive(0.5, np.array([0.3, 0.2, 0.0]))
    assert ("command_infeasible", component.COMMAND) in rig.active()
    silent_control(rig, 1.0)
    assert rig.active() == []


def test_a_command_that_is_not_followed_is_none_once_there_is_no_command(warm: Rig) -> None:
    rig = warm.copy()
    for _ in range(200):
        cycle = rig.simulation.step(0.3, 0.0, 0.0)
        rig.cycles += 1
        told = TwistCommand(stamp=cycle.command.stamp, vx=-0.3, vy=0.0, omega=0.0)
        rig.diagnoser.command(told)
        rig.diagnoser.imu(rig.simulation.gyro, cycle.imu)
        rig.diagnoser.bus_state(rig.simulation.bus, cycle.state)
    assert rig.active() == [("command_not_followed", component.COMMAND)]
    silent_control(rig, 1.0)
    assert rig.active() == []


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e3])
def test_what_cannot_be_a_command_is_told(wrong: float) -> None:
    rig = Rig.of(SEED)
    rig.drive(1.0, np.array([0.3, 0.0, 0.0]))
    rig.diagnoser.command(TwistCommand(stamp=rig.now_ns, vx=wrong, vy=0.0, omega=0.0))
    rig.drive(0.2, np.array([0.3, 0.0, 0.0]))  # nor if sound ones follow
    assert rig.active() == [("bad_input", component.COMMAND)]
    silent_control(rig, 1.0)
    assert rig.active() == []


def test_a_turn_about_a_contact_is_singular(warm: Rig) -> None:
    rig = warm.copy()
    x, y = 0.3 * math.cos(math.pi / 4), 0.3 * math.sin(math.pi / 4)
    # The centre of rotation a centimetre beside the contact of w0.
    rig.drive(2.0, np.array([0.8 * (y + 0.01), -0.8 * x, 0.8]))
    found = [report for report in rig.reports if report.code == "command_singular"]
    assert found
    assert "w0" in found[0].message


def test_the_same_messages_give_the_same_conclusions() -> None:
    def conclusions() -> list[object]:
        rig = Rig.of("tune/again")
        rig.drive(3.0)
        rig.inject("wheel_blocked", "w1")
        rig.drive(1.0)
        return [rig.reports, rig.residuals]

    assert conclusions() == conclusions()


def test_who_looks_at_residuals_changes_no_conclusion() -> None:
    def conclusions(*, shown: bool) -> list[object]:
        rig = Rig.of("tune/again", shown=shown)
        rig.drive(12.0)
        rig.inject("drive_sensor_scale", "w1", 0.1)
        rig.drive(2.0)
        return [*rig.reports, rig.exclusions]

    unseen = conclusions(shown=False)
    assert len(unseen) > 1
    assert conclusions(shown=True) == unseen


def test_what_stirs_is_seen_in_whichever_step_it_begins(warm: Rig) -> None:
    """Though of calm steps only every fourth is looked at."""
    rig, delays = warm.copy(), []
    rig.drive(1.0, np.array([0.5, 0.0, 0.0]))
    for _ in range(LOOK_EVERY):
        rig.cycle(np.array([0.5, 0.0, 0.0]))
        faulty = rig.copy()
        faulty.inject("drive_sensor_stuck", "w1", None)
        begin = faulty.cycles
        while not faulty.active() and faulty.cycles < begin + 50:
            faulty.cycle(np.array([0.5, 0.0, 0.0]))
        delays.append(faulty.cycles - begin)
    assert max(delays) - min(delays) <= 1, delays
