"""How much the gyro's stamps are off those of the wheels, from how their yaw rates differ.

A gyro whose stamps are late by d shows ω(t − d) ≈ ω − d ω̇: its difference from the wheels, with
scale k and bias b, is k ω + b − d ω̇. The three are found by least squares with forgetting.
"""

import math
from typing import NamedTuple

from msgspec import Struct

from wackel_kinematics.array import cofactors

BLOCK_S = 0.05
"""Mean yaw rates over blocks of this length: an encoder step of a single cycle would drown ω̇."""
MEMORY_S = 30.0
"""Some turns to the left and to the right."""
EXCITATION = 1.0
"""Σ ω̇² dt in rad²/s³ from which on the offset can be told: two turns within MEMORY_S that start
or stop with 1 rad/s within half a second."""
LEAST_SIGMA_S = 0.002
"""What wheels that slip a little in every turn amount to."""
_DEFINITE = 1e-9, 0.0, 0.0, 1e-9, 0.0, 1e-9
"""A robot that only ever turned at one rate leaves k and b open."""


class Offset(NamedTuple):
    """By how much the gyro's stamps are late, s, and its standard deviation."""

    seconds: float
    sigma: float


class _Block(Struct, frozen=True, gc=False):
    seconds: float
    wheels: float  # rad turned
    gyro: float


class TimeOffset:
    """Estimates it for one gyro."""

    def __init__(self) -> None:
        self._seconds = self._wheels = self._gyro = 0.0  # of the block that is not whole yet
        self._blocks: list[_Block] = []
        # Normal equations of d, k and b: the upper triangle, row by row, then their right side, and
        # the square of what they are to explain. For three numbers, Python is faster than numpy.
        self._normal = [0.0] * 6
        self._right = [0.0] * 3
        self._square = 0.0
        self._count = 0.0

    def add(self, seconds: float, wheels: float, gyro: float) -> None:
        """Mean yaw rates of a step, rad/s; not a number where one is not known."""
        if not (math.isfinite(wheels) and math.isfinite(gyro)):
            self._seconds = self._wheels = self._gyro = 0.0
            self._blocks.clear()
            return
        self._seconds += seconds
        self._wheels += wheels * seconds
        self._gyro += gyro * seconds
        if self._seconds < BLOCK_S:
            return
        self._blocks.append(_Block(self._seconds, self._wheels, self._gyro))
        self._seconds = self._wheels = self._gyro = 0.0
        if len(self._blocks) == 3:
            self._learn(*self._blocks)
            del self._blocks[0]

    def estimate(self) -> Offset | None:
        """The offset; ``None`` as long as the robot has not turned enough to tell."""
        if self._normal[0] < EXCITATION:
            return None
        definite = [told + least for told, least in zip(self._normal, _DEFINITE, strict=True)]
        (p, q, r, s, t, u), determinant = cofactors(definite)
        if not determinant > 0.0:  # by rounding
            return None
        x, y, z = self._right
        late, scale, bias = p * x + q * y + r * z, q * x + s * y + t * z, r * x + t * y + u * z
        explained = (late * x + scale * y + bias * z) / determinant
        residual = max(self._square - explained, 0.0)
        # Normal equations are weighted by time; the residual's variance is per second, too.
        variance = residual / max(self._count - 3.0, 1.0) * p / determinant
        return Offset(-late / determinant, max(math.sqrt(max(variance, 0.0)), LEAST_SIGMA_S))

    def _learn(self, before: _Block, block: _Block, after: _Block) -> None:
        """Takes in the middle one of three blocks, with ω̇ from its neighbours.

        Taking ω̇ from the same block would set its noise against itself.
        """
        apart = before.seconds / 2 + block.seconds + after.seconds / 2
        omega = block.wheels / block.seconds
        rate = (after.wheels / after.seconds - before.wheels / before.seconds) / apart
        off = block.gyro / block.seconds - omega
        fade, seconds = math.exp(-block.seconds / MEMORY_S), block.seconds
        told = rate * rate, rate * omega, rate, omega * omega, omega, 1.0
        self._normal = [
            fade * total + seconds * new for total, new in zip(self._normal, told, strict=True)
        ]
        right = rate * off, omega * off, off
        self._right = [
            fade * total + seconds * new for total, new in zip(self._right, right, strict=True)
        ]
        self._square = fade * self._square + off * off * seconds
        self._count = fade * self._count + 1.0
