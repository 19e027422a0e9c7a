"""The true path of a robot, from a table: what a camera, motion capture or marks on the floor say.

CSV with a heading line that names the columns ``time`` (UTC, seconds since 1970), ``x``, ``y`` (m)
and ``theta`` (rad, left of the x axis); others are ignored. A line without numbers in all four is
a moment at which the robot was not seen.
"""

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wackel_kinematics.array import Floats, Ints

COLUMNS = ("time", "x", "y", "theta")
CLOSE_NS = 250_000_000
"""Between poses no further apart the robot is taken to move evenly: motion capture at 4 Hz at
least. Poses further apart from all others are marks, at which the robot stands."""
SAME_NS = 1_000
"""Within which a moment is that of a pose: as a float, a UTC time in seconds is right to 0.2 µs."""
MARK_NS = 20_000_000
"""How far from a mark's time a step of the wheels may end."""
FARTHEST = 1e6
"""m or rad; a pose beyond has no millimetres left."""
LATEST_S = 2**33
"""Of UTC, in the year 2242: a time beyond is in other units."""


class NoTruth(ValueError):
    """The table holds no path; the text says where it goes wrong."""


@dataclass(frozen=True)
class Truth:
    """True poses.

    Attributes:
        stamps: UTC ns, ascending, shape (k,).
        poses: [x, y, θ], m, m, rad, the last without jumps of a turn, shape (k, 3).
        unseen: How many lines of the table had no pose.
    """

    stamps: Ints
    poses: Floats
    unseen: int = 0

    @classmethod
    def parse(cls, lines: Iterable[str]) -> "Truth":
        """Reads a table.

        Raises:
            NoTruth: A column is missing, time does not go on, or there are fewer than two poses.
        """
        rows = csv.reader(lines)
        try:
            columns = _columns(next(rows, []))
            stamps: list[int] = []
            poses: list[list[float]] = []
            unseen = 0
            for row in rows:
                if not row:
                    continue
                time, *pose = (_number(row[at]) if at < len(row) else math.nan for at in columns)
                if not all(map(math.isfinite, (time, *pose))):
                    unseen += 1
                    continue
                if not 0 <= time < LATEST_S:
                    raise NoTruth(f"line {rows.line_num}: {time:g} is no time in seconds (UTC)")
                if max(map(abs, pose)) > FARTHEST:
                    raise NoTruth(
                        f"line {rows.line_num}: no pose in m and rad is beyond {FARTHEST:g}"
                    )
                stamp = round(time * 1e9)
                if stamps and stamp <= stamps[-1]:
                    raise NoTruth(f"line {rows.line_num}: its time is not after the one before")
                stamps.append(stamp)
                poses.append(pose)
        except csv.Error as error:
            raise NoTruth(f"line {rows.line_num}: {error}") from error
        if len(stamps) < 2:
            raise NoTruth(f"it needs 2 poses at least, and has {len(stamps)}")
        path = np.array(poses)
        path[:, 2] = np.unwrap(path[:, 2])
        return cls(np.array(stamps), path, unseen)

    def at(self, stamps: Ints) -> Floats:
        """The pose at some moments, ascending: NaN where it is not known.

        Args:
            stamps: UTC ns, shape (m,).

        Returns:
            Shape (m, 3).
        """
        # Relative to the first one: the numbers of UTC have no ns as floats.
        since, wanted = self.stamps - self.stamps[0], stamps - self.stamps[0]
        found = np.stack([np.interp(wanted, since, each) for each in self.poses.T], axis=-1)
        gaps = np.diff(since)
        before = np.clip(np.searchsorted(since, wanted) - 1, 0, len(gaps) - 1)
        to_rows = np.abs(wanted[:, None] - since[[before, before + 1]].T)
        outside = (wanted < 0) | (wanted > since[-1]) | (gaps[before] > CLOSE_NS)
        found[outside & (to_rows.min(axis=1) > SAME_NS)] = np.nan
        far = np.concatenate([[True], gaps > CLOSE_NS, [True]])
        for mark in np.flatnonzero(far[:-1] & far[1:]).tolist():
            nearest = int(np.abs(wanted - since[mark]).argmin())
            if abs(wanted[nearest] - since[mark]) <= MARK_NS:
                found[nearest] = self.poses[mark]
        return found


def _columns(heading: list[str]) -> list[int]:
    names = [name.strip().lower() for name in heading]
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise NoTruth(
            f"its first line must name the columns {', '.join(COLUMNS)}; "
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        )
    return [names.index(name) for name in COLUMNS]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
