"""How long to wait for answers: wire time, what servos and host are known to need, some grace.

The vendor's library adds 34 ms to every time-out. What is needed beyond the wire time differs from
bus to bus (return delay 0 … 508 µs for each answer, USB latency timer 0 … 16 ms), so it is learned
from completed transactions as TCP learns its retransmission time-out (RFC 6298: mean plus four mean
deviations), and waiting for a silent servo costs little more than the servo would have taken.
"""

from wackel_protocols.dynamixel2.expectation import PING_BYTES, Expectation
from wackel_protocols.dynamixel2.packet import MAX_ID

BITS_PER_BYTE = 10  # start, eight, stop

_GRACE_NS = 3_000_000
"""Two frames of a full-speed USB bus (1 ms) and one late wake-up of the host."""
_MAX_GRACE_NS = 20_000_000
"""Beyond this a late host is a fault that shall show, not one to wait for."""
_UNKNOWN_LATENCY_NS = 16_000_000
"""Latency timer of an FTDI adapter that nobody set."""
_STEP_NS = 4_000
"""One byte at 2.5 Mbit/s."""
_MAX_PAUSES = 256
"""As many group sizes as a bus can have."""
_LONGEST_DELAY_NS = 508_000
"""Return Delay Time register at 254 (e-manual: units of 2 µs)."""
_BROADCAST_SLOT_NS = 3_000_000
_BROADCAST_END_NS = 16_000_000
"""A broadcast ping gives each of 252 ids 3 ms and all of them 16 ms more (DynamixelSDK)."""


class _Learned:
    """A mean and a mean deviation, ns (RFC 6298, section 2); never more than is possible."""

    def __init__(self, possible_ns: float) -> None:
        self._possible_ns = possible_ns
        self.limit_ns = possible_ns
        self.mean_ns: float | None = None
        self._deviation_ns = 0.0

    def add(self, sample_ns: float) -> None:
        if self.mean_ns is None:
            self.mean_ns = sample_ns
            self._deviation_ns = abs(sample_ns) / 2
        else:
            error = sample_ns - self.mean_ns
            self.mean_ns += error / 8
            self._deviation_ns += (abs(error) - self._deviation_ns) / 4
        self.limit_ns = min(self._possible_ns, self.mean_ns + 4 * self._deviation_ns)


class Patience:
    """What one bus needs.

    Args:
        baud_rate: Bit/s.
        latency_timer_ms: USB latency timer if known.
    """

    def __init__(self, baud_rate: int, latency_timer_ms: int | None = None) -> None:
        self.byte_ns = BITS_PER_BYTE * 1e9 / baud_rate
        latency_ns = _UNKNOWN_LATENCY_NS if latency_timer_ms is None else latency_timer_ms * 1e6
        self._grace_ns = float(_GRACE_NS)
        self._pauses: dict[tuple[int, int, bool], int] = {}
        self._single = _Learned(_LONGEST_DELAY_NS + latency_ns)
        self._gap = {False: _Learned(_LONGEST_DELAY_NS), True: _Learned(_LONGEST_DELAY_NS)}

    def wire_ns(self, length: int) -> int:
        """Time that so many bytes take on the wire."""
        return int(length * self.byte_ns)

    def late_ns(self, expectation: Expectation, took_ns: int) -> int:
        """How much later than usual answers came that took so long after the instruction's end;
        0 if that is as usual, or nothing is."""
        if self._single.mean_ns is None:
            return 0
        return max(0, took_ns - self.limit_ns(expectation) + int(self._grace_ns))

    def limit_ns(self, expectation: Expectation) -> int:
        """From the last byte of the instruction until waiting is over."""
        if expectation.broadcast_ping:
            slots = self.wire_ns(PING_BYTES) + _BROADCAST_SLOT_NS
            return MAX_ID * slots + _BROADCAST_END_NS
        answers = len(expectation.ids)
        if not answers:
            return 0
        beyond_wire = self._single.limit_ns + self._grace_ns
        if answers > 1:
            beyond_wire += (answers - 1) * self._gap[expectation.fast].limit_ns
        return self.wire_ns(expectation.total_bytes) + int(beyond_wire)

    def pause_ns(self, expectation: Expectation) -> int:
        """How long the answers of several servos usually take, to sleep through in one go."""
        key = (len(expectation.ids), expectation.total_bytes, expectation.fast)
        if key not in self._pauses:
            if len(self._pauses) >= _MAX_PAUSES:
                self._pauses.clear()
            self._pauses[key] = self.wire_ns(expectation.total_bytes)
        return self._pauses[key]

    def woke(self, expectation: Expectation, *, complete: bool) -> None:
        """Whether all was there after :meth:`pause_ns`: approaches the time at which it mostly is.

        Steps down and up are as 1 to 3, so that one pause of four ends too early.
        """
        key = (len(expectation.ids), expectation.total_bytes, expectation.fast)
        if key in self._pauses:
            step_ns = -_STEP_NS if complete else 3 * _STEP_NS
            longest_ns = self.limit_ns(expectation) - _GRACE_NS
            self._pauses[key] = max(0, min(longest_ns, self._pauses[key] + step_ns))

    def completed(self, expectation: Expectation, took_ns: int) -> None:
        """Learns from healthy answers that were there ``took_ns`` after the instruction's end."""
        beyond_wire = took_ns - self.wire_ns(expectation.total_bytes)
        answers = len(expectation.ids)
        if answers == 1:
            self._single.add(beyond_wire)
        elif answers > 1:
            single_ns = self._single.mean_ns or 0.0
            self._gap[expectation.fast].add((beyond_wire - single_ns) / (answers - 1))
        self._grace_ns = max(_GRACE_NS, self._grace_ns * 0.999)

    def came_late(self) -> None:
        """Answers came when waiting was over: be more patient, for some thousand transactions."""
        self._grace_ns = min(_MAX_GRACE_NS, self._grace_ns * 2)
