"""A body without contact physics: friction between each wheel and the floor, solved implicitly.

A wheel's friction is μ N s / √(|s|² + v₀²) for the slip s of its contact: creep while it grips,
Coulomb's law when it slides. The faster it rolls, the more it creeps (v₀ grows), as tyres do. A
driven wheel yields to its load by the droop of its motor.
Both make each constraint row (:class:`~wackel_kinematics.drive.Drive`) pull with a weight, so a
step is a weighted least squares problem in the twist: what the wheels with grip give. The weights
depend on the slip, hence a few iterations.
"""

import math

import numpy as np

from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_virtual.body import (
    DROOP_M_S,
    FRICTION,
    GRAVITY,
    GYRATION,
    MOST_EFFORT,
    WheelStates,
    World,
)

CREEP_M_S = 0.005
"""v₀ of a wheel that stands; only a number that keeps friction continuous."""
CREEP_SHARE = 0.02
"""v₀ by the rolling speed: about 1° of side slip for most of the grip. Tyres of cars have 5 %,
small hard wheels less."""
ROUGHNESS = 0.001
"""Of a floor: slip of each row by the robot's speed, standard deviation over 10 ms."""
ITERATIONS = 3


class FastBody:
    """See :class:`~wackel_virtual.body.Body`; everything per mass of the robot.

    Args:
        drive: The true wheels.
        seed: Of the floor's roughness.
    """

    def __init__(self, drive: Drive, seed: int) -> None:
        n = drive.n
        self.pose = np.zeros(3)
        self.twist = np.zeros(3)
        self.angle = np.zeros(n)
        self.rate = np.zeros(n)
        self.effort = np.zeros(n)
        self._drive = drive
        self._random = np.random.default_rng(seed)
        self._load = GRAVITY / n
        self._inertia = np.array([1.0, 1.0, (GYRATION * drive.length_m) ** 2])
        self._rolls = drive.roll_wheels
        # A tyre's contact slips along the row; rows of wheels with rollers are longer than 1.
        straight = drive.rows(drive.steering(np.zeros(n)))
        self._unit = (1.0 / np.hypot(straight[:, 0], straight[:, 1]))[:, None]
        self._lever = self._unit[drive.slide_count :, 0]
        self._radius = drive.roll_radius * self._lever
        # What a motor holds with, per mass, at the contact.
        self._stiffness = FRICTION * self._load / DROOP_M_S / self._lever**2
        self._row_wheels = drive.row_wheels
        self._contacts = np.zeros((n, len(drive.row_wheels)))
        self._contacts[drive.row_wheels, np.arange(len(drive.row_wheels))] = 1.0

    def step(self, wheels: WheelStates, world: World, duration_s: float) -> None:
        """Move on."""
        drive, slides, rolls = self._drive, self._drive.slide_count, self._rolls
        rows = drive.known_rows(drive.heading(wheels.steering).tolist())[0] * self._unit
        # Shares of 1 and 0: what holds each wheel's rolling.
        blocked: Floats = wheels.blocked[rolls].astype(np.float64)
        driven: Floats = wheels.driven[rolls] * (1.0 - blocked)
        held = driven + blocked
        wanted = self._radius * wheels.rate[rolls]
        aim = np.zeros(len(rows))
        aim[slides:] = driven * wanted
        speed = math.hypot(self.twist[0], self.twist[1])
        rough = ROUGHNESS * speed * math.sqrt(0.01 / duration_s)
        uneven = rough * self._random.standard_normal(len(rows))
        creep = CREEP_M_S**2 + (CREEP_SHARE * speed) ** 2
        grip = self._load * world.friction

        mass = self._inertia / duration_s
        before = self.twist
        vx, vy, omega = before.tolist()
        moving = mass * before + self._inertia * (omega * vy, -omega * vx, 0.0) + world.push
        even = aim - uneven
        yielding, free = driven * self._stiffness, 1.0 - held
        twist: Floats = before
        over_floor = (rows.dot(twist) + uneven)[slides:]
        rolled: Floats = aim[slides:]
        for _ in range(ITERATIONS):
            slip = even - rows.dot(twist)
            slip[slides:] = held * (rolled - over_floor)
            slip *= slip
            weight = (grip / np.sqrt(self._contacts.dot(slip) + creep)).take(self._row_wheels)
            roll = weight[slides:]
            roll *= yielding / (roll + self._stiffness) + blocked
            weighted = rows.T * weight
            twist = _solved(weighted.dot(rows), mass, moving + weighted.dot(even))
            over_floor = (rows.dot(twist) + uneven)[slides:]
            pull = roll * (aim[slides:] - over_floor)
            rolled = driven * (wanted - pull / self._stiffness) + free * over_floor
        self._take(twist, rolled / self._radius, duration_s)
        effort = driven * pull * self._lever / (FRICTION * self._load)
        # What a jammed motor would need is more than it has.
        jammed = blocked * wheels.driven[rolls] * wanted / self._lever / DROOP_M_S
        self.effort[rolls] = np.clip(effort + jammed, -MOST_EFFORT, MOST_EFFORT)

    def _take(self, twist: Floats, rate: Floats, duration_s: float) -> None:
        """The new state, rolled evenly since the last."""
        vx, vy, omega = (twist * duration_s).tolist()
        x, y, heading = self.pose.tolist()
        middle = heading + omega / 2
        cos, sin = math.cos(middle), math.sin(middle)
        self.pose = np.array([x + cos * vx - sin * vy, y + sin * vx + cos * vy, heading + omega])
        self.twist = twist
        self.rate[self._rolls] = rate
        self.angle[self._rolls] += rate * duration_s


def _solved(normal: Floats, diagonal: Floats, right: Floats) -> Floats:
    """x of (N + diag d) x = r, of which N is positive semidefinite and d positive.

    By elimination in single numbers: for three unknowns a library's call takes several times as
    long.
    """
    (a, b, c), (_, d, e), (_, _, f) = normal.tolist()
    more_a, more_d, more_f = diagonal.tolist()
    x, y, z = right.tolist()
    a += more_a
    ba, ca = b / a, c / a
    d += more_d - b * ba
    e -= c * ba
    ed = e / d
    f += more_f - c * ca - e * ed
    y -= x * ba
    z = (z - x * ca - y * ed) / f
    y = (y - e * z) / d
    return np.array(((x - b * y - c * z) / a, y, z))
