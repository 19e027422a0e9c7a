"""From a commanded twist to the goals of the servos, pure."""

import math
from collections.abc import Mapping

import numpy as np

from wackel_drive.layout import Layout, Servo
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_kinematics.inverse import inverse
from wackel_node.config_drive import DriveConfig
from wackel_pilot.path import Twist
from wackel_schemas.bus import ServoGoal

STEERING_REACH = math.pi
"""rad; where position mode of most servos ends."""


class Control:
    """Turns twists into goals; steering follows without jumps.

    Args:
        config: The drive.
        limits: Greatest velocities of driving servos, rad/s, as far as they are known.
    """

    def __init__(self, config: DriveConfig, limits: Mapping[Servo, float]) -> None:
        self.layout = Layout(config)
        drive = self.layout.drive
        self._limits = np.array(
            [
                math.inf if joint is None else limits.get(joint.servo, math.inf)
                for joint in self.layout.rolling
            ]
        )
        self._steering = drive.steering(np.zeros(drive.n))
        self._possible = _possible(drive)

    def step(self, twist: Twist) -> tuple[Twist, dict[str, list[ServoGoal]]]:
        """One cycle.

        Args:
            twist: What is wanted.

        Returns:
            The twist that is commanded, without what the drive cannot do and slower where a servo
            could not follow, and the goals by bus.
        """
        drive = self.layout.drive
        wanted = self._possible @ twist
        motion = inverse(drive, wanted, self._steering)
        share = float(np.min(self._limits / np.maximum(np.abs(motion.wheel_rate), 1e-9)))
        slower = min(1.0, share)
        self._steering = motion.steering
        headings = drive.heading(motion.steering).tolist()
        rates = (slower * motion.wheel_rate).tolist()
        goals: dict[str, list[ServoGoal]] = {}
        for wheel, joint in enumerate(self.layout.steering):
            if joint is None:
                continue
            angle = joint.sign * (headings[wheel] - joint.offset)
            if abs(angle) > STEERING_REACH:
                # The same line from the other side; the wheel then rolls backwards on it.
                turn = math.copysign(math.pi, angle)
                angle -= turn
                rates[wheel] = -rates[wheel]
                self._steering[wheel] -= joint.sign * turn
            goals.setdefault(joint.servo.bus, []).append(
                ServoGoal(id=joint.servo.id, position=angle)
            )
        for wheel, joint in enumerate(self.layout.rolling):
            if joint is not None:
                goals.setdefault(joint.servo.bus, []).append(
                    ServoGoal(id=joint.servo.id, velocity=joint.sign * rates[wheel])
                )
        vx, vy, omega = (slower * wanted).tolist()
        return (vx, vy, omega), goals


def _possible(drive: Drive) -> Floats:
    """What turns any twist into the nearest at which no wheel that cannot steer slides sideways,
    shape (3, 3)."""
    metric = np.array([1.0, 1.0, drive.length_m])  # all in m/s
    wheels = drive.slide_wheels
    slides = drive.rows(drive.steering(np.zeros(drive.n)))[: len(wheels)][~drive.steers[wheels]]
    slides = slides / metric
    return np.asarray((np.eye(3) - np.linalg.pinv(slides) @ slides) * metric / metric[:, None])
