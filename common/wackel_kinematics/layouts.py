"""Common drives by their dimensions. The robot frame's origin is stated for each.

A skid-steered robot is :func:`differential` with its effective track, which is found by turning on
the spot: its wheels slide by design, so their true slide rows would be wrong.
"""

import math

from wackel_kinematics.drive import Drive
from wackel_kinematics.wheel import Placement, castor, fixed, mecanum, omni, steered


def differential(track_m: float, radius_m: float, castor_x_m: float) -> Drive:
    """Wheels 0 left and 1 right of the origin, a free castor 2 on the x axis."""
    return Drive(
        [
            fixed(Placement.cartesian(0.0, track_m / 2), radius_m),
            fixed(Placement.cartesian(0.0, -track_m / 2), radius_m),
            castor(Placement.cartesian(castor_x_m, 0.0)),
        ]
    )


def tricycle(wheelbase_m: float, track_m: float, radius_m: float) -> Drive:
    """Wheel 0 steered and driven in front; 1 left and 2 right roll freely beside the origin."""
    return Drive(
        [
            steered(Placement.cartesian(wheelbase_m, 0.0), radius_m),
            fixed(Placement.cartesian(0.0, track_m / 2), None),
            fixed(Placement.cartesian(0.0, -track_m / 2), None),
        ]
    )


def ackermann(wheelbase_m: float, track_m: float, radius_m: float) -> Drive:
    """Wheels 0 and 1 steered in front, 2 and 3 driven beside the origin, each left then right."""
    return Drive(
        [
            steered(Placement.cartesian(wheelbase_m, track_m / 2), None),
            steered(Placement.cartesian(wheelbase_m, -track_m / 2), None),
            fixed(Placement.cartesian(0.0, track_m / 2), radius_m),
            fixed(Placement.cartesian(0.0, -track_m / 2), radius_m),
        ]
    )


def mecanum_rectangle(wheelbase_m: float, track_m: float, radius_m: float) -> Drive:
    """Front left, front right, rear left, rear right around the origin.

    Roller axes on the floor are square to the diagonals, so that turning has a lever; seen from
    above, the upper rollers form an X.
    """
    x, y, roller = wheelbase_m / 2, track_m / 2, math.pi / 4
    return Drive(
        [
            mecanum(Placement.cartesian(x, y), radius_m, -roller),
            mecanum(Placement.cartesian(x, -y), radius_m, roller),
            mecanum(Placement.cartesian(-x, y), radius_m, roller),
            mecanum(Placement.cartesian(-x, -y), radius_m, -roller),
        ]
    )


def omni_circle(count: int, l_m: float, radius_m: float) -> Drive:
    """Omni wheels evenly on a circle around the origin, the first on the x axis.

    Each rolls forward counter-clockwise.
    """
    angles = [2 * math.pi * i / count for i in range(count)]
    return Drive([omni(Placement(l_m, a), radius_m, a + math.pi / 2) for a in angles])
