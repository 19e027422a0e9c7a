"""What drawings are made of: times, poses, colours. Refuses what cannot be drawn."""

import math
from collections.abc import Iterable

from foxglove.messages import Color, Duration, Point3, Pose, Quaternion, Timestamp, Vector3

from wackel_schemas.wire import Rejected

MOST_M = 1e6
"""What is drawn further away is a mistake."""
_MOST_S = 2**32 - 1  # a viewer's times have so many seconds

GOOD = Color(r=0.25, g=0.7, b=0.35, a=1.0)
DOUBTFUL = Color(r=0.95, g=0.65, b=0.1, a=1.0)
BAD = Color(r=0.9, g=0.15, b=0.15, a=1.0)
UNKNOWN = Color(r=0.55, g=0.55, b=0.55, a=1.0)
ACCENT = Color(r=0.2, g=0.45, b=0.9, a=1.0)
TEXT = Color(r=0.9, g=0.9, b=0.9, a=1.0)

FLEETING = Duration(sec=2)
"""What is not drawn again within this time vanishes: old news is no news."""


def timestamp(stamp_ns: int) -> Timestamp:
    """A stamp as viewers have it.

    Raises:
        Rejected: No calendar has it.
    """
    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    if not 0 <= seconds <= _MOST_S:
        raise Rejected(f"stamp {stamp_ns} is not within the years 1970 to 2106")
    return Timestamp(sec=seconds, nsec=rest)


def check(values: Iterable[float]) -> None:
    """Refuses what cannot be drawn.

    Raises:
        Rejected: A value is no number, or beyond all measure.
    """
    for value in values:
        if not abs(value) <= MOST_M:
            raise Rejected(f"{value} cannot be drawn")


def vector(x: float, y: float, z: float = 0.0) -> Vector3:
    """A vector."""
    return Vector3(x=x, y=y, z=z)


def point(x: float, y: float, z: float = 0.0) -> Point3:
    """A point."""
    return Point3(x=x, y=y, z=z)


def turned(angle: float) -> Quaternion:
    """A turn about z, rad."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(angle / 2), w=math.cos(angle / 2))


def planar(x: float, y: float, angle: float, z: float = 0.0) -> Pose:
    """A pose in the plane, at a height."""
    return Pose(position=vector(x, y, z), orientation=turned(angle))


def axle(x: float, y: float, z: float, heading: float) -> Pose:
    """A cylinder's pose whose axis lies across ``heading``: as a wheel's."""
    half, quarter = heading / 2, math.sqrt(0.5)
    return Pose(
        position=vector(x, y, z),
        orientation=Quaternion(
            x=math.cos(half) * quarter,
            y=math.sin(half) * quarter,
            z=math.sin(half) * quarter,
            w=math.cos(half) * quarter,
        ),
    )
