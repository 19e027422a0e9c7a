"""The USB serial adapter: when bytes that it received reach the operating system of the host."""

from collections import deque

PACKET_BYTES = 62
"""Payload of a full-speed USB packet of an FTDI chip: 64 bytes less 2 of modem status."""


class Adapter:
    """Holds received bytes until its buffer is full or its latency timer runs out.

    The timer is modelled as a clock that ticks once in ``latency_ms``: in a loop of requests each
    answer then takes a whole number of ticks, as the thesis measured (section 2.7: 1000 µs with a
    timer of 1 ms, 2000 µs once the answer takes longer than the first).

    Attributes:
        latency_ms: 0 passes everything on at once.
    """

    def __init__(self, latency_ms: int) -> None:
        self.latency_ms = latency_ms
        self._held = bytearray()
        self._due_ns = 0
        self._out: deque[tuple[int, bytes]] = deque()

    def receive(self, at_ns: int, data: bytes) -> None:
        """Bytes whose last one arrived from the wire at ``at_ns``; calls come in order of time."""
        if self._held and self._due_ns <= at_ns:
            self._pass_on(self._due_ns, len(self._held))
        if not self.latency_ms and not self._held:
            self._out.append((at_ns, data))
            return
        if not self._held:
            period = self.latency_ms * 1_000_000
            self._due_ns = (at_ns // period + 1) * period
        self._held += data
        while len(self._held) >= PACKET_BYTES:
            self._pass_on(at_ns, PACKET_BYTES)

    def take(self, until_ns: int) -> list[tuple[int, bytes]]:
        """What has reached the operating system by then: (when, bytes), in order."""
        if self._held and self._due_ns <= until_ns:
            self._pass_on(self._due_ns, len(self._held))
        taken = []
        while self._out and self._out[0][0] <= until_ns:
            taken.append(self._out.popleft())
        return taken

    def next_ns(self) -> int | None:
        """When something will reach the operating system next, as far as it is known."""
        if self._out:
            return self._out[0][0]
        return self._due_ns if self._held else None

    def clear(self) -> None:
        """Forget everything (unplugged)."""
        self._held.clear()
        self._out.clear()

    def _pass_on(self, at_ns: int, count: int) -> None:
        self._out.append((at_ns, bytes(self._held[:count])))
        del self._held[:count]
