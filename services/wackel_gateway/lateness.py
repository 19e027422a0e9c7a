"""Answers that are not there when waiting is over: lost, or only late?

An adapter with a long latency timer holds answers back, and a master that goes on takes them for
the answer to its next question, and their servos for silent. So where what came is a true beginning
of the answer, it listens on for as long as an adapter can hold the rest. (Bytes come in order:
where a later one has come, nothing is late.) A silent servo looks the same, hence that may only use
a small share of the time, unless it proves to be right.
"""

from wackel_protocols.dynamixel2.answers import AnswerReader
from wackel_protocols.dynamixel2.packet import BROADCAST_ID, HEADER

_HELD_NS = 18_000_000
"""Latency timer of an FTDI adapter that nobody set, 16 ms, and a late host."""
_SHARE = 0.02
_SAVED_NS = 2 * _HELD_NS
"""Share of the time for listening to those who turn out to be silent, and how much is saved up."""
_PAUSE_NS = 200_000_000
"""After listening in vain: who is silent now is so in the next questions, too."""


class Lateness:
    """Decides when a master listens on."""

    def __init__(self) -> None:
        self._saved_ns = float(_SAVED_NS)
        self._since_ns: int | None = None
        self._not_before_ns: int | None = None

    def extra_ns(self, reader: AnswerReader, data: bytes, now_ns: int) -> int:
        """How much longer to listen when the time for an answer is over.

        Args:
            reader: Of the answer.
            data: What has come so far.
            now_ns: Monotonic.
        """
        if self._since_ns is not None:
            self._saved_ns += _SHARE * (now_ns - self._since_ns)
            self._saved_ns = min(self._saved_ns, _SAVED_NS)
        self._since_ns = now_ns
        early = self._not_before_ns is not None and now_ns < self._not_before_ns
        if early or self._saved_ns < _HELD_NS or not is_beginning(reader, data):
            return 0
        self._saved_ns -= _HELD_NS
        self._not_before_ns = now_ns + _PAUSE_NS
        return _HELD_NS

    def was_right(self) -> None:
        """The rest came: that time was not lost."""
        self._saved_ns = min(self._saved_ns + _HELD_NS, _SAVED_NS)
        self._not_before_ns = None


def is_beginning(reader: AnswerReader, data: bytes) -> bool:
    """Whether nothing but the end of an answer is missing."""
    expectation = reader.expectation
    if not expectation.ids or len(data) >= expectation.total_bytes:
        return False
    if not data:
        return True
    statuses = reader.read(data).statuses
    count = len(statuses)
    if count == len(expectation.ids):
        return False
    if tuple(status.id for status in statuses) != expectation.ids[:count]:
        return False
    rest = data[statuses[-1].end :] if statuses else data
    if count and expectation.fast:
        return rest[1:2] in (b"", bytes((expectation.ids[count],)))  # behind the error byte
    sent_by = BROADCAST_ID if expectation.fast else expectation.ids[count]
    head = HEADER + bytes((sent_by,))
    return rest[: len(head)] == head[: len(rest)]
