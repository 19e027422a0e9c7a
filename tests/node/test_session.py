"""Zenoh sessions of one process beside each other."""

import threading

import pytest
import zenoh
from msgspec.structs import replace
from zenoh.handlers import Callback

from tests.conftest import Rendezvous, free_port, wait_until
from wackel_node.config import RobotConfig
from wackel_node.session import session


def _flood(config: RobotConfig, over: threading.Event) -> None:
    with session(config, "peer") as talker:
        publisher = talker.declare_publisher("flood")
        while not over.is_set():
            publisher.put(b"")


@pytest.mark.process
def test_a_router_that_ends_holds_up_no_other_session(
    rendezvous: Rendezvous, capfd: pytest.CaptureFixture[str]
) -> None:
    """Zenoh ends what it still computes while Python waits for that, and its callbacks for Python:
    on the thread that calls them, it took ten seconds, and a complaint."""
    config, over, received = rendezvous.config, threading.Event(), 0

    def on_sample(_: zenoh.Sample) -> None:
        nonlocal received
        received += 1

    flood = threading.Thread(target=_flood, args=(config, over))
    with session(config, "peer") as listener:
        _subscriber = listener.declare_subscriber("flood", Callback(on_sample, indirect=False))
        flood.start()
        try:
            wait_until(lambda: received > 100)
            for _ in range(40):
                endpoint = f"tcp/127.0.0.1:{free_port()}"
                with session(
                    replace(config, zenoh=replace(config.zenoh, endpoint=endpoint)), "router"
                ):
                    pass
                told = "".join(capfd.readouterr())
                if told:
                    break
        finally:
            over.set()
            flood.join()
    assert not told
