"""A body without contact physics: friction between each wheel and the floor, solved implicitly.

A wheel's friction is μ N s / √(|s|² + v₀²) for the slip s of its contact: creep while it grips,
Coulomb's law when it slides. The faster it rolls, the more it creeps (v₀ grows), as tyres do. A
driven wheel yields to its load by the droop of its motor.
Both make each constraint row (:class:`~wackel_kinematics.drive.Drive`) pull with a weight, so a
step is a weighted least squares problem in the twist: what the wheels with grip give. The weights
depend on the slip, hence a few iterations.
"""

import math
from typing import TypeAlias

import numpy as np

from wackel_kinematics.drive import Drive
from wackel_virtual.body import GRAVITY, MOST_EFFORT, InPlane, WheelStates, World
from wackel_virtual.build import Build

CREEP_M_S = 0.005
"""v₀ of a wheel that stands; only a number that keeps friction continuous."""
CREEP_SHARE = 0.02
"""v₀ by the rolling speed: about 1° of side slip for most of the grip. Tyres of cars have 5 %,
small hard wheels less."""
ROUGHNESS = 0.001
"""Of a floor: slip of each row by the robot's speed, standard deviation over 10 ms."""
ITERATIONS = 3

_Row: TypeAlias = tuple[float, float, float, float]
"""What a row sees of the twist, by its three parts, and what it should see."""


class FastBody:
    """See :class:`~wackel_virtual.body.Body`; everything per mass of the robot.

    Args:
        drive: The true wheels.
        seed: Of the floor's roughness.
        build: What else it is like.
    """

    def __init__(self, drive: Drive, seed: int, build: Build) -> None:
        n = drive.n
        self.pose: InPlane = (0.0, 0.0, 0.0)
        self.twist: InPlane = (0.0, 0.0, 0.0)
        self.angle = [0.0] * n
        self.rate = [0.0] * n
        self.effort = [0.0] * n
        self._drive = drive
        self._random = np.random.default_rng(seed)
        self._load = GRAVITY / n
        self._moment = (build.gyration * drive.length_m) ** 2
        slides = {wheel: row for row, wheel in enumerate(drive.slide_wheels.tolist())}
        rolls = {wheel: row for row, wheel in enumerate(drive.roll_wheels.tolist(), len(slides))}
        self._rows = [(slides.get(i), rolls.get(i)) for i in range(n)]
        # A tyre slips along its row; rows of wheels with rollers are longer than 1.
        straight = drive.rows(drive.steering(np.zeros(n)))
        self._unit = 1.0 / np.hypot(straight[:, 0], straight[:, 1])[:, None]
        levers = self._unit[:, 0].tolist()
        self._rolling = [
            (i, rolls[i], wheel.radius_m * levers[rolls[i]], levers[rolls[i]])
            for i, wheel in enumerate(drive.wheels)
            if wheel.radius_m is not None
        ]
        self._grip = build.friction * self._load
        self._droop_m_s = build.droop_m_s
        self._droop = [build.droop_m_s / self._grip] * n  # m/s per force
        for i, _, _, lever in self._rolling:
            self._droop[i] *= lever * lever

    def step(self, wheels: WheelStates, world: World, duration_s: float) -> None:
        """Move on."""
        vx, vy, omega = self.twist
        speed = math.hypot(vx, vy)
        creep = CREEP_M_S**2 + (CREEP_SHARE * speed) ** 2
        grips = [self._load * friction for friction in world.friction]
        droops = self._droops(wheels)
        wanted = self._wanted(wheels)
        rough = ROUGHNESS * speed * math.sqrt(0.01 / duration_s)
        rows = self._seen(wheels.heading, wanted, rough)

        mass = 1.0 / duration_s, 1.0 / duration_s, self._moment / duration_s
        push_x, push_y, push_round = world.push
        # Its velocity stays as the robot turns under it: exactly, or who spins would hasten.
        cos, sin = math.cos(omega * duration_s), math.sin(omega * duration_s)
        moving = (
            mass[0] * (cos * vx + sin * vy) + push_x,
            mass[1] * (cos * vy - sin * vx) + push_y,
            mass[2] * omega + push_round,
        )
        off = _off(rows, self.twist)
        slips = [0.0 if droop == math.inf else 1.0 for droop in droops]
        for _ in range(ITERATIONS):
            weights, slips = self._weighed(off, slips, droops, grips, creep)
            twist = _solved(rows, weights, mass, moving)
            off = _off(rows, twist)
        self.effort = self._efforts(wheels, weights, off)
        self._take(twist, self._rates(wanted, slips, off), duration_s)

    def _droops(self, wheels: WheelStates) -> list[float]:
        """How much the rolling of each wheel yields, m/s per force: without end if it is free."""
        return [
            0.0 if blocked else droop if driven else math.inf
            for blocked, driven, droop in zip(
                wheels.blocked, wheels.driven, self._droop, strict=True
            )
        ]

    def _wanted(self, wheels: WheelStates) -> list[float]:
        """What each row should see: the goal of a motor, where it turns, and else no motion."""
        wanted = [0.0] * len(self._drive.row_wheels)
        for i, row, radius, _ in self._rolling:
            if wheels.driven[i] and not wheels.blocked[i]:
                wanted[row] = radius * wheels.rate[i]
        return wanted

    def _seen(self, heading: list[float], wanted: list[float], rough: float) -> list[_Row]:
        """The rows of wheels along these headings, on a floor that is rough, m/s."""
        rows = (self._drive.known_rows(heading)[0] * self._unit).tolist()
        bumps = self._random.standard_normal(len(rows)).tolist()
        return [
            (along, left, turn, should - rough * bump)
            for (along, left, turn), should, bump in zip(rows, wanted, bumps, strict=True)
        ]

    def _weighed(
        self,
        off: list[float],
        slips: list[float],
        droops: list[float],
        grips: list[float],
        creep: float,
    ) -> tuple[list[float], list[float]]:
        """With which weight each row pulls, and the slips that follow.

        What a roll row lacks, the tyre slips and the motor yields, both under the same force.

        Args:
            off: What rows lack.
            slips: Which share of that the tyre of each wheel slips.
            droops: How much its rolling yields.
            grips: Its greatest friction.
            creep: v₀².
        """
        weights, shares = [0.0] * len(off), [0.0] * len(slips)
        for i, (slide, roll) in enumerate(self._rows):
            square = creep
            if slide is not None:
                square += off[slide] * off[slide]
            if roll is not None:
                slip = slips[i] * off[roll]
                square += slip * slip
            weight = grips[i] / math.sqrt(square)
            if slide is not None:
                weights[slide] = weight
            if roll is not None:
                shares[i] = 1.0 / (1.0 + weight * droops[i])
                weights[roll] = weight * shares[i]
        return weights, shares

    def _rates(self, wanted: list[float], slips: list[float], off: list[float]) -> list[float]:
        """At which the wheels roll, rad/s."""
        rates = [0.0] * len(slips)
        for i, row, radius, _ in self._rolling:
            rates[i] = (wanted[row] - (1.0 - slips[i]) * off[row]) / radius
        return rates

    def _efforts(self, wheels: WheelStates, weights: list[float], off: list[float]) -> list[float]:
        efforts = [0.0] * len(self._rows)
        for i, row, radius, lever in self._rolling:
            if not wheels.driven[i]:
                continue
            if wheels.blocked[i]:
                # What a jammed motor would need is more than it has.
                effort = radius / lever * wheels.rate[i] / self._droop_m_s
            else:
                effort = lever * weights[row] * off[row] / self._grip
            efforts[i] = min(MOST_EFFORT, max(-MOST_EFFORT, effort))
        return efforts

    def _take(self, twist: InPlane, rates: list[float], duration_s: float) -> None:
        """The new state, moved evenly since the last."""
        vx, vy, omega = (part * duration_s for part in twist)
        x, y, heading = self.pose
        middle = heading + omega / 2
        cos, sin = math.cos(middle), math.sin(middle)
        self.pose = (x + cos * vx - sin * vy, y + sin * vx + cos * vy, heading + omega)
        self.twist = twist
        self.rate = rates
        self.angle = [
            angle + rate * duration_s for angle, rate in zip(self.angle, rates, strict=True)
        ]


def _off(rows: list[_Row], twist: InPlane) -> list[float]:
    """What each row lacks: should see and does not."""
    vx, vy, omega = twist
    return [should - along * vx - left * vy - turn * omega for along, left, turn, should in rows]


def _solved(rows: list[_Row], weights: list[float], mass: InPlane, moving: InPlane) -> InPlane:
    """The twist in which what moves and the rows' pull are in balance.

    It is x of (JᵀWJ + diag m) x = JᵀWs + r, by elimination: m is positive, and JᵀWJ positive
    semidefinite.

    Args:
        rows: J, and s behind it.
        weights: W.
        mass: m.
        moving: r.
    """
    a, d, f = mass
    x, y, z = moving
    b = c = e = 0.0
    for (along, left, turn, should), weight in zip(rows, weights, strict=True):
        p, q, r = weight * along, weight * left, weight * turn
        a += p * along
        b += p * left
        c += p * turn
        d += q * left
        e += q * turn
        f += r * turn
        x += p * should
        y += q * should
        z += r * should
    ba, ca = b / a, c / a
    d -= b * ba
    e -= c * ba
    ed = e / d
    f -= c * ca + e * ed
    y -= x * ba
    z = (z - x * ca - y * ed) / f
    y = (y - e * z) / d
    return (x - b * y - c * z) / a, y, z
