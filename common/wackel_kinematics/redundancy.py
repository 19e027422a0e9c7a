"""How much can still be checked after rows of suspected components are dropped.

A drive fault spoils the wheel's roll row, a steering fault both rows, for both depend on β_i.
"""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from wackel_kinematics.array import Floats, require_finite
from wackel_kinematics.drive import Drive
from wackel_kinematics.velocity_space import ALIGNED

_GYRO_ROW = np.array([[0.0, 0.0, 1.0]])


class Redundancy(NamedTuple):
    """Rows kept and the directions of the twist that they see."""

    rows: int
    rank: int

    @property
    def left(self) -> int:
        """Independent checks among the rows; at 0 no further fault can be seen."""
        return self.rows - self.rank

    @property
    def determined(self) -> bool:
        """Whether the rows still determine the whole twist."""
        return self.rank == 3


def redundancy(
    drive: Drive,
    steering: Floats,
    drives: Collection[int] = (),
    steerings: Collection[int] = (),
    gyro: bool = False,
) -> Redundancy:
    """What is left without the rows of the named components.

    Args:
        drive: The wheels.
        steering: β in rad, shape (n,): how much is left depends on the configuration.
        drives: Wheels, from 0, whose roll row is dropped.
        steerings: Wheels, from 0, of which both rows are dropped.
        gyro: Whether a gyro adds a row on ω.

    Raises:
        ValueError: A shape does not fit, a number is not finite, or there is no such wheel.
    """
    if unknown := {*drives, *steerings} - set(range(drive.n)):
        raise ValueError(f"no wheel {min(unknown)}, expected 0 to {drive.n - 1}")
    require_finite(steering, "steering")
    rolls = np.arange(len(drive.row_wheels)) >= drive.slide_count
    dropped = np.isin(drive.row_wheels, list(steerings))
    dropped |= rolls & np.isin(drive.row_wheels, list(drives))
    rows = drive.rows(steering)[~dropped]
    if gyro:
        rows = np.concatenate([rows, _GYRO_ROW])
    unit = drive.scaled_unit(rows)
    resistance = np.sqrt(np.maximum(np.linalg.eigvalsh(unit.T @ unit), 0.0))
    return Redundancy(len(rows), int((resistance >= ALIGNED).sum()))
