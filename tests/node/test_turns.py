"""On which thread handlers run, and that no two of them, nor a timer, ever run at once."""

import threading
import time

import pytest
import zenoh

from tests.conftest import wait_until
from wackel_node.link import Link
from wackel_schemas import keys, wire
from wackel_schemas.drive import ImuSample

pytestmark = pytest.mark.process

_SAMPLE = wire.encode(ImuSample(stamp=1, angular_velocity=(0.0, 0.0, 0.0)))


def put(link: Link, name: str) -> None:
    link.session.put(
        f"wackel/{link.config.robot}/imu/{name}",
        _SAMPLE,
        congestion_control=zenoh.CongestionControl.BLOCK,
    )


def link_up(sender: Link, reader: Link, heard: list[str]) -> None:
    """Until what is sent is heard, and nothing of it is on its way any more."""
    wait_until(lambda: put(sender, "link") or bool(heard), meanwhile=lambda: reader.pump(0.05))
    put(sender, "last")
    wait_until(lambda: heard[-1] == "imu/last", meanwhile=lambda: reader.pump(0.05))
    heard.clear()


def test_at_once_means_without_anybody_pumping_and_only_while_it_lasts(
    sender: Link, reader: Link
) -> None:
    heard: list[str] = []
    threads: set[int] = set()

    def hear(key: str, _sample: ImuSample) -> None:
        heard.append(key)
        threads.add(threading.get_ident())

    reader.subscribe(keys.IMU, hear)
    link_up(sender, reader, heard)
    assert threads == {threading.get_ident()}
    put(sender, "before")
    with reader.handle_at_once():
        put(sender, "within")
        wait_until(lambda: len(heard) == 2)
    assert heard == ["imu/before", "imu/within"]
    assert len(threads) == 2
    put(sender, "after")
    wait_until(lambda: any(inbox._items for inbox in reader._inboxes))
    assert len(heard) == 2
    reader.pump(0.05)
    assert heard[2:] == ["imu/after"]


def test_handlers_and_timers_take_turns(sender: Link, reader: Link) -> None:
    heard: list[str] = []
    inside = 0
    overlaps = 0
    ticks = 0

    def work() -> None:
        nonlocal inside, overlaps
        inside += 1
        overlaps += inside > 1
        time.sleep(0.0005)  # lets any other thread that may run do so
        inside -= 1

    def hear(key: str, _sample: ImuSample) -> None:
        heard.append(key)
        work()

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        work()

    reader.subscribe(keys.IMU, hear)
    link_up(sender, reader, heard)
    reader.every(0.001, tick)
    with reader.handle_at_once():
        for number in range(400):
            put(sender, f"n{number}")
        wait_until(lambda: len(heard) == 400, meanwhile=lambda: reader.pump(0.05))
        before = ticks
        wait_until(lambda: ticks > before + 3, meanwhile=lambda: reader.pump(0.05))
    assert heard == [f"imu/n{number}" for number in range(400)]
    assert overlaps == 0


def test_what_a_handler_raises_comes_out_of_pump_and_nothing_is_handled_after_it(
    sender: Link, reader: Link
) -> None:
    heard: list[str] = []

    def hear(key: str, _sample: ImuSample) -> None:
        heard.append(key)
        if key == "imu/bad":
            raise ZeroDivisionError("by a handler")

    reader.subscribe(keys.IMU, hear)
    link_up(sender, reader, heard)
    with pytest.raises(ZeroDivisionError, match="by a handler"), reader.handle_at_once():
        put(sender, "bad")
        put(sender, "next")
        wait_until(lambda: False, meanwhile=lambda: reader.pump(0.05))
    assert heard == ["imu/bad"]


def test_a_handler_may_publish_what_comes_back_to_itself(sender: Link, reader: Link) -> None:
    heard: list[str] = []
    echoes = reader.publisher(keys.IMU, name="echo")

    def hear(key: str, sample: ImuSample) -> None:
        heard.append(key)
        if key == "imu/call":
            echoes.put(sample)

    reader.subscribe(keys.IMU, hear)
    link_up(sender, reader, heard)
    with reader.handle_at_once():
        put(sender, "call")
        wait_until(lambda: len(heard) == 2, meanwhile=lambda: reader.pump(0.05))
    assert heard == ["imu/call", "imu/echo"]


def test_what_is_soon_comes_once_although_nobody_else_wakes(sender: Link, reader: Link) -> None:
    heard: list[str] = []
    later: list[float] = []

    def hear(key: str, _sample: ImuSample) -> None:
        heard.append(key)
        if key == "imu/start":
            reader.soon(0.05, lambda: later.append(time.monotonic()))

    reader.subscribe(keys.IMU, hear)
    link_up(sender, reader, heard)
    with reader.handle_at_once():
        begin_s = time.monotonic()
        put(sender, "start")
        # One long wait, which began before anything was to come soon.
        wait_until(lambda: bool(later), meanwhile=lambda: reader.pump(8.0))
        assert 0.05 <= later[0] - begin_s < 7.0
        reader.pump(0.2)
    assert len(later) == 1
