"""The steps of a simulated robot's diagnoser, from messages to messages."""

import math

import numpy as np

from tests.diagnoser.rig import SEED, Rig
from tests.odometry.simulation import differential_drive
from wackel_schemas import component


def test_a_differential_drive_cannot_go_sideways() -> None:
    rig = Rig.of(SEED, differential_drive())
    rig.drive(2.0, np.array([0.3, 0.0, 0.0]))
    rig.drive(0.5, np.array([0.3, 0.2, 0.0]))
    assert ("command_infeasible", component.COMMAND) in rig.active()
    rig.drive(1.0, np.array([0.3, 0.0, 0.0]))
    assert ("command_infeasible", component.COMMAND) not in rig.active()


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
