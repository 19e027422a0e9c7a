"""Reading whatever is published below the robot's name, as it came: recorder, echo."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import zenoh

from wackel_node.errors import USAGE, Explained
from wackel_node.link import Link
from wackel_schemas import wire
from wackel_schemas.keys import MOST_HEALTH_BYTES, TOPICS, Topic, topic_of
from wackel_schemas.message import Message

EVERYTHING = "**"
_MEMORY = 4096  # keys whose pattern is remembered; strangers may write on any number of them


class BadPattern(Explained, ValueError):
    """A pattern that is no Zenoh key expression."""

    exit_code = USAGE


def listen(link: Link, patterns: Sequence[str], handler: Callable[[str, bytes], None]) -> None:
    """Calls ``handler(key below the robot's name, payload)`` from :meth:`Link.pump`.

    Each message comes once, however many patterns match it; the latest value of a latched topic
    comes at once.

    Args:
        link: To the robot.
        patterns: Zenoh key expressions below the robot's name: ``bus/*/state``, ``**``.
        handler: For all of them.

    Raises:
        BadPattern: Before anything is subscribed.
    """
    asked: list[Topic[Message]] = [
        Topic(each, Message, "input", "all", most_bytes=MOST_HEALTH_BYTES) for each in patterns
    ]
    wanted = [key_expression(topic.key()) for topic in asked]
    latched = [
        topic
        for topic in TOPICS
        if topic.latched and any(each.includes(key_expression(topic.key())) for each in wanted)
    ]
    topics = latched + asked
    expressions = [key_expression(topic.key()) for topic in topics]

    @lru_cache(_MEMORY)
    def subscription_of(key: str) -> int:
        expression = zenoh.KeyExpr(key)
        return next(n for n, each in enumerate(expressions) if each.includes(expression))

    for number, topic in enumerate(topics):

        def deliver(key: str, payload: bytes, number: int = number) -> None:
            if subscription_of(key) == number:
                handler(key, payload)

        link.subscribe_raw(topic, deliver)


def header_of(key: str, payload: bytes) -> Message | None:
    """The header of a message on one of wackel's keys; ``None`` for anything else."""
    if topic_of(key) is None:
        return None
    try:
        return wire.decode(payload, Message)
    except wire.Rejected:
        return None


def key_expression(pattern: str) -> zenoh.KeyExpr:
    """The pattern as Zenoh has it.

    Raises:
        BadPattern: It is none.
    """
    try:
        return zenoh.KeyExpr(pattern)
    except zenoh.ZError as error:
        raise BadPattern(
            f"{pattern!r} is no key expression; write for instance 'bus/*/state' or '**'"
        ) from error
