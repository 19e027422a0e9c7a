"""Publishes messages of one type on one key."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import zenoh
from zenoh.ext import AdvancedPublisher, CacheConfig, declare_advanced_publisher
from zenoh.handlers import Callback

from wackel_schemas import wire
from wackel_schemas.keys import Topic
from wackel_schemas.message import Message

M = TypeVar("M", bound=Message)


class Publisher(Generic[M]):
    """Publishes one type on one key, numbered without gaps; never blocks.

    Args:
        session: To publish in.
        topic: What.
        key: Where, in full.
        boot: Random number of this process start.
    """

    def __init__(self, session: zenoh.Session, topic: Topic[M], key: str, boot: int) -> None:
        self._boot = boot
        self._seq = 0
        self._encoding = encoding = wire.encoding(topic.message)
        self._last = b""
        self._publisher: zenoh.Publisher | AdvancedPublisher
        if topic.latched:
            self._publisher = declare_advanced_publisher(
                session,
                key,
                encoding=encoding,
                congestion_control=zenoh.CongestionControl.DROP,
                cache=CacheConfig(max_samples=1),
                publisher_detection=True,
            )
            # Clients without the advanced subscriber get the latest value by a plain query.
            self._queryable = session.declare_queryable(
                key, Callback(self._reply_latest, indirect=False)
            )
        else:
            self._publisher = session.declare_publisher(
                key, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
            )

    def put(self, message: M) -> None:
        """Publishes; sets the message's boot and seq."""
        self.send(self.encode(message))

    def encode(self, message: M) -> bytes:
        """The bytes to :meth:`send` next; sets the message's boot and seq."""
        message.boot = self._boot
        message.seq = self._seq
        self._seq += 1
        return wire.encode(message)

    def send(self, data: bytes) -> None:
        """Publishes what was encoded."""
        self._last = data
        self._publisher.put(data)

    @property
    def has_reader(self) -> bool:
        """Whether anyone is linked who would get what is published now."""
        if isinstance(self._publisher, AdvancedPublisher):
            return True  # a latched value waits for its reader
        status: Any = self._publisher.matching_status  # the stub says bool, which it is not
        return bool(status.matching)

    def watch_readers(self, handler: Callable[[], None]) -> None:
        """Has Zenoh's thread call the handler when there is a reader and was none before."""

        def on_status(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                handler()

        assert isinstance(self._publisher, zenoh.Publisher)  # a latched value waits by itself
        self._watching = self._publisher.declare_matching_listener(
            Callback(on_status, indirect=False)
        )

    def _reply_latest(self, query: zenoh.Query) -> None:
        with query:
            if self._last:
                query.reply(query.key_expr, self._last, encoding=self._encoding)
