"""The velocity space of the diagnosis: what the wheels say, what was asked for, what was measured.

Axes: vx and vy in m/s, and omega times the robot's size in m/s, so that all three compare.
"""

from foxglove.messages import (
    Color,
    FrameTransform,
    LinePrimitive,
    LinePrimitiveLineType,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Timestamp,
)

from wackel_schemas.drive import Odometry
from wackel_schemas.residuals import Residuals
from wackel_schemas.wire import Rejected
from wackel_view.drawing import (
    ACCENT,
    BAD,
    FLEETING,
    GOOD,
    TEXT,
    UNKNOWN,
    check,
    planar,
    point,
    timestamp,
    vector,
)

FRAME, COMMAND = "velocity", "command"
DOT_M_S = 0.02
AXIS_M_S = 1.0


class VelocityScene:
    """Draws candidates; ``size_m`` is the robot's, by which omega is multiplied."""

    def __init__(self, size_m: float) -> None:
        self._size_m = size_m

    def draw(self, residuals: Residuals, odometry: Odometry | None) -> SceneUpdate:
        """All of it; what a candidate does not determine is left out.

        Raises:
            Rejected: It cannot be drawn.
        """
        stamp = timestamp(residuals.stamp)
        entities = [self._axes(stamp)]
        if residuals.commanded is not None:
            entities.append(self._dot(stamp, "commanded", residuals.commanded, ACCENT, 1.6))
        if odometry is not None and odometry.valid:
            twist = [odometry.vx, odometry.vy, odometry.omega]
            entities.append(self._dot(stamp, "odometry", twist, TEXT, 1.2))
        for each in residuals.candidates:
            if each.vx is None or each.vy is None or each.omega is None:
                continue
            colour = UNKNOWN if each.singular else BAD if each.deviates else GOOD
            twist = [each.vx, each.vy, each.omega]
            entities.append(self._dot(stamp, each.name, twist, colour, 1.0))
        return SceneUpdate(entities=entities)

    def place(self, residuals: Residuals) -> FrameTransform:
        """The frame, and where the command lies in it.

        Raises:
            Rejected: It cannot be drawn.
        """
        return FrameTransform(
            timestamp=timestamp(residuals.stamp),
            parent_frame_id=FRAME,
            child_frame_id=COMMAND,
            translation=vector(*self._place(residuals.commanded or [0.0, 0.0, 0.0])),
        )

    def _place(self, twist: list[float]) -> tuple[float, float, float]:
        check(twist)
        if len(twist) != 3:
            raise Rejected(f"a twist has 3 numbers, not {len(twist)}")
        vx, vy, omega = twist
        return vx, vy, omega * self._size_m

    def _dot(
        self, stamp: Timestamp, name: str, twist: list[float], colour: Color, size: float
    ) -> SceneEntity:
        x, y, z = self._place(twist)
        pose = planar(x, y, 0.0, z)
        diameter = size * DOT_M_S
        return SceneEntity(
            timestamp=stamp,
            frame_id=FRAME,
            id=name,
            lifetime=FLEETING,
            spheres=[
                SpherePrimitive(pose=pose, size=vector(diameter, diameter, diameter), color=colour)
            ],
            texts=[
                TextPrimitive(
                    pose=pose,
                    billboard=True,
                    font_size=11.0,
                    scale_invariant=True,
                    color=TEXT,
                    text=name,
                )
            ],
        )

    def _axes(self, stamp: Timestamp) -> SceneEntity:
        ends = {
            "vx": (AXIS_M_S, 0.0, 0.0),
            "vy": (0.0, AXIS_M_S, 0.0),
            f"omega · {self._size_m:.2g} m": (0.0, 0.0, AXIS_M_S),
        }
        return SceneEntity(
            timestamp=stamp,
            frame_id=FRAME,
            id="axes",
            lifetime=FLEETING,
            lines=[
                LinePrimitive(
                    type=LinePrimitiveLineType.LineList,
                    thickness=1.0,
                    scale_invariant=True,
                    points=[p for end in ends.values() for p in (point(0.0, 0.0), point(*end))],
                    color=UNKNOWN,
                )
            ],
            texts=[
                TextPrimitive(
                    pose=planar(x, y, 0.0, z),
                    billboard=True,
                    font_size=11.0,
                    scale_invariant=True,
                    color=UNKNOWN,
                    text=name,
                )
                for name, (x, y, z) in ends.items()
            ],
        )
