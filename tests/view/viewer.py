"""A viewer of the Foxglove protocol, as small as it can be: RFC 6455 and ``foxglove.sdk.v1``."""

import base64
import json
import os
import socket
import struct
from typing import Any, NamedTuple

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10
_MESSAGE = struct.Struct("<BIQ")  # opcode 1, subscription, time in ns


class Shown(NamedTuple):
    """A message on a channel."""

    topic: str
    payload: bytes


class Viewer:
    """One connection.

    Attributes:
        info: What the server says of itself.
        channels: What it advertises, by topic.
    """

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=30)
        self._buffer = b""
        key = base64.b64encode(os.urandom(16)).decode()
        request = (
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        )
        self._socket.sendall(request.encode())
        while b"\r\n\r\n" not in self._buffer:
            self._buffer += self._some()
        head, self._buffer = self._buffer.split(b"\r\n\r\n", 1)
        if not head.startswith(b"HTTP/1.1 101"):
            raise ConnectionError(head.decode())
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def subscribe(self, *topics: str) -> None:
        """Asks for topics; all must have been advertised."""
        first = len(self._topics) + 1
        wanted = dict(enumerate(topics, first))
        self._topics |= wanted
        subscriptions = [{"id": n, "channelId": self.channels[t]["id"]} for n, t in wanted.items()]
        self._send(TEXT, json.dumps({"op": "subscribe", "subscriptions": subscriptions}).encode())

    def next(self) -> Shown | None:
        """The next message on a channel; ``None`` for anything else."""
        opcode, payload = self._frame()
        if opcode == TEXT:
            self._told(json.loads(payload))
        elif opcode == PING:
            self._send(PONG, payload)
        elif opcode == CLOSE:
            raise ConnectionError("closed")
        elif opcode == BINARY and payload[0] == 1:
            _, subscription, _ = _MESSAGE.unpack_from(payload)
            return Shown(self._topics[subscription], payload[_MESSAGE.size :])
        return None

    def _told(self, message: dict[str, Any]) -> None:
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in message["channels"]}

    def _frame(self) -> tuple[int, bytes]:
        first, second = self._take(2)
        length = second & 0x7F
        if length == 126:
            (length,) = struct.unpack(">H", self._take(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", self._take(8))
        assert first & 0x80, "fragments are not expected"
        return first & 0x0F, self._take(length)

    def _send(self, opcode: int, payload: bytes) -> None:
        mask = os.urandom(4)
        length = len(payload)
        head = bytes((0x80 | opcode, 0x80 | (length if length < 126 else 126)))
        if length >= 126:
            head += struct.pack(">H", length)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))
        self._socket.sendall(head + mask + masked)

    def _take(self, count: int) -> bytes:
        while len(self._buffer) < count:
            self._buffer += self._some()
        taken, self._buffer = self._buffer[:count], self._buffer[count:]
        return taken

    def _some(self) -> bytes:
        data = self._socket.recv(65536)
        if not data:
            raise ConnectionError("gone")
        return data
