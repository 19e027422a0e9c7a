"""Drives and twists that the tests of kinematics share."""

import math
from itertools import combinations

import numpy as np
from hypothesis import strategies as st

from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.wheel import Placement, steered


def ring(n: int, l_m: float = 0.3, radius_m: float = 0.05) -> Drive:
    """n steered wheels evenly around the origin, the first 0.1 rad left of straight ahead."""
    return Drive([steered(Placement(l_m, 0.1 + 2 * math.pi * i / n), radius_m) for i in range(n)])


def contact_speeds(drive: Drive, twist: Floats) -> Floats:
    """Speed of each contact point, m/s, from the definition of a twist."""
    vx, vy, omega = twist
    speeds: Floats = np.hypot(vx - omega * drive.xy[:, 1], vy + omega * drive.xy[:, 0])
    return speeds


def smallest_gap(drive: Drive) -> float:
    """Distance of the two closest contacts, m."""
    return min(float(np.linalg.norm(a - b)) for a, b in combinations(drive.xy, 2))


radii = st.floats(0.01, 0.2)
placements = st.builds(Placement, st.floats(0.05, 1.0), st.floats(-math.pi, math.pi))
steered_drives = (
    st.lists(st.builds(steered, placements, radii), min_size=3, max_size=8)
    .map(Drive)
    .filter(lambda drive: smallest_gap(drive) > 0.05)
)
"""3 to 8 steered wheels, none on top of another."""

twists = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3)).map(np.array)


@st.composite
def moving_drives(draw: st.DrawFn) -> tuple[Drive, Floats]:
    """A steered drive and a twist whose centre of rotation keeps away from every contact."""
    drive = draw(steered_drives)
    twist = draw(twists.filter(lambda twist: bool(contact_speeds(drive, twist).min() > 0.02)))
    return drive, twist


def steering_of(drive: Drive) -> st.SearchStrategy[Floats]:
    """Any steering angles, several turns away too."""
    return st.lists(st.floats(-20, 20), min_size=drive.n, max_size=drive.n).map(np.array)
