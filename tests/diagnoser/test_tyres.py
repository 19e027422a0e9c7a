"""What tyres hold, against Newton: a wheel pushes with no more than its share of the weight."""

import math

import numpy as np
import pytest

from tests.odometry.simulation import differential_drive, other_drives, steered_drive
from wackel_diagnoser.tyres import HOLDS_M_S2, Tyres
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_node.config_drive import DriveConfig

STEP_S = 0.01


def late_s(config: DriveConfig, twist: tuple[float, float, float]) -> float:
    """For how long a robot at rest skids that is told a twist all at once."""
    drive = Layout(config).drive
    headings = _along(drive, twist)
    rows = drive.known_rows(headings)[0]
    tyres = Tyres(drive)
    tyres.creep(rows, [0.0] * 3, 0.0, 0.0, STEP_S)
    steps = 0
    while tyres.creep(rows, twist, 0.0, 0.0, STEP_S) > 0.0:
        steps += 1
        assert steps < 1000
    return steps * STEP_S


def _along(drive: Drive, twist: tuple[float, float, float]) -> list[float]:
    vx, vy, omega = twist
    wanted = [math.atan2(vy + omega * x, vx - omega * y) for x, y in drive.xy.tolist()]
    mounted: list[float] = drive.heading(np.zeros(drive.n)).tolist()
    return [
        should if steers else is_
        for should, is_, steers in zip(wanted, mounted, drive.steers, strict=True)
    ]


@pytest.mark.parametrize(
    ("name", "twist", "share"),
    [
        ("steered", (1.0, 0.0, 0.0), 1.0),
        ("steered", (0.6, -0.8, 0.0), 1.0),
        ("differential", (1.0, 0.0, 0.0), 1.0),
        ("tricycle", (1.0, 0.0, 0.0), 1 / 3),  # one wheel of three pushes
        ("ackermann", (1.0, 0.0, 0.0), 1 / 2),
        # Rollers at 45° push along their axes only.
        ("mecanum", (1.0, 0.0, 0.0), math.sqrt(0.5)),
        ("mecanum", (0.0, 1.0, 0.0), math.sqrt(0.5)),
        # Two of three push, at 30°; or one along and the others, which hold it straight, at 60°.
        ("omni", (1.0, 0.0, 0.0), 1 / math.sqrt(3)),
        ("omni", (0.0, 1.0, 0.0), 1 / 2),
    ],
)
def test_a_robot_that_is_told_to_jump_is_late_by_what_its_wheels_hold(
    name: str, twist: tuple[float, float, float], share: float
) -> None:
    drives = {"steered": steered_drive(4), "differential": differential_drive(), **other_drives()}
    expected = math.hypot(*twist) / (share * HOLDS_M_S2)
    assert late_s(drives[name], twist) == pytest.approx(expected, abs=1.5 * STEP_S)


def test_nothing_is_known_of_tyres_when_references_are_not() -> None:
    drive = Layout(steered_drive(3)).drive
    tyres = Tyres(drive)
    rows: Floats = drive.rows(np.zeros(3))
    assert tyres.creep(rows, [1.0, 0.0, 0.0], 0.0, 1.0, STEP_S) == 0.0
    assert tyres.creep(rows, [2.0, 0.0, 0.0], 0.0, 1.0, STEP_S) > 0.5
    assert tyres.creep(rows, [math.nan] * 3, 0.0, 1.0, STEP_S) == 0.0
    assert tyres.creep(rows, [0.0] * 3, 0.0, 1.0, STEP_S) == 0.0


def test_a_change_too_small_for_floats_is_no_trouble() -> None:
    drive = Layout(other_drives()["omni"]).drive
    tyres, rows = Tyres(drive), drive.rows(np.zeros(3))
    tyres.creep(rows, [0.0] * 3, 0.0, 0.0, STEP_S)
    assert tyres.creep(rows, [1e-300] * 3, 0.0, 0.0, STEP_S) == pytest.approx(0.0)
