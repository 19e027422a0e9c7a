"""One transaction on a port: send, wait without spinning, read in bursts.

Each wake-up costs more than decoding ten servos, so there are few. For one servo's answer, which
gives its response time: wait for bytes. For the answers of several: sleep for as long as they
usually take, then read all of them at once; if some are missing, sleep for as long as the missing
bytes take on the wire. (A poll that wakes only when enough bytes are there exists, by VMIN, but it
needs a ``tcsetattr`` for each transaction, which USB adapters turn into control transfers.)

Sending and gathering are two calls, so that the caller can use the time on the wire.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic_ns, sleep

from wackel_gateway.lateness import Lateness
from wackel_gateway.outcome import Outcome, unsolicited
from wackel_gateway.patience import Patience
from wackel_gateway.port import Port, PortLost
from wackel_protocols.dynamixel2.answers import AnswerReader, Answers, reader
from wackel_protocols.dynamixel2.scanner import Kind
from wackel_schemas.bus import Purpose

_INTERRUPTIBLE_NS = 200_000_000  # a signal is noticed within this time
_RECHECK_NS = 1_000_000  # enough bytes but not the right ones: look again so much later


@dataclass(slots=True)
class _Flight:
    purpose: Purpose
    instruction: bytes
    reader: AnswerReader
    begin_ns: int
    sent_ns: int
    deadline_ns: int
    until_ns: int  # listening goes on so long: to the deadline, or longer where answers are late


class Exchange:
    """The master's side of a bus.

    Args:
        port: Open port.
        patience: Time limits of this bus.
        interrupted: Whether the process has to stop; ends a long wait.
    """

    def __init__(self, port: Port, patience: Patience, interrupted: Callable[[], bool]) -> None:
        self.port = port
        self.patience = patience
        self._interrupted = interrupted
        self._lateness = Lateness()
        self._flight: _Flight | None = None
        self._free_ns = 0  # when the last byte sent so far has left
        self._missed: frozenset[int] = frozenset()  # by the last transaction
        self._baud_rate = port.baud_rate

    def drain(self) -> Outcome | None:
        """What came since the last transaction ended; call before :meth:`send`."""
        data = self.port.read()
        if not data:
            return None
        late = unsolicited(monotonic_ns(), data, self._baud_rate)
        # Late answers come in one piece; among the bytes of a jammer an answer proves nothing.
        segments = late.answers.segments or []
        packets_only = all(segment.kind is Kind.PACKET for segment in segments)
        if packets_only and any(status.id in self._missed for status in late.answers.unexpected):
            self.patience.came_late()
        return late

    def send(
        self, purpose: Purpose, instruction: bytes, expected: AnswerReader | None = None
    ) -> None:
        """Sends an instruction.

        Args:
            purpose: How it is published.
            instruction: Its bytes.
            expected: What has to come back, where the bytes do not tell.

        Raises:
            PortLost: The port went away.
        """
        if expected is None:
            expected = reader(instruction)
        # Instructions without answer may still be on their way out.
        begin_ns = max(monotonic_ns(), self._free_ns)
        self.port.write(instruction)
        sent_ns = begin_ns + self.patience.wire_ns(len(instruction))
        deadline_ns = sent_ns + self.patience.limit_ns(expected.expectation)
        self._free_ns = sent_ns
        self._flight = _Flight(
            purpose, instruction, expected, begin_ns, sent_ns, deadline_ns, deadline_ns
        )

    def gather(self) -> Outcome:
        """The outcome of what was sent last, once it is complete or time is up.

        Raises:
            PortLost: The port went away meanwhile.
        """
        flight = self._flight
        assert flight is not None, "nothing was sent"
        self._flight = None
        chunks, answers, lag_ns, ended_ns = self._listen(flight)
        expectation = flight.reader.expectation
        if answers is None:
            answers = flight.reader.read(_joined(chunks))
        self._missed = frozenset(answers.missing)
        late_ns = 0
        if chunks:
            took_ns = chunks[-1][0] - flight.sent_ns
            late_ns = self.patience.late_ns(expectation, took_ns - lag_ns)
            if answers.clean:
                self.patience.completed(expectation, took_ns)
        return Outcome(
            flight.purpose,
            flight.instruction,
            expectation,
            flight.begin_ns,
            flight.sent_ns,
            chunks,
            answers,
            flight.deadline_ns,
            ended_ns,
            lag_ns,
            self._baud_rate,
            late_ns,
        )

    def _listen(self, flight: _Flight) -> tuple[list[tuple[int, bytes]], Answers | None, int, int]:
        """Chunks, answers if all of them came, longest oversleeping, end."""
        expectation = flight.reader.expectation
        chunks: list[tuple[int, bytes]] = []
        if not expectation.ids and not expectation.broadcast_ping:
            return chunks, None, 0, flight.sent_ns
        read = self.port.read
        lag_ns = received = 0
        data = b""
        if len(expectation.ids) > 1:
            data, lag_ns = self._sleep_through(flight)
        while True:
            now = monotonic_ns()
            if not data:
                ready, late_ns = self._wait(flight.until_ns - now)
                lag_ns = max(lag_ns, late_ns)
                now = monotonic_ns()
                if ready:
                    data = read()
                    if not data:
                        raise PortLost("it was closed from the other side")
                    now = monotonic_ns()
                elif self._interrupted() or self._is_over(flight, chunks, now):
                    return chunks, None, lag_ns, now
                else:
                    continue
            chunks.append((now, data))
            received += len(data)
            pause_ns = self._pause_ns(flight, received)
            if pause_ns == 0:
                answers = flight.reader.read(_joined(chunks))
                if not answers.missing:
                    if flight.until_ns > flight.deadline_ns:
                        self.patience.came_late()
                        self._lateness.was_right()
                    return chunks, answers, lag_ns, now
                pause_ns = _RECHECK_NS
            if self._is_over(flight, chunks, now):  # the bytes may never end
                return chunks, None, lag_ns, now
            pause_ns = min(pause_ns, flight.until_ns - now)
            if pause_ns > 0:
                sleep(pause_ns / 1e9)
                lag_ns = max(lag_ns, monotonic_ns() - now - pause_ns)
            data = read()

    def _is_over(self, flight: _Flight, chunks: list[tuple[int, bytes]], now_ns: int) -> bool:
        """Whether to stop listening; late answers may put it off once."""
        if now_ns < flight.until_ns:
            return False
        # A ping asks whether a servo is silent; that shall not take longer than it must.
        if flight.until_ns == flight.deadline_ns and flight.purpose != "ping":
            data = _joined(chunks)
            flight.until_ns = now_ns + self._lateness.extra_ns(flight.reader, data, now_ns)
        return now_ns >= flight.until_ns

    def _sleep_through(self, flight: _Flight) -> tuple[bytes, int]:
        """What came while the answers of several servos usually come, and the oversleeping."""
        expectation = flight.reader.expectation
        until_ns = flight.sent_ns + self.patience.pause_ns(expectation)
        pause_ns = until_ns - monotonic_ns()
        late_ns = 0
        if pause_ns > 0:
            sleep(pause_ns / 1e9)
            late_ns = max(0, monotonic_ns() - until_ns)
        data = self.port.read()
        self.patience.woke(expectation, complete=len(data) >= expectation.total_bytes)
        return data, late_ns

    def _pause_ns(self, flight: _Flight, received: int) -> int:
        """How long the missing bytes take; 0 if it is time to look whether all is there."""
        expectation = flight.reader.expectation
        if expectation.broadcast_ping:
            return _RECHECK_NS
        missing = expectation.total_bytes - received
        if missing <= 0:
            return 0
        # A servo that refuses sends no data, so its answer is shorter by just these.
        data_length = expectation.data_lengths[0]
        if data_length and missing % data_length == 0:
            return 0
        return self.patience.wire_ns(missing)

    def _wait(self, limit_ns: int) -> tuple[bool, int]:
        """Whether bytes came within the limit, and by how much the wait was longer than asked."""
        asked_ms = max(0, -(-min(limit_ns, _INTERRUPTIBLE_NS) // 1_000_000))
        begin = monotonic_ns()
        if self.port.wait(asked_ms):
            return True, 0
        return False, max(0, monotonic_ns() - begin - asked_ms * 1_000_000)


def _joined(chunks: list[tuple[int, bytes]]) -> bytes:
    return chunks[0][1] if len(chunks) == 1 else b"".join(data for _, data in chunks)
