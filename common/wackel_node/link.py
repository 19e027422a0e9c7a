"""A process's link to the robot's topics: typed publishing, subscribing, serving, asking.

Zenoh calls back on its own threads. There a :class:`Link` only queues; handlers and timers run in
turns, one at a time, so services need no locks: on the thread that calls :meth:`Link.pump`, or,
between :meth:`Link.handle_at_once` and its end, on the one that has received a message.
"""

import math
import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from types import TracebackType
from typing import Any, Self, TypeVar

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber
from zenoh.handlers import Callback

from wackel_node.clock import Clock
from wackel_node.config import RobotConfig
from wackel_node.inbox import Inbox
from wackel_node.log import logger
from wackel_node.publisher import Publisher
from wackel_node.session import NotReached, Role, session
from wackel_node.wake import Wake
from wackel_schemas import wire
from wackel_schemas.keys import MOST_BYTES, ROOT, Query, Topic
from wackel_schemas.message import Message, Record

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Record)
R = TypeVar("R", bound=Message)

_MOST_TOLD = 200  # characters of a refusal
_WARN_EVERY_S = 60.0
_TOKENS = "alive/*/*"  # below a robot's name
_TOKENS_S = 0.3  # what is alive at a rendezvous is told at once; this is a hundred times that
# Strangers may write on any key: what is remembered of each ends here.
_MAX_KEYS = 1024
# An hour at 1 kHz is not lost between two messages; such a jump is a stranger's number.
_STRANGE_JUMP = 3_600_000

# Tells the words of a service from Zenoh's own errors, such as its time-out.
_REFUSAL = zenoh.Encoding.TEXT_PLAIN


class Link:
    """A session below one robot's name. Use with ``with``: an open session hangs the exit.

    Attributes:
        boot: Random number of this process start.
        received, lost, rejected: Counts of messages read, never arrived, and not understood.
        rejection: Key and reason of the latest that was not understood; empty if none was.
        arrived_ns: When Zenoh had the message that is being handled, or was last; monotonic.
    """

    def __init__(
        self, config: RobotConfig, role: Role = "client", also_at: str | None = None
    ) -> None:
        self.config = config
        self.clock = Clock()
        self.boot = random.getrandbits(32)
        self.received = 0
        self.lost = 0
        self.rejected = 0
        self.rejection = ""
        self.arrived_ns = 0
        self._prefix = f"{ROOT}/{config.robot}/"
        self._inboxes: list[Inbox] = []
        self._wake = Wake()  # the word: whether by :meth:`wake`
        self._woken = False  # so that of many messages one wakes
        self._turns = threading.Lock()
        self._whose = 0  # turn it is: the thread's identity, or 0
        self._at_once = False
        self._failure: BaseException | None = None  # of a turn on another thread
        self._entities: list[Any] = []  # a subscriber that is garbage collected is undeclared
        self._last_seen: dict[str, tuple[int, int]] = {}
        self._warned: dict[str, float] = {}
        self._timers: list[list[Any]] = []  # [due, period or None for once, handler]
        self._due = math.inf  # when the first of them is
        self.session = session(config, role, also_at)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.session.close()  # type: ignore[no-untyped-call]

    @property
    def overrun(self) -> int:
        """Messages that arrived and were dropped because this process was busy."""
        return sum(inbox.overrun for inbox in self._inboxes)

    def publisher(self, topic: Topic[M], **chunks: str) -> Publisher[M]:
        """A publisher on the topic's key with the named chunks filled in."""
        return Publisher(self.session, topic, self._prefix + topic.key(**chunks), self.boot)

    def on_reader(self, publisher: Publisher[M], handler: Callable[[], None]) -> None:
        """Calls ``handler()`` from :meth:`pump` when a publisher that nobody read gets a reader."""
        inbox = self._inbox("newest", lambda _: handler())
        publisher.watch_readers(lambda: inbox.add(None))

    def subscribe(self, topic: Topic[M], handler: Callable[[str, M], None], **chunks: str) -> None:
        """Calls ``handler(key below the robot's name, message)`` from :meth:`pump`.

        Chunks that are not given match any. What cannot be decoded, or makes no sense to the
        handler (which then raises :class:`wire.Rejected`), is counted and logged.
        """

        def deliver(item: tuple[str, bytes]) -> None:
            key, payload = item
            try:
                message = wire.decode(payload, topic.message)
                self.received += 1
                self.notice_gap(key, message)
                self.taken(key, message)
                handler(key, message)
            except wire.Rejected as error:
                self._refuse(key, str(error))

        self.subscribe_raw(topic, lambda key, payload: deliver((key, payload)), **chunks)

    def subscribe_raw(
        self, topic: Topic[M], handler: Callable[[str, bytes], None], **chunks: str
    ) -> None:
        """As :meth:`subscribe`, with the bytes as they came (recorder, echo)."""
        prefix = len(self._prefix)

        def deliver(item: tuple[str, bytes | int]) -> None:
            key, payload = item
            if isinstance(payload, int):
                self._refuse(key, f"{payload} bytes; it never has more than {topic.most_bytes}")
            else:
                handler(key, payload)

        # Zenoh holds a lock of its own while it delivers a latched value.
        came = self._came if topic.latched else self._came_at_once
        inbox = self._inbox(topic.keep, deliver, came)

        def on_sample(sample: zenoh.Sample) -> None:
            payload, size = sample.payload, len(sample.payload)
            key = str(sample.key_expr)[prefix:]
            if size > topic.most_bytes:
                inbox.add((key, size))
            else:
                inbox.add((key, payload.to_bytes()), size)

        key = self._prefix + topic.key(**chunks)
        callback = Callback(on_sample, indirect=False)
        if topic.latched:
            entity: Any = declare_advanced_subscriber(
                self.session,
                key,
                callback,
                history=HistoryConfig(max_samples=1, detect_late_publishers=True),
            )
        else:
            entity = self.session.declare_subscriber(key, callback)
        self._entities.append(entity)

    def watch_alive(self, handler: Callable[[str, bool], None]) -> None:
        """Calls ``handler("<service>/<instance>", alive)`` when a process comes or goes.

        What makes no sense to the handler (:class:`wire.Rejected`) is counted and logged.
        """
        prefix = len(self._prefix) + len("alive/")

        def deliver(key: str, alive: bool) -> None:
            name = key[prefix:]
            try:
                handler(name, alive)
            except wire.Rejected as error:
                self._refuse(f"alive/{name}", str(error))

        self._watch_tokens(self._prefix + _TOKENS, deliver)

    def alive(self) -> set[str]:
        """Which services are there now, as ``<service>/<instance>``; what comes meanwhile is
        handled, as by :meth:`pump`."""
        prefix = len(self._prefix) + len("alive/")
        return {key[prefix:] for key in self._tokens(self._prefix + _TOKENS)}

    def robots(self) -> set[str]:
        """Names of all robots whose services meet at this rendezvous; what comes meanwhile is
        handled, as by :meth:`pump`."""
        return {key.split("/")[1] for key in self._tokens(f"{ROOT}/*/{_TOKENS}")}

    def unanswered(self, who: str, command: str = "`wackel up`") -> NotReached:
        """The error that one of the robot's services does not answer, with what to do about it.

        Args:
            who: The service, as people call it.
            command: What starts it.
        """
        robot = self.config.robot
        others = ", ".join(sorted(self.robots() - {robot}))
        hint = f"start it with {command}"
        if others:
            hint = f"here runs {others}; name its robot.toml with --config"
        return NotReached(f"no {who} of robot {robot} answers: {hint}")

    def serve(self, query: Query[Q, R], handler: Callable[[Q], R], **chunks: str) -> None:
        """Answers requests from :meth:`pump`; a request that is not understood gets an error."""

        def deliver(item: zenoh.Query) -> None:
            with item:
                try:
                    reply = handler(wire.decode(_payload(item), query.request))
                except wire.Rejected as error:
                    self._refuse(str(item.key_expr)[len(self._prefix) :], str(error))
                    item.reply_err(str(error), encoding=_REFUSAL)
                    return
                reply.boot = self.boot
                item.reply(item.key_expr, wire.encode(reply), encoding=wire.encoding(query.reply))

        inbox = self._inbox("all", deliver)

        def on_query(item: zenoh.Query) -> None:
            inbox.add(item, len(item.payload) if item.payload is not None else 0)

        self._entities.append(
            self.session.declare_queryable(
                self._prefix + query.key(**chunks), Callback(on_query, indirect=False)
            )
        )

    def ask(self, query: Query[Q, R], request: Q, timeout_s: float = 2.0, **chunks: str) -> R:
        """Sends a request and waits for its answer.

        Raises:
            TimeoutError: Nobody answered in time.
            wire.Rejected: The other side did not understand the request.
        """
        replies = self.session.get(
            self._prefix + query.key(**chunks),
            payload=wire.encode(request),
            encoding=wire.encoding(query.request),
            timeout=timeout_s,
        )
        for reply in replies:
            if reply.ok is not None:
                return wire.decode(reply.ok.payload.to_bytes(), query.reply)
            if reply.err is not None and reply.err.encoding == _REFUSAL:
                raise wire.Rejected(reply.err.payload.to_string())
        raise TimeoutError(f"no answer on {query.key(**chunks)} within {timeout_s:g} s")

    def every(self, period_s: float, handler: Callable[[], None]) -> None:
        """Calls ``handler()`` once a period, in a turn; a late call is not made up for."""
        self._timers.append([time.monotonic() + period_s, period_s, handler])
        self._due = min(self._due, self._timers[-1][0])

    def soon(self, delay_s: float, handler: Callable[[], None]) -> None:
        """Calls ``handler()`` once after a while, in a turn; to be called by handlers."""
        self._timers.append([time.monotonic() + delay_s, None, handler])
        self._due = min(self._due, self._timers[-1][0])
        self._came()  # who waits in pump does not know of it yet

    def pump(self, timeout_s: float = 0.0) -> bool:
        """Runs the handlers of what has arrived and of due timers; waits for work up to the limit.

        Returns:
            Whether any message was handled, or :meth:`wake` was called.
        """
        now = time.monotonic()
        limit = now + timeout_s
        if now >= limit and now < self._due and not self._wake and self._failure is None:
            return False  # mostly so where a loop only looks whether there is anything
        while True:
            called = self._wake.wait(min(limit, self._due) - now)
            if self._failure is not None:
                raise self._failure
            now = time.monotonic()
            if called is not None or now >= self._due:
                with self._turns:
                    handled = self._turn()
                if handled or called:
                    return True
                now = time.monotonic()
            if now >= limit:
                return False

    @contextmanager
    def handle_at_once(self) -> Iterator[None]:
        """Within it, a message is handled by the thread of Zenoh's that received it.

        That saves waking another for it, which takes longer than what most handlers do. Somebody
        still has to call :meth:`pump`, for timers and all else, and gets what a handler raises.
        Not for handlers that wait: nothing is received meanwhile.
        """
        self._at_once = True
        with self._turns:  # for what came before
            self._turn()
        try:
            yield
        finally:
            with self._turns:
                self._at_once = False

    def _came(self) -> None:
        """Something is in an inbox; on a thread of Zenoh's."""
        if not self._woken:
            self._woken = True
            self._wake.put(False)

    def _came_at_once(self) -> None:
        """As :meth:`_came`, where a turn may be taken."""
        # What a handler publishes can come back to itself: it is for the next turn.
        if not self._at_once or self._whose == threading.get_ident():
            self._came()
            return
        with self._turns:
            if not self._at_once or self._failure is not None:
                return
            try:
                self._turn()
            except BaseException as failure:  # it ends the service, not Zenoh's thread
                self._failure = failure
                self.wake()

    def _turn(self) -> bool:
        """Runs due timers and the handlers of what is there; whether there was anything."""
        self._whose = threading.get_ident()
        try:
            if (now := time.monotonic()) >= self._due:
                self._run_timers(now)
            self._woken = False  # before looking, so that nothing comes unseen
            arrived = [each for inbox in self._inboxes for each in inbox.take()]
            # In the order of arrival, whatever the topic: a core gets what a recorder recorded.
            arrived.sort(key=itemgetter(0))
            # No more than what is there now: timers are due even in a flood.
            for self.arrived_ns, origin, item, _ in arrived:
                origin.deliver(item)
            return bool(arrived)
        finally:
            self._whose = 0

    def _run_timers(self, now: float) -> None:
        due = [timer for timer in self._timers if timer[0] <= now]
        for timer in due:
            if timer[1] is None:
                self._timers.remove(timer)
            else:
                timer[0] = max(timer[0] + timer[1], now)
            timer[2]()
        self._due = min((timer[0] for timer in self._timers), default=math.inf)

    def wake(self) -> None:
        """Makes a waiting :meth:`pump` return soon; safe from signal handlers and threads."""
        self._wake.put(True)

    def _watch_tokens(self, expression: str, handler: Callable[[str, bool], None]) -> None:
        """Calls ``handler(key, alive)`` from :meth:`pump` for those there are, and as they change.

        Unlike the answer to a ``get``, which may be empty while two peers are linking.
        """
        inbox = self._inbox("all", lambda item: handler(*item))

        def on_sample(sample: zenoh.Sample) -> None:
            inbox.add((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

        self._entities.append(
            self.session.liveliness().declare_subscriber(
                expression, Callback(on_sample, indirect=False), history=True
            )
        )

    def _tokens(self, expression: str) -> set[str]:
        """Keys of those there are now; what comes meanwhile is handled."""
        there: set[str] = set()
        self._watch_tokens(expression, lambda key, alive: there.add(key) if alive else None)
        limit = time.monotonic() + _TOKENS_S
        while (left_s := limit - time.monotonic()) > 0:
            self.pump(left_s)
        return there

    def _inbox(
        self, keep: str, deliver: Callable[[Any], None], came: Callable[[], None] | None = None
    ) -> Inbox:
        inbox = Inbox(keep, deliver, came or self._came)
        self._inboxes.append(inbox)
        return inbox

    def notice_gap(self, key: str, message: Message) -> None:
        """Counts what is missing before a message; for readers of raw payloads."""
        boot, seq = self._last_seen.pop(key, (message.boot, message.seq - 1))
        jump = message.seq - seq - 1
        if message.boot == boot and 0 < jump < _STRANGE_JUMP:
            self.lost += jump
        if len(self._last_seen) == _MAX_KEYS:
            del self._last_seen[next(iter(self._last_seen))]
        self._last_seen[key] = (message.boot, message.seq)

    def taken(self, key: str, message: Message) -> None:
        """A message is about to be handled."""

    def _refuse(self, key: str, reason: str) -> None:
        """Counts a message that is not used, and tells why."""
        self.rejected += 1
        told = f"{key}: {reason}"[:_MOST_TOLD]
        self.rejection = "".join(
            c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in told
        )
        self._warn(key, self.rejection)

    def _warn(self, key: str, text: str) -> None:
        """Logs, for each key at most once a minute: garbage must not fill a disk."""
        now = time.monotonic()
        if now - self._warned.get(key, -_WARN_EVERY_S) >= _WARN_EVERY_S:
            if len(self._warned) == _MAX_KEYS:
                self._warned.clear()
            self._warned[key] = now
            logger.warning(text)


def _payload(query: zenoh.Query) -> bytes:
    """What a request says; without payload, nothing but defaults.

    Raises:
        wire.Rejected: It is too long.
    """
    payload = query.payload
    if payload is None:
        return b"\x80"
    if len(payload) > MOST_BYTES:
        raise wire.Rejected(f"{len(payload)} bytes; no request has more than {MOST_BYTES}")
    return payload.to_bytes()
