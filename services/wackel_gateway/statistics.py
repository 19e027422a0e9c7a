"""Counters of a bus: pure; fed with outcomes, read once a second. Every byte is in one of them."""

from collections import deque
from collections.abc import Iterable
from statistics import median

from wackel_gateway.outcome import Outcome
from wackel_gateway.patience import BITS_PER_BYTE
from wackel_gateway.usual import Usual
from wackel_protocols.dynamixel2.packet import ALERT
from wackel_protocols.dynamixel2.scanner import Kind, Segment
from wackel_schemas.bus import BusStatistics, ServoStatistics

_RESPONSES = 256
"""Response times of a servo that its percentiles are of: a minute of slow reads."""


class _Responses:
    """When one servo answers if it is asked alone: only that measures the servo itself."""

    def __init__(self) -> None:
        self._latest_ns: deque[int] = deque(maxlen=_RESPONSES)
        self._usual = Usual()

    def add(self, beyond_wire_ns: int) -> None:
        self._latest_ns.append(beyond_wire_ns)
        self._usual.departs(beyond_wire_ns)

    def tell(self, servo: ServoStatistics) -> None:
        """Fills in its statistics."""
        ordered = sorted(self._latest_ns)
        last = len(ordered) - 1
        servo.response_p50, servo.response_p95, servo.response_p99 = (
            ordered[round(share * last)] / 1e9 for share in (0.5, 0.95, 0.99)
        )
        servo.response_outliers = self._usual.outliers


class Counters:
    """Counts since they were made, and rates of the period since :meth:`period` was called last.

    Attributes:
        totals: The counts; mode, port, baud rate and connection are kept up to date by the owner.
    """

    def __init__(self, totals: BusStatistics, ids: tuple[int, ...], now_ns: int) -> None:
        self.totals = totals
        totals.servos = [ServoStatistics(id=servo_id) for servo_id in ids]
        self._servos = {servo.id: servo for servo in totals.servos}
        # Transactions without any fault, by bytes sent, bytes received and the servos asked: they
        # are accounted for in one go, once a period.
        self._clean: dict[tuple[int, int, tuple[int, ...]], int] = {}
        self._responses: dict[int, _Responses] = {}
        self._since_ns = now_ns
        self._cycles = 0
        self._cycle_times_ns: list[int] = []
        self._period_bytes = 0

    def count(self, outcome: Outcome) -> None:
        """Accounts for one outcome."""
        sent, received = len(outcome.instruction), outcome.received_bytes
        answers, ids = outcome.answers, outcome.expectation.ids
        if answers.segments is None:
            kind = sent, received, ids
            self._clean[kind] = self._clean.get(kind, 0) + 1
            if len(ids) == 1:
                self._responded(ids[0], outcome)
        else:
            self._carried(sent, received, 1)
            self.totals.incomplete += bool(answers.missing)
            data = b"".join(data for _, data in outcome.chunks)
            self._account(answers.segments, data, frozenset(ids))
            self._owed(ids, 1)
            self._received([status.id for status in answers.statuses], 1)
        if not answers.has_errors:
            return
        for servo_id, error, _, _ in answers.statuses:
            if error and servo_id in self._servos:
                self._servos[servo_id].alerts += error >= ALERT
                self._servos[servo_id].errors += bool(error & ~ALERT)

    def _responded(self, servo_id: int, outcome: Outcome) -> None:
        if servo_id not in self._servos or not outcome.chunks:
            return
        wire_ns = outcome.received_bytes * BITS_PER_BYTE * 1_000_000_000 // outcome.baud_rate
        took_ns = outcome.chunks[-1][0] - outcome.sent_ns
        self._responses.setdefault(servo_id, _Responses()).add(took_ns - wire_ns)

    def cycle(self, took_ns: int) -> None:
        """A cycle's reads took so long."""
        self._cycles += 1
        self._cycle_times_ns.append(took_ns)

    def refused(self, reason: str) -> None:
        """A command or request was not carried out."""
        rejected = self.totals.rejected
        rejected[reason] = rejected.get(reason, 0) + 1

    def period(self, stamp_ns: int, now_ns: int) -> BusStatistics:
        """The message, with the rates of the period that ends now; begins the next."""
        for (sent, received, ids), times in self._clean.items():
            self._carried(sent, received, times)
            self.totals.packet_bytes += received * times
            self._owed(ids, times)
            self._received(ids, times)
        self._clean.clear()
        for servo_id, responses in self._responses.items():
            responses.tell(self._servos[servo_id])
        totals = self.totals
        elapsed_s = max(now_ns - self._since_ns, 1) / 1e9
        times_ns = self._cycle_times_ns
        totals.stamp = stamp_ns
        totals.cycle_rate = self._cycles / elapsed_s
        totals.cycle_time = median(times_ns) / 1e9 if times_ns else 0.0
        on_wire_s = self._period_bytes * BITS_PER_BYTE / totals.baud_rate
        totals.bus_load = min(1.0, on_wire_s / elapsed_s)
        self._since_ns = now_ns
        self._cycles = self._period_bytes = 0
        self._cycle_times_ns = []
        return totals

    def _carried(self, sent: int, received: int, times: int) -> None:
        totals = self.totals
        totals.transactions += times if sent else 0
        totals.bytes_sent += sent * times
        totals.bytes_received += received * times
        self._period_bytes += (sent + received) * times

    def _owed(self, ids: Iterable[int], times: int) -> None:
        for servo_id in ids:
            if servo_id in self._servos:
                self._servos[servo_id].expected += times

    def _received(self, ids: Iterable[int], times: int) -> None:
        for servo_id in ids:
            if servo_id in self._servos:
                self._servos[servo_id].received += times

    def _account(self, segments: list[Segment], data: bytes, expected: frozenset[int]) -> None:
        totals = self.totals
        for segment in segments:
            length = segment.end - segment.start
            match segment.kind:
                case Kind.PACKET:
                    totals.packet_bytes += length
                case Kind.ZEROS:
                    totals.zero_bytes += length
                case Kind.STRAY:
                    zeros = data.count(0, segment.start, segment.end)
                    totals.zero_bytes += zeros
                    totals.stray_bytes += length - zeros
                case Kind.BAD_CRC | Kind.TRUNCATED:
                    totals.bad_bytes += length
                    if segment.id in expected and segment.id in self._servos:
                        self._servos[segment.id].bad_crc += 1
