"""A server for viewers, and the robot's topics on it."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import foxglove
from foxglove.channels import (
    FrameTransformChannel,
    LogChannel,
    PosesInFrameChannel,
    SceneUpdateChannel,
)
from foxglove.messages import FrameTransform, Log, PosesInFrame, SceneUpdate

from wackel_node.config import RobotConfig
from wackel_node.errors import Explained
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.bus import BusState
from wackel_view.core import TOPICS, Drawn, View

TICK_S = 0.5

_CHANNELS = {
    FrameTransform: FrameTransformChannel,
    SceneUpdate: SceneUpdateChannel,
    PosesInFrame: PosesInFrameChannel,
    Log: LogChannel,
}


class CannotServe(Explained, OSError):
    """Viewers cannot be served at this address; the text says why."""


def run(config: RobotConfig, host: str, port: int, tell: Callable[[str], None]) -> None:
    """Serves viewers until Ctrl-C.

    Args:
        config: Of the robot.
        host, port: Where; port 0 takes any that is free.
        tell: Gets the address at which viewers find it.

    Raises:
        CannotServe: The address is taken, or none of this computer.
        NotReached: There is no robot.
    """
    with Link(config) as link, _server(config.robot, host, port) as (server_port, show):
        view = View(config)
        clock = link.clock

        def on_state(key: str, state: BusState) -> None:
            view.bus_state(keys.chunk_of(keys.STATE, key, "bus"), state)

        link.subscribe(keys.STATE, on_state)
        link.subscribe(keys.ODOMETRY, lambda _, message: show(view.odometry(message)))
        link.subscribe(keys.RESIDUALS, lambda _, message: show(view.residuals(message)))
        link.subscribe(keys.HEALTH, lambda _, message: show(view.health(message, clock.now_ns())))
        link.every(TICK_S, lambda: show(view.tick(clock.now_ns())))
        tell(f"ws://{host}:{server_port}")
        while True:
            link.pump(TICK_S)


@contextmanager
def _server(
    robot: str, host: str, port: int
) -> Iterator[tuple[int, Callable[[Iterable[Drawn]], None]]]:
    """The port, and what shows drawings to all viewers."""
    context = foxglove.Context()
    try:
        server = foxglove.start_server(
            name=f"wackel {robot}", host=host, port=port, context=context
        )
    except RuntimeError as error:
        raise CannotServe(
            f"cannot serve viewers at {host}:{port}: {error}; choose another with --host and --port"
        ) from error
    try:
        channels = {topic: _channel(topic, kind, context) for topic, kind in TOPICS.items()}

        def show(drawn: Iterable[Drawn]) -> None:
            for topic, message in drawn:
                channels[topic].log(message)

        yield server.port, show
    finally:
        server.stop()


def _channel(topic: str, kind: type | None, context: foxglove.Context) -> Any:
    if kind is None:
        return foxglove.Channel(topic, message_encoding="json", context=context)
    return _CHANNELS[kind](topic, context=context)
