"""The forwarding process of mode proxy: bytes between a pseudo-terminal and the real port, at once.

It is a process of its own, without Zenoh, decoding or messages, so that nothing of wackel can delay
or stop the user's control: the gateway reads records from a socket, and if it is slow or dead,
records are dropped and counted, and bytes go on. A gateway that is started again attaches to the
forwarder that is there. Without a gateway, it ends once the user's software has been silent for a
while.

If the real port goes away, the pseudo-terminal stays: the user's software sees time-outs, as if the
bus were dead, and goes on by itself when the adapter is back.
"""

import fcntl
import json
import os
import select
import signal
import socket
import struct
import sys
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum
from pathlib import Path
from time import monotonic_ns
from typing import NamedTuple

from wackel_gateway.port import Port, PortLost
from wackel_gateway.recovery import Recovery
from wackel_node.precedence import CONTROL, come_first

_READ_BYTES = 65536
_TCGETS2 = 0x802C542A  # asm-generic/ioctls.h; termios.tcgetattr knows no rates above 4 Mbit/s
_TERMIOS2 = struct.Struct("<4I20x2I")  # struct termios2; output rate last
_HEAD = struct.Struct("<Bq")
_ALONE_NS = 10_000_000_000  # without gateway and without traffic for so long: not needed any more
_SOON_MS = 50
_IDLE_MS = 1000
MAX_RECORD = _READ_BYTES + _HEAD.size
STOP = b"stop"


class Kind(IntEnum):
    """What a record tells: of bytes their direction, of the port its state."""

    HELLO = 0
    HOST = 1
    BUS = 2
    RATE = 3
    OPEN = 4
    LOST = 5
    DROPPED = 6


class Record(NamedTuple):
    """One event.

    Attributes:
        kind: What it tells.
        at_ns: When, on the monotonic clock.
        payload: Bytes of ``HOST`` and ``BUS``; JSON of the others.
    """

    kind: Kind
    at_ns: int
    payload: bytes

    def encode(self) -> bytes:
        """As one packet on the socket."""
        return _HEAD.pack(self.kind, self.at_ns) + self.payload

    @classmethod
    def decode(cls, data: bytes) -> "Record":
        """From one packet on the socket."""
        kind, at_ns = _HEAD.unpack_from(data)
        return cls(Kind(kind), at_ns, data[_HEAD.size :])


class Task(NamedTuple):
    """What a forwarder connects."""

    port: str
    baud_rate: int
    proxy_port: str

    def address(self) -> str:
        """Name of its socket, in Linux's abstract name space: nothing to clean up."""
        return f"\0wackel-proxy:{Path(self.proxy_port).absolute()}"


class Forwarder:
    """Forwards until told to stop; use with ``with``."""

    def __init__(self, task: Task, listener: socket.socket, master: int) -> None:
        self._task = task
        self._listener = listener
        self._master = master
        self._port: Port | None = None
        self._gateway: socket.socket | None = None
        self._dropped = 0
        self._recovery = Recovery()
        self._retry_at_ns = 0
        self._lost_because = ""
        self._active_ns = monotonic_ns()
        self._rate_seen = self._rate_of_client()
        self._baud_rate = task.baud_rate
        self._poll = select.poll()
        self._poll.register(master, select.POLLIN)
        self._poll.register(listener.fileno(), select.POLLIN)

    def run(self) -> None:
        """Until a gateway says so, or nobody needs it any more."""
        while True:
            now = monotonic_ns()
            if self._port is None and now >= self._retry_at_ns:
                self._open_port(now)
            if self._port is not None and self._recovery.back(now, heard=self._port.heard):
                self._lost_because = ""
                self._tell_open(self._port)
            if self._gateway is None and now - self._active_ns > _ALONE_NS:
                return
            ready = self._poll.poll(self._timeout_ms())
            for fd, events in ready:
                if fd == self._master:
                    self._from_client()
                elif self._port is not None and fd == self._port.fd:
                    self._from_bus(self._port, hung_up=bool(events & ~select.POLLIN))
                elif fd == self._listener.fileno():
                    self._attach()
                # What was lost earlier in this round may be among what was ready.
                elif (
                    self._gateway is not None
                    and fd == self._gateway.fileno()
                    and self._told_to_stop(self._gateway)
                ):
                    return
            if not ready and self._dropped:
                self._tell_dropped()

    def close(self) -> None:
        """Gives the real port back."""
        if self._port is not None:
            self._port.close()

    def _timeout_ms(self) -> int:
        return _SOON_MS if self._recovery.lost or self._dropped else _IDLE_MS

    def _from_client(self) -> None:
        data = os.read(self._master, _READ_BYTES)
        self._active_ns = at_ns = monotonic_ns()
        rate = self._rate_of_client()
        if rate != self._rate_seen:
            self._rate_seen = rate
            self._change_rate(rate)
            at_ns = monotonic_ns()
        if self._port is not None:
            try:
                self._port.write(data)
            except PortLost as lost:
                self._lose_port(str(lost))
        self._record(Kind.HOST, at_ns, data)

    def _from_bus(self, port: Port, *, hung_up: bool) -> None:
        try:
            data = b"" if hung_up else port.read()
            if not data:
                raise PortLost("it was unplugged")
        except PortLost as lost:
            self._lose_port(str(lost))
            return
        at_ns = monotonic_ns()
        with suppress(BlockingIOError):  # nobody reads: as a real port's buffer would overflow
            os.write(self._master, data)
        self._record(Kind.BUS, at_ns, data)

    def _rate_of_client(self) -> int:
        """Bit/s that the client has set on its side of the pseudo-terminal."""
        settings = fcntl.ioctl(self._master, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(settings)[-1])

    def _change_rate(self, rate: int) -> None:
        self._baud_rate = rate
        if self._port is not None and rate != self._port.baud_rate:
            try:
                self._port.baud_rate = rate
            except PortLost as lost:
                self._lose_port(str(lost))
        self._tell(Kind.RATE, baud_rate=rate)

    def _open_port(self, now: int) -> None:
        try:
            self._port = Port(self._task.port, self._baud_rate)
        except PortLost as lost:
            self._lose_port(str(lost))
            return
        self._recovery.opened(now)
        self._poll.register(self._port.fd, select.POLLIN)
        if not self._recovery.lost:
            self._tell_open(self._port)

    def _lose_port(self, reason: str) -> None:
        if self._port is not None:
            self._poll.unregister(self._port.fd)
            self._port.close()
            self._port = None
        self._retry_at_ns = monotonic_ns() + self._recovery.lose()
        self._tell_lost(reason)

    def _tell_open(self, port: Port) -> None:
        self._tell(Kind.OPEN, baud_rate=port.baud_rate, latency_timer_ms=port.latency_timer_ms)

    def _tell_lost(self, reason: str) -> None:
        if reason != self._lost_because:
            self._lost_because = reason
            self._tell(Kind.LOST, reason=reason)

    # The gateway's side.

    def _attach(self) -> None:
        """A gateway has come; it takes the place of the one before."""
        connection, _ = self._listener.accept()
        peer = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
        if peer[1] != os.getuid():
            connection.close()
            return
        self._detach()
        connection.setblocking(False)
        self._gateway = connection
        self._dropped = 0
        self._poll.register(connection.fileno(), select.POLLIN)
        self._tell(Kind.HELLO, **self._task._asdict())
        if self._recovery.lost:
            self._tell(Kind.LOST, reason=self._lost_because)
        elif self._port is not None:
            self._tell_open(self._port)

    def _detach(self) -> None:
        if self._gateway is not None:
            self._poll.unregister(self._gateway.fileno())
            self._gateway.close()
            self._gateway = None
            self._active_ns = monotonic_ns()

    def _told_to_stop(self, gateway: socket.socket) -> bool:
        try:
            said = gateway.recv(len(STOP))
        except OSError:
            said = b""
        if not said:
            self._detach()
        return said == STOP

    def _tell(self, kind: Kind, **values: object) -> None:
        self._record(kind, monotonic_ns(), json.dumps(values).encode())

    def _record(self, kind: Kind, at_ns: int, payload: bytes) -> None:
        """Hands an event over, or drops it: the socket's buffer is the only queue."""
        if self._dropped:
            self._tell_dropped()
        if not self._send(Record(kind, at_ns, payload)):
            self._dropped += 1

    def _tell_dropped(self) -> None:
        count = json.dumps({"count": self._dropped}).encode()
        if self._send(Record(Kind.DROPPED, monotonic_ns(), count)):
            self._dropped = 0

    def _send(self, record: Record) -> bool:
        """Whether the gateway has it, or there is none."""
        if self._gateway is None:
            return True
        try:
            self._gateway.send(record.encode())
        except BlockingIOError:
            return False
        except OSError:
            self._detach()
        return True


@contextmanager
def _terminal(path: Path) -> Iterator[int]:
    """A raw pseudo-terminal under a name of its own; gives our side of it.

    The other side is held open, so that settings and name survive clients that come and go.
    """
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    name = os.ttyname(slave)
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.symlink_to(name)
    fresh.replace(path)
    try:
        yield master
    finally:
        with suppress(OSError):
            if str(path.readlink()) == name:
                path.unlink()
        os.close(slave)
        os.close(master)


def main(argv: list[str]) -> int:
    """Runs the forwarder of a :class:`Task`, given as a JSON list; returns the exit code."""
    task = Task(*json.loads(argv[0]))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the gateway's to handle
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    # Each chunk of an answer also wakes the gateway, behind which forwarding the next would wait:
    # on two cores, with a library that polls, that is most of what a sync read is delayed.
    come_first(CONTROL)
    path = Path(task.proxy_port)
    if path.exists() and not path.is_symlink():
        print(f"proxy_port = {task.proxy_port!r} exists and is no link of ours", file=sys.stderr)
        return 2
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        try:
            listener.bind(task.address())
            listener.listen(1)
            with _terminal(path) as master:
                forwarder = Forwarder(task, listener, master)
                try:
                    forwarder.run()
                finally:
                    forwarder.close()
        except OSError as error:
            print(f"proxy_port = {task.proxy_port!r}: {error}", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
