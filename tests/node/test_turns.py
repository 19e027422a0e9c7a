"""On which thread handlers run, and that no two of them, nor a timer, ever run at once."""

import threading

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


def test_while_a_handler_runs_no_timer_does(sender: Link, reader: Link) -> None:
    heard: list[str] = []
    running, ticked = threading.Event(), threading.Event()
    overlapped: list[bool] = []

    def hear(key: str, _sample: ImuSample) -> None:
        heard.append(key)
        if key == "imu/long":
            running.set()
            overlapped.append(ticked.wait(0.3))

    reader.subscribe(keys.IMU, hear)
    link_up(sender, reader, heard)
    with reader.handle_at_once():
        put(sender, "long")
        wait_until(running.is_set)
        reader.every(0.001, ticked.set)
        wait_until(ticked.is_set, meanwhile=lambda: reader.pump(0.05))
    assert overlapped == [False]


def test_a_flood_is_handled_whole_and_in_order_and_timers_get_their_turn(
    sender: Link, reader: Link
) -> None:
    heard: list[str] = []
    ticks: list[int] = []
    reader.subscribe(keys.IMU, lambda key, _: heard.append(key))
    link_up(sender, reader, heard)
    reader.every(0.001, lambda: ticks.append(len(heard)))
    with reader.handle_at_once():
        for number in range(400):
            put(sender, f"n{number}")
        wait_until(lambda: len(heard) == 400, meanwhile=lambda: reader.pump(0.05))
        wait_until(lambda: 400 in ticks, meanwhile=lambda: reader.pump(0.05))
    assert heard == [f"imu/n{number}" for number in range(400)]


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
    came: list[str] = []

    def come() -> None:
        came.append("soon")
        reader.wake()

    def hear(key: str, _sample: ImuSample) -> None:
        heard.append(key)
        if key == "imu/start":
            reader.soon(0.05, come)

    reader.subscribe(keys.IMU, hear)
    link_up(sender, reader, heard)
    reader.every(5.0, lambda: came.append("late"))
    with reader.handle_at_once():
        put(sender, "start")
        # One long wait, which began before anything was to come soon.
        wait_until(lambda: bool(came), meanwhile=lambda: reader.pump(8.0))
        assert came == ["soon"]
        reader.pump(0.2)
    assert came.count("soon") == 1
