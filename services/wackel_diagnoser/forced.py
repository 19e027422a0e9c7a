"""How a robot moves whose wheels contradict each other: which of them slip, and which give way.

A wheel that points elsewhere than it shows forces the others to slip or to roll at another speed
than they are told. The motion is the one in which the friction of all wheels together gives the
robot the acceleration that is commanded. Friction is Coulomb's, smoothed by the creep of tyres;
drives give way by what they push. That is solved for all cases at once, with weights that follow
the slip (iteratively reweighted least squares).
"""

import numpy as np

from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive

GRIP_M_S2 = 6.5
"""All friction of a robot by its mass: rubber on a smooth floor, 0.7 of gravity."""
GIVES_WAY_M_S = 0.06
"""What a wheel loses of its speed when its drive pushes with all its grip: velocity control without
integral part."""
CREEP_M_S = 0.005
CREEP_SHARE = 0.02
"""Slip at which a tyre has most of its grip: at rest, and by the speed. Tyres of cars have 5 %,
small hard wheels less."""
GYRATION = 0.8
"""Radius of gyration by the mean distance of the wheels."""
ITERATIONS = 3
"""The fourth changes yaw rates by less than the floor does."""


class ForcedMotion:
    """Predicts it.

    Args:
        drive: Wheels that all steer, slide and roll.
    """

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self._n = drive.n
        length = drive.length_m
        self._inertia: Floats = np.array([1.0, 1.0, (GYRATION * length) ** 2])
        self._grip = GRIP_M_S2 / drive.n
        self._stiffness = self._grip / GIVES_WAY_M_S

    def predict(
        self, steering: Floats, speed: Floats, acceleration: Floats
    ) -> tuple[Floats, Floats]:
        """Yaw rates, rad/s, shape (K,), and rolling speeds of the wheels, m/s, shape (K, n).

        Args:
            steering: β of each wheel, in each of K cases, shape (K, n).
            speed: At which each wheel is told to roll, m/s, shape (n,).
            acceleration: Commanded, in the robot frame, shape (3,).
        """
        n, stiffness = self._n, self._stiffness
        rows = self._drive.rows(steering)
        across = np.swapaxes(rows, 1, 2)
        told = np.concatenate([np.zeros(n), speed])
        creep = CREEP_M_S**2 + (CREEP_SHARE * float(np.abs(speed).max())) ** 2
        inertia = self._inertia * acceleration
        normal = across @ rows
        right = across @ told
        rolled = np.broadcast_to(speed, steering.shape)
        weights = np.empty((len(steering), 2 * n))
        for _ in range(ITERATIONS):
            normal[:, [0, 1, 2], [0, 1, 2]] += 1e-6
            twist = np.linalg.solve(normal, right[:, :, None])
            over = (rows @ twist)[:, :, 0]
            slid, pushed = over[:, :n], rolled - over[:, n:]
            weight = self._grip / np.sqrt(slid * slid + pushed * pushed + creep)
            pull = weight * stiffness / (weight + stiffness)
            rolled = speed - pull * (speed - over[:, n:]) / stiffness
            weights[:, :n], weights[:, n:] = weight, pull
            weighted = across * weights[:, None, :]
            normal = weighted @ rows
            right = weighted @ told - inertia
        twist = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        over = (rows[:, n:] @ twist[:, :, None])[:, :, 0]
        return twist[:, 2], speed - weights[:, n:] * (speed - over) / stiffness
