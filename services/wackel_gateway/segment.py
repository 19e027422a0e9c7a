"""Somebody else's traffic, cut into transactions. Pure: bytes and times come in as arguments.

With known directions (proxy) instructions and answers are two streams; a tap hears both in one, and
tells them apart by the instruction byte. An outcome is given when its answers are complete, when
time is up, or when the next instruction begins, whichever is first; what comes after that is
unsolicited. One that the master cut short has ``ended_ns`` before ``deadline_ns``.
"""

from bisect import bisect_right
from collections.abc import Iterable

from wackel_gateway.outcome import Outcome, unsolicited
from wackel_gateway.patience import Patience
from wackel_protocols.dynamixel2.answers import AnswerReader, reader
from wackel_protocols.dynamixel2.packet import PREFIX_BYTES, Instruction, InstructionPacket
from wackel_protocols.dynamixel2.scanner import Kind, Scanner, Segment

_UNFINISHED_NS = 20_000_000
"""Bytes that begin like a packet are waited for so long; a servo drops a packet with a gap of 1.5
ms, an adapter that nobody tuned delivers every 16 ms."""
_LINGER_NS = 10_000_000
"""So long after its deadline an answer still belongs to its instruction: unlike a master, an
observer loses nothing by waiting but the time until it tells that an answer is missing."""
_SILENT_WRITES = 3
"""So many unanswered writes in a row to a servo that answers reads: Status Return Level is 1."""
_ALWAYS_ANSWERED = frozenset((Instruction.PING, Instruction.READ))


class _Stream:
    """A stream that is scanned, with the time at which each of its bytes came."""

    def __init__(self) -> None:
        self.scanner = Scanner()
        self.last_ns = 0
        self._base = 0  # stream offset of the first byte kept
        self._data = b""
        self._starts: list[int] = []  # stream offsets at which chunks begin
        self._times_ns: list[int] = []

    def add(self, at_ns: int, data: bytes) -> list[Segment]:
        """Takes a chunk; returns the segments that are certain now."""
        self._starts.append(self._base + len(self._data))
        self._times_ns.append(at_ns)
        self._data += data
        self.last_ns = at_ns
        return self.scanner.feed(data)

    @property
    def pending(self) -> bool:
        """Whether there are bytes that are in no segment yet."""
        return bool(self._data)

    def take(self, segment: Segment) -> list[tuple[int, bytes]]:
        """The bytes of a segment as (time, bytes); they and all before are forgotten."""
        chunks: list[tuple[int, bytes]] = []
        position = segment.start
        while position < segment.end:
            index = bisect_right(self._starts, position) - 1
            following = self._starts[index + 1 : index + 2]
            end = min([segment.end, *following])
            data = self._data[position - self._base : end - self._base]
            chunks.append((self._times_ns[index], data))
            position = end
        self._data = self._data[segment.end - self._base :]
        self._base = segment.end
        keep = bisect_right(self._starts, segment.end) - 1
        del self._starts[:keep], self._times_ns[:keep]
        if not self._data:
            self._starts.clear()
            self._times_ns.clear()
        return chunks

    def after(self, position: int) -> int:
        """How many bytes of the chunk with the byte before ``position`` came after it."""
        index = bisect_right(self._starts, position - 1) - 1
        following = self._starts[index + 1 : index + 2] or [self._base + len(self._data)]
        return following[0] - position


class Segmenter:
    """Transactions of one bus, from what is seen of it."""

    def __init__(self, patience: Patience, baud_rate: int) -> None:
        self._patience = patience
        self._baud_rate = baud_rate
        self._host = _Stream()
        self._both = _Stream()
        self._open: Outcome | None = None
        self._reader: AnswerReader | None = None
        self._received = 0
        self._silent_writes: dict[int, int] = {}

    def change_rate(self, patience: Patience, baud_rate: int) -> None:
        """The master talks at another rate from now on."""
        self._patience = patience
        self._baud_rate = baud_rate

    @property
    def due_ns(self) -> int | None:
        """When :meth:`idle` has something to do if nothing comes before; absent if never."""
        times = [
            stream.last_ns + _UNFINISHED_NS for stream in (self._host, self._both) if stream.pending
        ]
        if self._open is not None:
            times.append(self._open.deadline_ns + _LINGER_NS)
        return min(times, default=None)

    def host(self, at_ns: int, data: bytes) -> list[Outcome]:
        """Bytes from the master, just before they leave for the bus."""
        return self._from_host(self._host.add(at_ns, data))

    def bus(self, at_ns: int, data: bytes) -> list[Outcome]:
        """Bytes from the bus to the master."""
        if self._open is None:
            return [unsolicited(at_ns, data, self._baud_rate)]
        return self._answer(at_ns, data)

    def both(self, at_ns: int, data: bytes) -> list[Outcome]:
        """Bytes that a tap heard, whoever sent them."""
        return self._from_tap(self._both.add(at_ns, data))

    def idle(self, now_ns: int) -> list[Outcome]:
        """Nothing has come until now."""
        done: list[Outcome] = []
        if self._host.pending and now_ns >= self._host.last_ns + _UNFINISHED_NS:
            done += self._from_host(self._host.scanner.finish())
        if self._both.pending and now_ns >= self._both.last_ns + _UNFINISHED_NS:
            done += self._from_tap(self._both.scanner.finish())
        if self._open is not None and now_ns >= self._open.deadline_ns + _LINGER_NS:
            done += self._close(now_ns)
        return done

    def _from_host(self, segments: Iterable[Segment]) -> list[Outcome]:
        done: list[Outcome] = []
        for segment in segments:
            chunks = self._host.take(segment)
            # What is no packet was sent all the same, and may explain what follows.
            instruction = b"".join(data for _, data in chunks)
            begin_ns = chunks[0][0]
            done += self._close(begin_ns)
            done += self._begin(instruction, begin_ns)
        return done

    def _from_tap(self, segments: Iterable[Segment]) -> list[Outcome]:
        done: list[Outcome] = []
        for segment in segments:
            after_ns = self._patience.wire_ns(self._both.after(segment.end))
            chunks = self._both.take(segment)
            if segment.kind is Kind.PACKET and isinstance(segment.packet, InstructionPacket):
                instruction = b"".join(data for _, data in chunks)
                # The chunk's time is that of its last byte, at the earliest.
                sent_ns = chunks[-1][0] - after_ns
                begin_ns = sent_ns - self._patience.wire_ns(len(instruction))
                done += self._close(begin_ns)
                done += self._begin(instruction, begin_ns)
                continue
            for at_ns, data in chunks:
                done += self.bus(at_ns, data)
        return done

    def _begin(self, instruction: bytes, begin_ns: int) -> list[Outcome]:
        self._reader = read = reader(instruction, self._status_return_level(instruction))
        sent_ns = begin_ns + self._patience.wire_ns(len(instruction))
        self._received = 0
        self._open = Outcome(
            purpose="observed",
            instruction=instruction,
            expectation=read.expectation,
            begin_ns=begin_ns,
            sent_ns=sent_ns,
            chunks=[],
            answers=read.read(b""),
            deadline_ns=sent_ns + self._patience.limit_ns(read.expectation),
            ended_ns=sent_ns,
            host_lag_ns=0,
            baud_rate=self._baud_rate,
        )
        if read.expectation.ids or read.expectation.broadcast_ping:
            return []
        return self._close(sent_ns)

    def _answer(self, at_ns: int, data: bytes) -> list[Outcome]:
        outcome, read = self._open, self._reader
        assert outcome is not None
        assert read is not None
        outcome.chunks = [*outcome.chunks, (at_ns, data)]
        self._received += len(data)
        expectation = outcome.expectation
        if self._received < expectation.total_bytes or expectation.broadcast_ping:
            return []
        outcome.answers = read.read(b"".join(chunk for _, chunk in outcome.chunks))
        if outcome.answers.missing:
            return []
        if outcome.answers.clean:
            self._patience.completed(expectation, at_ns - outcome.sent_ns)
        return self._close(at_ns)

    def _close(self, now_ns: int) -> list[Outcome]:
        outcome, read = self._open, self._reader
        if outcome is None or read is None:
            return []
        self._open = None
        outcome.ended_ns = max(now_ns, outcome.sent_ns)
        if self._received < outcome.expectation.total_bytes or outcome.expectation.broadcast_ping:
            outcome.answers = read.read(b"".join(data for _, data in outcome.chunks))
        self._note_silent_writes(outcome)
        return [outcome]

    def _status_return_level(self, instruction: bytes) -> int:
        silent = self._silent_writes
        if len(instruction) <= PREFIX_BYTES or silent.get(instruction[4], 0) < _SILENT_WRITES:
            return 2
        return 1

    def _note_silent_writes(self, outcome: Outcome) -> None:
        ids = outcome.expectation.ids
        if len(ids) != 1:
            return
        (servo_id,) = ids
        if outcome.instruction[PREFIX_BYTES] not in _ALWAYS_ANSWERED:
            count = self._silent_writes.get(servo_id, 0)
            self._silent_writes[servo_id] = count + 1 if outcome.answers.missing else 0
        elif outcome.answers.missing and self._silent_writes.get(servo_id, 0) < _SILENT_WRITES:
            self._silent_writes[servo_id] = 0  # it is silent altogether, which proves nothing
