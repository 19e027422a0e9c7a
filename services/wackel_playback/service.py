"""Publishes recorded messages as they were, in their recorded rhythm."""

import time
from collections.abc import Callable, Iterator

import zenoh

from wackel_node.link import Link
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_playback.pace import Pace
from wackel_recording.reader import Entry
from wackel_schemas import wire
from wackel_schemas.keys import ALIVE, ROOT, topic_of

KEY_S = 0.05  # how often the keyboard is looked at: sooner than a person notices
_LISTENERS_S = 2.0  # a service that runs is linked within 25 ms; later it is not there
_SETTLE_S = 0.2  # the slowest of several, after the first
_SENSORS = ["gateway", "imu"]
_CONCLUDING = ["classifier", "odometry", "diagnoser", "aggregator"]


def is_played(key: str, with_derived: bool) -> bool:
    """Whether messages of a key are played.

    The inputs of the diagnosis are; its conclusions only on request, since live services draw
    their own. Signs of life never: their processes are not here.
    """
    topic = topic_of(key)
    if topic is None:
        return with_derived
    return topic.origin == "input" or (with_derived and topic is not ALIVE)


def in_the_way(link: Link, with_derived: bool) -> str:
    """The running service whose topics a playback would write on; empty if there is none."""
    services = [*_SENSORS, "playback"] + (_CONCLUDING if with_derived else [])
    prefix = f"{ROOT}/{link.config.robot}/"
    for service in services:
        key = prefix + ALIVE.key(service=service)
        for reply in link.session.liveliness().get(key, timeout=1.0):
            if reply.ok is not None:
                return str(reply.ok.key_expr).removeprefix(f"{prefix}alive/")
    return ""


class Player:
    """Plays until the end, or until the node stops.

    Attributes:
        messages: Published so far.
        position_s: Recorded time of the last of them.
        intruder: The service that came up meanwhile, publishes the same topics and so ended the
            playback; empty if none did.
    """

    def __init__(self, node: Node, keys: Callable[[], str]) -> None:
        """``keys`` gives what was typed since it was last asked."""
        self.messages = 0
        self.intruder = ""
        self.position_s = 0.0
        self._node = node
        self._keys = keys
        self._publishers: dict[str, zenoh.Publisher] = {}
        node.watch_alive(self._on_alive)

    def play(self, entries: Iterator[tuple[float, Entry]], pace: Pace) -> None:
        """Publishes each message at its recorded time in s."""
        for at_s, entry in entries:
            wait_s = 0.0
            while True:
                self._node.pump(min(max(wait_s, 0.0), KEY_S))
                _obey(self._keys(), pace, self._node)
                if self._node.stopping:
                    return
                wait_s = pace.wait_s(at_s, time.monotonic())
                if wait_s <= 0:
                    break
            self.position_s = at_s
            self._publisher(entry.key).put(entry.payload)
            self.messages += 1

    def await_listeners(self, key: str) -> None:
        """Waits a moment for those who are there to be linked, so that they miss no message."""
        limit = time.monotonic() + _LISTENERS_S
        publisher = self._publisher(key)
        while not _heard(publisher) and not self._node.stopping:
            if time.monotonic() > limit:
                logger.warning("nobody listens yet; playing all the same")
                return
            self._node.pump(0.01)
        settled = time.monotonic() + _SETTLE_S
        while time.monotonic() < settled and not self._node.stopping:
            self._node.pump(0.01)

    def _publisher(self, key: str) -> zenoh.Publisher:
        publisher = self._publishers.get(key)
        if publisher is None:
            topic = topic_of(key)
            publisher = self._publishers[key] = self._node.session.declare_publisher(
                f"{ROOT}/{self._node.config.robot}/{key}",
                encoding=None if topic is None else wire.encoding(topic.message),
                # Unlike a gateway, a recording can wait: at high speed no message gets lost.
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        return publisher

    def _on_alive(self, name: str, alive: bool) -> None:
        if alive and name.partition("/")[0] in _SENSORS:
            self.intruder = name
            self._node.stop()


def _heard(publisher: zenoh.Publisher) -> bool:
    status: zenoh.MatchingStatus = publisher.matching_status  # type: ignore[assignment]
    return status.matching


def _obey(keys: str, pace: Pace, node: Node) -> None:
    now_s = time.monotonic()
    for key in keys:
        match key:
            case " ":
                pace.toggle(now_s)
            case "+" | "=":
                pace.scale(2.0, now_s)
            case "-":
                pace.scale(0.5, now_s)
            case "q":
                node.stop()
