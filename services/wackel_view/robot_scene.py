"""The robot as a drawing: body, wheels in the colour of their verdict, velocity, path."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from foxglove.messages import (
    ArrowPrimitive,
    Color,
    CylinderPrimitive,
    FrameTransform,
    LinePrimitive,
    LinePrimitiveLineType,
    Pose,
    PosesInFrame,
    SceneEntity,
    SceneUpdate,
    TextPrimitive,
)

from wackel_node.config_drive import DriveConfig, WheelConfig, position
from wackel_schemas import component
from wackel_schemas.bus import BusState
from wackel_schemas.drive import Odometry
from wackel_schemas.health import FaultStatus
from wackel_view.drawing import (
    ACCENT,
    BAD,
    DOUBTFUL,
    FLEETING,
    GOOD,
    TEXT,
    UNKNOWN,
    axle,
    check,
    planar,
    point,
    timestamp,
    turned,
    vector,
)

WORLD, ROBOT = "odom", "base"
"""Frames, as ROS has them (REP-105)."""
PATH_STEP_M = 0.02
PATH_STEPS = 5000
"""100 m; older ones are forgotten."""
JUMP_M = 0.5
"""Further than a robot drives between two drawings: the pose was set, and a new path begins."""

_RANKED = (GOOD, DOUBTFUL, UNKNOWN, BAD)
_FINE, _DOUBTFUL, _UNKNOWN, _FAULTY = range(len(_RANKED))
_OF_FAULT = {"pending": _DOUBTFUL, "unknown": _UNKNOWN, "confirmed": _FAULTY}
_OF_INPUT = {"rejected": _DOUBTFUL, "missing": _UNKNOWN}


@dataclass(frozen=True)
class Trouble:
    """A fault of a component, as far as a drawing shows it.

    Attributes:
        code: Of the fault.
        status: Of the fault, which is not healed.
    """

    code: str
    status: FaultStatus


class RobotScene:
    """Draws one robot.

    Attributes:
        size: Mean distance of its wheels from its middle, m.
    """

    def __init__(self, drive: DriveConfig) -> None:
        self._wheels = drive.wheels
        places = [position(wheel) for wheel in drive.wheels]
        self.size = sum(math.hypot(x, y) for x, y in places) / len(places)
        self._outline = sorted(places, key=lambda place: math.atan2(place[1], place[0]))
        self._steered: dict[str, float] = {}
        self._path: deque[tuple[float, float, float]] = deque(maxlen=PATH_STEPS)

    def bus_state(self, bus: str, state: BusState) -> None:
        """Remembers where the wheels point to."""
        angles = {servo.id: servo.position for servo in state.servos}
        for wheel in self._wheels:
            if wheel.steering is None or (wheel.steering_bus or wheel.bus) != bus:
                continue
            angle = angles.get(wheel.steering)
            if angle is not None:
                check([angle])
                self._steered[wheel.name] = wheel.steering_direction * angle + wheel.steering_offset

    def draw(self, odometry: Odometry, troubles: Mapping[str, list[Trouble]]) -> SceneUpdate:
        """The robot as it is, in its own frame.

        Args:
            odometry: The latest.
            troubles: By component.

        Raises:
            Rejected: It cannot be drawn.
        """
        check([odometry.vx, odometry.vy, odometry.omega])
        stamp = timestamp(odometry.stamp)
        speed = math.hypot(odometry.vx, odometry.vy)
        body = SceneEntity(
            timestamp=stamp,
            frame_id=ROBOT,
            id="body",
            lifetime=FLEETING,
            frame_locked=True,
            lines=[
                LinePrimitive(
                    type=LinePrimitiveLineType.LineLoop,
                    thickness=0.02 * self.size,
                    points=[point(x, y, 0.2 * self.size) for x, y in self._outline],
                    color=GOOD if odometry.valid else UNKNOWN,
                )
            ],
            arrows=[
                ArrowPrimitive(
                    pose=planar(0.0, 0.0, math.atan2(odometry.vy, odometry.vx), 0.2 * self.size),
                    shaft_length=speed,
                    shaft_diameter=0.05 * self.size,
                    head_length=0.15 * self.size,
                    head_diameter=0.1 * self.size,
                    color=ACCENT,
                )
            ]
            if speed > 0.01
            else [],
            texts=[] if odometry.valid else [self._text(0.0, 0.0, odometry.reason)],
        )
        wheels = []
        for wheel in self._wheels:
            colour, words = self._verdict(wheel, odometry, troubles)
            x, y = position(wheel)
            wheels.append(
                SceneEntity(
                    timestamp=stamp,
                    frame_id=ROBOT,
                    id=f"wheel {wheel.name}",
                    lifetime=FLEETING,
                    frame_locked=True,
                    cylinders=[
                        CylinderPrimitive(
                            pose=axle(x, y, wheel.radius, self._heading(wheel)),
                            size=vector(2 * wheel.radius, 2 * wheel.radius, 0.6 * wheel.radius),
                            bottom_scale=1.0,
                            top_scale=1.0,
                            color=colour,
                        )
                    ],
                    texts=[self._text(x, y, words)],
                )
            )
        return SceneUpdate(entities=[body, *wheels])

    def place(self, odometry: Odometry) -> FrameTransform:
        """Where the robot is.

        Raises:
            Rejected: It cannot be drawn.
        """
        check([odometry.x, odometry.y, odometry.theta])
        return FrameTransform(
            timestamp=timestamp(odometry.stamp),
            parent_frame_id=WORLD,
            child_frame_id=ROBOT,
            translation=vector(odometry.x, odometry.y),
            rotation=turned(odometry.theta),
        )

    def went_on(self, odometry: Odometry) -> None:
        """Remembers where it has been."""
        here = odometry.x, odometry.y, odometry.theta
        if self._path:
            driven = math.dist(here[:2], self._path[-1][:2])
            if driven > JUMP_M:
                self._path.clear()
            elif driven < PATH_STEP_M:
                return
        self._path.append(here)

    def path(self, stamp: int) -> PosesInFrame:
        """Where it has been, as of a stamp.

        Raises:
            Rejected: The stamp is none.
        """
        poses: list[Pose] = [planar(*each) for each in self._path]
        return PosesInFrame(timestamp=timestamp(stamp), frame_id=WORLD, poses=poses)

    def _heading(self, wheel: WheelConfig) -> float:
        return self._steered.get(wheel.name, wheel.heading)

    def _verdict(
        self, wheel: WheelConfig, odometry: Odometry, troubles: Mapping[str, list[Trouble]]
    ) -> tuple[Color, str]:
        """Its colour, and what is written on it."""
        parts = {component.wheel_drive(wheel.name), component.wheel_steering(wheel.name)}
        worst, words = _FINE, [wheel.name]
        for part in [*sorted(parts), *(component.servo(*servo) for servo in wheel.servos())]:
            for trouble in troubles.get(part, ()):
                worst = max(worst, _OF_FAULT[trouble.status])
                words.append(trouble.code.replace("_", " "))
        for excluded in odometry.excluded:
            if excluded.component in parts:
                worst = _FAULTY
                words.append("not believed")
        for each in odometry.inputs:
            if each.name.startswith(f"wheel/{wheel.name}/"):
                worst = max(worst, _OF_INPUT.get(each.result, _FINE))
        return _RANKED[worst], "\n".join(dict.fromkeys(words))

    def _text(self, x: float, y: float, words: str) -> TextPrimitive:
        return TextPrimitive(
            pose=planar(x, y, 0.0, 0.6 * self.size),
            billboard=True,
            font_size=12.0,
            scale_invariant=True,
            color=TEXT,
            text=words,
        )
