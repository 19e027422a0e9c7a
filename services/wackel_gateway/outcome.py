"""What became of one instruction, and how it is told in a message."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from wackel_gateway.patience import BITS_PER_BYTE
from wackel_protocols.dynamixel2.answers import Answers, reader
from wackel_protocols.dynamixel2.expectation import SLOWEST_NS, Expectation
from wackel_schemas.bus import Chunk, Purpose, ResponseTime, Transaction


@dataclass(slots=True)
class Outcome:
    """One instruction and what followed. All times are ns of the monotonic clock.

    Attributes:
        purpose: Why it was sent.
        instruction: Its bytes; empty for bytes that nobody asked for.
        expectation: What had to come.
        begin_ns: First byte of the instruction left; without one, the first chunk came.
        sent_ns: Last byte of the instruction left.
        chunks: (time of the read, bytes).
        answers: What the chunks say.
        deadline_ns: Until when the answers had to be complete.
        ended_ns: When listening ended.
        host_lag_ns: Longest oversleeping of the process meanwhile.
        baud_rate: Bit/s.
        late_ns: How much later than usual the answers came, without that oversleeping.
        asked_again: Whether it asked the rest after others had not answered.
    """

    purpose: Purpose
    instruction: bytes
    expectation: Expectation
    begin_ns: int
    sent_ns: int
    chunks: Sequence[tuple[int, bytes]]
    answers: Answers
    deadline_ns: int
    ended_ns: int
    host_lag_ns: int
    baud_rate: int
    late_ns: int = 0
    asked_again: bool = False

    @property
    def received_bytes(self) -> int:
        """How many bytes came."""
        chunks = self.chunks
        return len(chunks[0][1]) if len(chunks) == 1 else sum(len(data) for _, data in chunks)

    @property
    def late(self) -> bool:
        """Whether the answer of the only servo that was asked took longer than any servo needs."""
        if len(self.expectation.ids) != 1 or not self.chunks:
            return False
        took_ns = self.chunks[-1][0] - self.sent_ns
        took_ns -= self.received_bytes * BITS_PER_BYTE * 1_000_000_000 // self.baud_rate
        return took_ns > SLOWEST_NS

    def message(self, offset_ns: int) -> Transaction:
        """As published; ``offset_ns`` leads from the monotonic clock to UTC."""
        begin = self.begin_ns
        return Transaction(
            stamp=begin + offset_ns,
            purpose=self.purpose,
            instruction=self.instruction,
            sent_ns=self.sent_ns - begin,
            chunks=[Chunk(at_ns=at_ns - begin, data=data) for at_ns, data in self.chunks],
            expected=list(self.expectation.ids),
            expected_bytes=self.expectation.total_bytes,
            deadline_ns=self.deadline_ns - begin,
            ended_ns=self.ended_ns - begin,
            baud_rate=self.baud_rate,
            response_times=self._response_times(),
            host_lag_ns=self.host_lag_ns,
            late_ns=self.late_ns,
        )

    def _response_times(self) -> list[ResponseTime]:
        chunks, sent_ns = self.chunks, self.sent_ns
        answers = self.answers
        if len(chunks) == 1:
            took_ns = chunks[0][0] - sent_ns
            if answers.reader is not None:
                ids = answers.reader.expectation.ids
                return [ResponseTime(id=servo_id, ns=took_ns) for servo_id in ids]
            return [ResponseTime(id=status.id, ns=took_ns) for status in answers.statuses]
        ends = list(accumulate(len(data) for _, data in chunks))
        return [
            ResponseTime(id=status.id, ns=chunks[bisect_left(ends, status.end)][0] - sent_ns)
            for status in answers.statuses
        ]


def unsolicited(at_ns: int, data: bytes, baud_rate: int) -> Outcome:
    """Bytes that no instruction called for, or that came after waiting was over."""
    read = reader(b"")
    return Outcome(
        purpose="observed",
        instruction=b"",
        expectation=read.expectation,
        begin_ns=at_ns,
        sent_ns=at_ns,
        chunks=((at_ns, data),),
        answers=read.read(data),
        deadline_ns=at_ns,
        ended_ns=at_ns,
        host_lag_ns=0,
        baud_rate=baud_rate,
    )
