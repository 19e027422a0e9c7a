"""What a forwarder tells its gateway of a port that opens without working."""

import os
import socket
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.conftest import wait_until
from wackel_gateway import forward
from wackel_gateway.forward import MAX_RECORD, STOP, Forwarder, Kind, Record, Task
from wackel_gateway.port import PortLost


class Adapter:
    """Opens whenever it is asked to; what is written to it is lost with it while it is wedged."""

    baud_rate = 1_000_000
    latency_timer_ms = None

    def __init__(self) -> None:
        self.fd, self.far = os.pipe()
        self.wedged = True
        self.opened = 0
        self.heard = False

    def __call__(self, path: str, baud_rate: int) -> "Adapter":
        self.opened += 1
        return self

    def write(self, data: bytes) -> None:
        if self.wedged:
            raise PortLost("wedged")

    def read(self) -> bytes:
        self.heard = True
        return os.read(self.fd, 100)

    def close(self) -> None:
        pass


@pytest.fixture
def adapter(monkeypatch: pytest.MonkeyPatch) -> Iterator[Adapter]:
    adapter = Adapter()
    monkeypatch.setattr(forward, "Port", adapter)
    yield adapter
    os.close(adapter.fd)
    os.close(adapter.far)


def test_it_is_told_as_open_once_it_has_said_something(adapter: Adapter, tmp_path: Path) -> None:
    master, client = os.openpty()
    tty.setraw(client)
    os.set_blocking(master, False)
    task = Task("port", 1_000_000, str(tmp_path / "proxy"))
    told: list[Kind] = []
    with ExitStack() as stack:
        for fd in (master, client):
            stack.callback(os.close, fd)
        listener = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
        listener.bind(task.address())
        listener.listen(1)
        gateway = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
        gateway.connect(task.address())
        forwarder = Forwarder(task, listener, master)
        stack.callback(forwarder._detach)  # in a process of its own, the exit does that
        thread = threading.Thread(target=forwarder.run)
        thread.start()
        stack.callback(thread.join)
        stack.callback(gateway.send, STOP)

        def until(condition: Callable[[], bool]) -> list[Kind]:
            def turn() -> None:
                if Kind.OPEN in told:  # whoever attaches after the loss hears of that alone
                    os.write(client, b"?")
                told.append(Record.decode(gateway.recv(MAX_RECORD)).kind)

            wait_until(condition, meanwhile=turn)
            return [kind for kind in told if kind in (Kind.OPEN, Kind.LOST)]

        assert until(lambda: adapter.opened == 4) == [Kind.OPEN, Kind.LOST]
        adapter.wedged = False
        os.write(adapter.far, b"!")
        assert until(lambda: told.count(Kind.OPEN) == 2) == [Kind.OPEN, Kind.LOST, Kind.OPEN]
