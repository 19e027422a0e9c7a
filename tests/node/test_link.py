"""What reaches a handler, in which order, and what is refused."""

from contextlib import ExitStack

import pytest
import zenoh
from zenoh.handlers import Callback

from tests.conftest import Rendezvous, wait_until
from wackel_node.link import Link
from wackel_node.node import Node
from wackel_schemas import keys, wire
from wackel_schemas.bus import BusCommand, BusState
from wackel_schemas.drive import ImuSample
from wackel_schemas.health import Health, HealthReply
from wackel_schemas.keys import MOST_BYTES, MOST_HEALTH_BYTES

pytestmark = pytest.mark.process


def put(link: Link, key: str, payload: bytes) -> None:
    link.session.put(
        f"wackel/{link.config.robot}/{key}",
        payload,
        congestion_control=zenoh.CongestionControl.BLOCK,
    )


def test_the_first_message_of_a_source_reaches_all_who_are_there(rendezvous: Rendezvous) -> None:
    heard = [0, 0, 0]

    def listen(number: int, link: Link) -> None:
        def count(_key: str, _sample: ImuSample) -> None:
            heard[number] += 1

        link.subscribe(keys.IMU, count)

    with ExitStack() as stack:
        readers = [stack.enter_context(Link(rendezvous.config, "peer")) for _ in heard]
        for number, link in enumerate(readers):
            listen(number, link)
        for start in range(1, 5):
            with Node("imu", str(start), rendezvous.config) as node:
                samples = node.publisher(keys.IMU, name="body")
                node.await_links()
                samples.put(ImuSample(stamp=start, angular_velocity=(0.0, 0.0, 0.0)))
                wait_until(
                    lambda now=start: heard == [now] * 3,  # type: ignore[misc]
                    meanwhile=lambda: [link.pump(0.01) for link in readers],
                )


def test_messages_of_several_topics_are_handled_in_the_order_of_their_arrival(
    sender: Link, reader: Link
) -> None:
    heard: list[str] = []
    reader.subscribe(keys.STATE, lambda key, _: heard.append(key))
    reader.subscribe(keys.IMU, lambda key, _: heard.append(key))
    state = wire.encode(BusState(stamp=1, servos=[]))
    sample = wire.encode(ImuSample(stamp=1, angular_velocity=(0.0, 0.0, 0.0)))

    def linked() -> bool:
        put(sender, "bus/main/state", state)
        put(sender, "imu/main", sample)
        reader.pump(0.05)
        return {"bus/main/state", "imu/main"} <= set(heard)

    wait_until(linked)
    sent = [("bus/a/state", state), ("imu/b", sample), ("imu/b", sample), ("bus/a/state", state)]
    for key, payload in sent * 20:
        put(sender, key, payload)
    put(sender, "bus/last/state", state)
    # All of them wait already when the reader turns to them.
    wait_until(lambda: len(waiting(reader)) > 80)
    reader.pump(0.05)
    assert heard[-81:] == [key for key, _ in sent] * 20 + ["bus/last/state"]


def test_a_message_too_long_is_refused_counted_and_told(sender: Link, reader: Link) -> None:
    heard: list[BusCommand] = []
    reader.subscribe(keys.COMMAND, lambda _, command: heard.append(command))
    good = wire.encode(BusCommand(stamp=1, goals=[]))

    def linked() -> bool:
        put(sender, "bus/main/command", good)
        reader.pump(0.05)
        return bool(heard)

    wait_until(linked)
    put(sender, "bus/main/command", bytes(MOST_BYTES + 1))
    wait_until(lambda: reader.rejected == 1, meanwhile=lambda: reader.pump(0.05))
    assert reader.rejection == (
        f"bus/main/command: {MOST_BYTES + 1} bytes; it never has more than {MOST_BYTES}"
    )
    put(sender, "bus/main/command", bytes(16 * MOST_HEALTH_BYTES))  # Zenoh itself drops it
    heard.clear()
    put(sender, "bus/main/command", good)
    wait_until(lambda: bool(heard), meanwhile=lambda: reader.pump(0.05))
    assert reader.rejected == 1


def test_health_may_be_longer_than_any_other_message(sender: Link, reader: Link) -> None:
    heard: list[Health] = []
    reader.subscribe(keys.HEALTH, lambda _, health: heard.append(health))
    publisher = sender.publisher(keys.HEALTH)
    longest = Health(stamp=1, level="ok", summary="x" * (MOST_HEALTH_BYTES - 1000))

    def told() -> bool:
        publisher.put(longest)  # on a busy computer Zenoh drops one or the other
        reader.pump(0.1)
        return bool(heard)

    wait_until(told)


def test_what_is_told_of_a_refusal_fits_a_terminal(sender: Link, reader: Link) -> None:
    reader.subscribe(keys.COMMAND, lambda _, command: None)

    def refused() -> bool:
        put(sender, "bus/\x1b[31m" + "x" * 300 + "/command", b"\xc1")
        reader.pump(0.05)
        return reader.rejected > 0

    wait_until(refused)
    assert len(reader.rejection) <= 200
    assert reader.rejection.isprintable()


def test_what_waits_for_a_busy_reader_is_bounded_in_bytes(sender: Link, reader: Link) -> None:
    reader.subscribe_raw(keys.FAULT, lambda _, payload: None)

    def linked() -> bool:
        put(sender, "fault/flood", b"\x80")
        return bool(waiting(reader))

    wait_until(linked)
    # Not a hundred times: on a busy computer Zenoh drops some.
    wait_until(
        lambda: reader.overrun >= 30,
        meanwhile=lambda: put(sender, "fault/flood", bytes(MOST_BYTES)),
    )
    assert sum(waiting(reader)) <= 4 * MOST_HEALTH_BYTES


def waiting(link: Link) -> list[int]:
    """Sizes of the messages that have arrived and were not yet handled."""
    return [size for inbox in link._inboxes for *_, size in inbox._items]


def test_a_request_too_long_is_refused_in_words(sender: Link, reader: Link) -> None:
    reader.serve(
        keys.HEALTH_REQUEST, lambda _: HealthReply(stamp=1, ok=True, text="not to be reached")
    )
    replies: list[zenoh.Reply] = []
    key = f"wackel/{sender.config.robot}/health/request"
    collect = Callback(replies.append, indirect=False)

    def answered() -> bool:
        # Until the sender knows that somebody answers.
        sender.session.get(key, collect, payload=bytes(MOST_BYTES + 1))
        reader.pump(0.05)
        return bool(replies)

    wait_until(answered)
    assert replies[0].err is not None
    assert "no request has more than" in replies[0].err.payload.to_string()
