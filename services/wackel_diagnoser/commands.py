"""Commands that this drive cannot do: Step I applied to what is asked, before anything moves."""

import math
from dataclasses import dataclass

from wackel_drive.layout import Layout
from wackel_kinematics.candidates import AT_CONTACT
from wackel_kinematics.inverse import STANDSTILL_M_S
from wackel_schemas.drive import TwistCommand

SIDEWAYS = 0.05
"""Share of the robot's speed by which a command may drag a wheel sideways: planners round."""
DRAGGED_M_S = 0.02
MOVING_M_S = 0.1
"""A wheel that rolls slower may be turned on the spot."""
AT_ONCE_RAD = math.radians(30.0)
"""Within one command: no servo does that before the robot has moved."""
LASTING_S = 0.5
"""The centre of rotation may cross a contact; it must not stay there."""


@dataclass(frozen=True)
class Complaint:
    """What is wrong with a command.

    Attributes:
        code: A key of the fault codes.
        reason: For the text, if the code needs one.
        wheel: Which is concerned.
    """

    code: str
    reason: str
    wheel: str


class CommandWatch:
    """Looks at each command."""

    def __init__(self, layout: Layout) -> None:
        drive = layout.drive
        self._names = layout.names
        self._steered = [(i, x, y) for i, (x, y) in enumerate(drive.xy.tolist()) if drive.steers[i]]
        slides = drive.slide_wheels.tolist()
        rows = drive.rows(drive.steering(drive.heading(drive.beta(drive.alpha * 0.0))))
        self._fixed = [
            (i, rows[row].tolist()) for row, i in enumerate(slides) if not drive.steers[i]
        ]
        self._length_m = drive.length_m
        self._directions = [math.nan] * drive.n
        self._singular: tuple[str, float] | None = None
        self._stamp = 0

    def look(self, command: TwistCommand) -> Complaint | None:
        """What is wrong with a command, which holds from its stamp on."""
        vx, vy, omega = command.vx, command.vy, command.omega
        seconds = min(max(command.stamp - self._stamp, 0) / 1e9, LASTING_S)
        self._stamp = command.stamp
        size = math.hypot(vx, vy, self._length_m * omega)
        for i, (a, b, c) in self._fixed:
            sideways = abs(a * vx + b * vy + c * omega)
            if sideways > max(SIDEWAYS * size, DRAGGED_M_S):
                return Complaint(
                    "command_infeasible",
                    f"wheel {self._names[i]} would slide sideways at {sideways:.2f} m/s",
                    self._names[i],
                )
        singular = found = None
        slow, directions = AT_CONTACT * size if size > MOVING_M_S else 0.0, self._directions
        for i, x, y in self._steered:
            ux, uy = vx - omega * y, vy + omega * x
            speed = math.hypot(ux, uy)
            if STANDSTILL_M_S < speed < slow:
                singular = self._names[i]
            direction = math.atan2(uy, ux) if speed > MOVING_M_S else math.nan
            turn, directions[i] = abs(direction - directions[i]), direction
            if turn > AT_ONCE_RAD:  # not so if either is not known
                turn = abs(turn - math.pi * round(turn / math.pi))
            if turn > AT_ONCE_RAD:
                found = Complaint(
                    "command_infeasible",
                    f"wheel {self._names[i]} would have to turn by {math.degrees(turn):.0f}° "
                    f"at once while it rolls at {speed:.2f} m/s",
                    self._names[i],
                )
        if found is not None:
            return found
        if singular is None:
            self._singular = None
        elif self._singular is None or self._singular[0] != singular:
            self._singular = singular, 0.0
        else:
            self._singular = singular, self._singular[1] + seconds
            if self._singular[1] >= LASTING_S:
                return Complaint("command_singular", "", singular)
        return None
