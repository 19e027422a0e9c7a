"""How much wheels may slip, though nothing is wrong: what no radius and no direction explains.

Tyres creep by what they push, and all of them alike, so readings that agree may be off together.
And wheels that turn to a new direction, each at its own time, pull each other across the floor
until they point where they should: how much they really do, their contradictions show.
"""

import math

from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats

CREEP_S = 0.01
"""Slip of a wheel by acceleration, m/s by m/s²: rubber creeps by 12 % of its speed where it skids,
at 6.5 m/s², and by a third of its share of that where it is loaded little (brush model). That is
0.006 of speed by m/s²; and as all wheels do it, no mean over them makes it less, so it counts twice
for each of four, at 1 m/s. With it, the pose is as far off as its covariance says."""
MOST_M_S2 = 3.0
"""Beyond what a servo robot does; more is a jump of the readings, and the less they were believed
for it, the later the estimate would follow."""
CHANGES_S = 0.1
"""Over which a change of motion is seen: of one step, encoders make 0.6 m/s²."""
STEERING_S = 0.08
"""How far behind its goal a steering is, by how fast it turns: the lag of a soft servo."""
SETTLING_S = 0.25
"""For how long it shows that one was, and wheels pull on: a servo that turns as fast as it can
takes longer than its lag."""
PULLED = 0.6
"""Of what wheels slide if they have to roll where they are going, at most the mean slip that they
force on each other."""
LASTS_S = 0.3
"""For how long wheels slip the same way: as long as a change of motion takes."""


class Slip:
    """Follows a drive.

    Args:
        layout: Its wheels.
    """

    def __init__(self, layout: Layout) -> None:
        drive = layout.drive
        self._length_m = drive.length_m
        # The steered wheel of each slide row.
        self._steered = [
            (row, wheel)
            for row, wheel in enumerate(drive.slide_wheels.tolist())
            if drive.steers[wheel]
        ]
        self._behind = [0.0] * drive.n  # how far the steering of each is, or was of late, rad
        self._usual = (0.0, 0.0, 0.0)  # the twist of late, m/s, m/s, rad/s

    def creep(self, twist: Floats, seconds: float) -> float:
        """Variance of what all wheels creep, (m/s)².

        Args:
            twist: Of the robot, m/s and rad/s.
            seconds: Since the last step.
        """
        vx, vy, omega = twist.tolist()
        x, y, turn = self._usual
        share = min(seconds / CHANGES_S, 1.0)
        self._usual = x + share * (vx - x), y + share * (vy - y), turn + share * (omega - turn)
        along = (vx - x) / CHANGES_S - vy * omega
        across = (vy - y) / CHANGES_S + vx * omega
        about = (omega - turn) / CHANGES_S * self._length_m
        hastens = min(math.hypot(along, across, about), MOST_M_S2)
        return (CREEP_S * hastens) ** 2

    def pull(self, sliding: list[float], turned: list[float], seconds: float) -> float:
        """The greatest variance that wheels which still turn can force on all, (m/s)².

        Args:
            sliding: Speed of the wheel of each slide row, m/s.
            turned: How far each wheel was steered in the step, rad; NaN if that is not known.
            seconds: How long it took.
        """
        fade, rate, total = math.exp(-seconds / SETTLING_S), STEERING_S / seconds, 0.0
        behind = self._behind
        for row, wheel in self._steered:
            was, now = fade * behind[wheel], rate * abs(turned[wheel])
            # What it was if it is not known how far it has turned.
            behind[wheel] = most = now if now > was else was
            total += (sliding[row] * most) ** 2
        return PULLED**2 * total / len(self._steered) if total else 0.0
