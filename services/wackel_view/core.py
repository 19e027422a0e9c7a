"""Messages of the robot to messages of a viewer. Pure: times are stamps, or come in."""

from typing import TypeAlias

import msgspec
from foxglove.messages import FrameTransform, Log, PosesInFrame, SceneUpdate

from wackel_node.config import RobotConfig
from wackel_schemas.bus import BusState
from wackel_schemas.drive import Odometry
from wackel_schemas.health import Health
from wackel_schemas.residuals import Residuals
from wackel_view import health_text
from wackel_view.robot_scene import RobotScene, Trouble
from wackel_view.velocity_scene import VelocityScene

TRANSFORMS, ROBOT, PATH, VELOCITY = "/tf", "/robot", "/path", "/velocity"
LOG, HEALTH, ODOMETRY, RESIDUALS = "/log", "/health", "/odometry", "/residuals"
TOPICS: dict[str, type | None] = {
    TRANSFORMS: FrameTransform,
    ROBOT: SceneUpdate,
    PATH: PosesInFrame,
    VELOCITY: SceneUpdate,
    LOG: Log,
    HEALTH: None,  # JSON
    ODOMETRY: None,
    RESIDUALS: None,
}

DRAW_NS = 33_000_000
"""Between two drawings: more than 30 a second nobody sees."""
PATH_NS = 500_000_000
"""A path is long, and grows slowly."""
SILENT_NS = 2_500_000_000
"""Health comes once a second; later it is not known."""

Drawn: TypeAlias = tuple[str, FrameTransform | SceneUpdate | PosesInFrame | Log | bytes]


class View:
    """What is to be seen of one robot.

    Every method returns topics with what to show there, and raises ``wire.Rejected`` for a
    message that cannot be shown.
    """

    def __init__(self, config: RobotConfig) -> None:
        self._robot = None if config.drive is None else RobotScene(config.drive)
        self._velocity = VelocityScene(1.0 if self._robot is None else self._robot.size)
        self._odometry: Odometry | None = None
        self._health: Health | None = None
        self._troubles: dict[str, list[Trouble]] = {}
        self._drawn: dict[str, int] = {}
        self._heard_ns: int | None = None
        self._silent = False

    def bus_state(self, bus: str, state: BusState) -> None:
        """Steering angles."""
        if self._robot is not None:
            self._robot.bus_state(bus, state)

    def odometry(self, odometry: Odometry) -> list[Drawn]:
        """The robot where it is."""
        if not self._due(ODOMETRY, odometry.stamp):
            return []
        self._odometry = odometry
        drawn: list[Drawn] = [(ODOMETRY, msgspec.json.encode(odometry))]
        if self._robot is not None:
            drawn.append((TRANSFORMS, self._robot.place(odometry)))
            drawn.append((ROBOT, self._robot.draw(odometry, self._troubles)))
            self._robot.went_on(odometry)
            if self._due(PATH, odometry.stamp, PATH_NS):
                drawn.append((PATH, self._robot.path(odometry.stamp)))
        return drawn

    def residuals(self, residuals: Residuals) -> list[Drawn]:
        """The velocity space."""
        if not self._due(RESIDUALS, residuals.stamp):
            return []
        return [
            (TRANSFORMS, self._velocity.place(residuals)),
            (VELOCITY, self._velocity.draw(residuals, self._odometry)),
            (RESIDUALS, msgspec.json.encode(residuals)),
        ]

    def health(self, health: Health, now_ns: int) -> list[Drawn]:
        """Health as text, and what has changed as a log; ``now_ns``: when it came."""
        lines = health_text.changes(self._health, health)
        self._health, self._heard_ns, self._silent = health, now_ns, False
        self._troubles = {}
        for fault in health.faults:
            if fault.status != "healed":
                trouble = Trouble(fault.code, fault.status)
                self._troubles.setdefault(fault.component, []).append(trouble)
        return [(HEALTH, health_text.as_json(health)), *((LOG, line) for line in lines)]

    def tick(self, now_ns: int) -> list[Drawn]:
        """To be called now and then: says when health has fallen silent."""
        if self._heard_ns is None:
            self._heard_ns = now_ns
        if now_ns - self._heard_ns < SILENT_NS or self._silent:
            return []
        self._silent = True
        silence = Health(
            stamp=now_ns,
            level="unknown",
            summary=f"No health heard for {(now_ns - self._heard_ns) / 1e9:.0f} s.",
        )
        return [(HEALTH, health_text.as_json(silence))]

    def _due(self, what: str, stamp: int, period_ns: int = DRAW_NS) -> bool:
        """Whether the last one is long enough ago, or of another time."""
        last = self._drawn.get(what)
        if last is not None and 0 <= stamp - last < period_ns:
            return False
        self._drawn[what] = stamp
        return True
