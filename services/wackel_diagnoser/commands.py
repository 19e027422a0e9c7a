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
"""Within one command, either way round: no servo does that before the robot has moved."""
LASTING_S = 0.5
"""The centre of rotation may cross a contact; it must not stay there."""

# Squares, of speeds and of the sine of that turn.
_STANDSTILL, _MOVING, _AT_ONCE = STANDSTILL_M_S**2, MOVING_M_S**2, math.sin(AT_ONCE_RAD) ** 2


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


NO_COMMAND = Complaint("bad_input", "a velocity that is no number, or beyond any robot's", "")


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
        # Of each wheel that rolls, how the last command moves it: m/s ahead and to the left, and
        # the square of its speed.
        self._before: list[tuple[float, float, float] | None] = [None] * drive.n
        self._singular: tuple[str, float] | None = None
        self._stamp = 0

    def look(self, command: TwistCommand) -> Complaint | None:
        """What is wrong with a command, which holds from its stamp on."""
        vx, vy, omega = command.vx, command.vy, command.omega
        before_ns, self._stamp = self._stamp, command.stamp
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
        slow = (AT_CONTACT * size) ** 2 if size > MOVING_M_S else 0.0
        # Squares: of many commands hardly one is wrong, and roots and angles take longest.
        for i, x, y in self._steered:
            ux, uy = vx - omega * y, vy + omega * x
            square = ux * ux + uy * uy
            if _STANDSTILL < square < slow:
                singular = self._names[i]
            before = self._before[i]
            if not square > _MOVING:
                self._before[i] = None
                continue
            self._before[i] = ux, uy, square
            if before is None:
                continue
            across = before[0] * uy - before[1] * ux
            if across * across > _AT_ONCE * square * before[2]:
                turn = math.asin(min(abs(across) / math.sqrt(square * before[2]), 1.0))
                found = Complaint(
                    "command_infeasible",
                    f"wheel {self._names[i]} would have to turn by {math.degrees(turn):.0f}° "
                    f"at once while it rolls at {math.sqrt(square):.2f} m/s",
                    self._names[i],
                )
        if found is not None:
            return found
        if singular is None:
            self._singular = None
        elif self._singular is None or self._singular[0] != singular:
            self._singular = singular, 0.0
        else:
            seconds = min(max(command.stamp - before_ns, 0) / 1e9, LASTING_S)
            self._singular = singular, self._singular[1] + seconds
            if self._singular[1] >= LASTING_S:
                return Complaint("command_singular", "", singular)
        return None
