"""The answers to one instruction, matched with what was expected: the hot path.

A healthy answer has one layout that is known in advance, so it is checked as a whole: one unpack,
one CRC call for each servo, no object for any of them. Where servos are silent, or a rhythmic
jammer sends its zeros, answers still follow each other, and are taken as long as they do. Whatever
else departs from the layout by one byte goes through :mod:`.scanner`, with the same result type and
the same findings.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from operator import attrgetter, itemgetter
from struct import Struct
from typing import Any, NamedTuple

from fastcrc.crc16 import umts

from wackel_protocols.dynamixel2.expectation import (
    FAST_BLOCK_BYTES,
    FAST_PREFIX_BYTES,
    PING_BYTES,
    Expectation,
    expect,
)
from wackel_protocols.dynamixel2.fast import fast_prefix, parse_fast
from wackel_protocols.dynamixel2.packet import (
    HEADER,
    PREFIX_BYTES,
    STATUS_BYTES,
    Instruction,
    StatusPacket,
)
from wackel_protocols.dynamixel2.scanner import Kind, Segment, scan

_FOREIGN = frozenset((Kind.ZEROS, Kind.STRAY))
_RUN = HEADER[:3]


class Status(NamedTuple):
    """One servo's answer.

    Attributes:
        id: The servo.
        error: Its error byte (see :mod:`.errors`).
        parameters: Unstuffed; empty if the instruction failed with an error number.
        end: Offset after its last byte within the bytes read.
    """

    id: int
    error: int
    parameters: bytes
    end: int


class _Place(NamedTuple):
    """Where one servo's answer lies within a healthy answer, as offsets."""

    id: int
    error: int
    data: slice
    end: int


class Answers:
    """What came after one instruction.

    Attributes:
        missing: Expected servos without an intact answer, in the order of the request.
        unexpected: Intact answers of servos that were not asked, and second answers.
        segments: The account of all the bytes, without single runs (see :class:`.Scanner`);
            absent if clean.
        reader: Whose layout the bytes have exactly; absent if they have not.
        healthy: The bytes in this layout; empty without one.
    """

    __slots__ = ("_statuses", "healthy", "missing", "reader", "segments", "unexpected")

    def __init__(
        self,
        statuses: list[Status] | None,
        missing: tuple[int, ...] = (),
        unexpected: tuple[Status, ...] = (),
        segments: list[Segment] | None = None,
        *,
        reader: "AnswerReader | None" = None,
        healthy: bytes = b"",
    ) -> None:
        self._statuses = statuses
        self.reader = reader
        self.healthy = healthy
        self.missing = missing
        self.unexpected = unexpected
        self.segments = segments

    @property
    def clean(self) -> bool:
        """Every expected servo answered, in order and in full, and nothing else came.

        Error bytes may be set: they are content, not framing.
        """
        return self.segments is None

    @property
    def has_errors(self) -> bool:
        """Whether any of the expected servos sets its error byte."""
        if self.reader is not None:
            return any(self.reader.error_bytes(self.healthy))
        return any(status.error for status in self.statuses)

    @property
    def statuses(self) -> list[Status]:
        """The intact answers of the expected servos, in the order in which they came."""
        if self._statuses is None:
            assert self.reader is not None
            data = self.healthy
            new = tuple.__new__  # what Status(…) comes to, at half the time
            self._statuses = [
                new(Status, (servo_id, data[error], data[span], end))
                for servo_id, error, span, end in self.reader.places
            ]
        return self._statuses


class AnswerReader:
    """Reads answers to one kind of instruction; make it once (see :func:`reader`), use it often.

    Attributes:
        expectation: What has to come.
        places: Where each servo's answer lies within a healthy one.
        error_bytes: Takes the error bytes out of a healthy one.
    """

    def __init__(self, expectation: Expectation) -> None:
        self.expectation = expectation
        self._total = expectation.total_bytes
        self.places = _places(expectation)
        errors = [place.error for place in self.places]
        # The first twice: of a single index there would be no tuple.
        self.error_bytes: Callable[[bytes], Iterable[int]] = (
            itemgetter(errors[0], *errors) if errors else bytes
        )
        lengths = expectation.lengths
        self._each: list[tuple[int, int, bytes, int]] = []  # id, length, prefix and its CRC
        if expectation.fast:
            # The bytes between one CRC's start and the next, then again ids and CRCs as numbers.
            first, *others = lengths
            tiles = [f"{FAST_PREFIX_BYTES + first - 2}s", *(f"{length}s" for length in others)]
            blocks = (f"xB{length - FAST_BLOCK_BYTES}xH" for length in lengths)
            self._unpack_tiles = Struct(f"<{''.join(tiles)}2x").unpack
            self._unpack = Struct(f"<{FAST_PREFIX_BYTES}x{''.join(blocks)}").unpack
            self._prefix = fast_prefix(expectation)
        else:
            # Header through instruction, error and parameters, CRC.
            layout = (f"{PREFIX_BYTES + 1}s{length - PREFIX_BYTES - 3}sH" for length in lengths)
            self._unpack = Struct("<" + "".join(layout)).unpack
            self._prefixes = tuple(
                HEADER
                + bytes((servo_id,))
                + (length - PREFIX_BYTES).to_bytes(2, "little")
                + bytes((Instruction.STATUS,))
                for servo_id, length in zip(expectation.ids, lengths, strict=True)
            )
            self._seeds = tuple(map(umts, self._prefixes))
            self._each = [*zip(expectation.ids, lengths, self._prefixes, self._seeds, strict=True)]

    def read(self, data: bytes) -> Answers:
        """Read everything that came after one instruction; offsets count from ``data[0]``."""
        if len(data) == self._total and not self.expectation.broadcast_ping:
            healthy = self._is_healthy_fast if self.expectation.fast else self._is_healthy
            if healthy(data):
                return Answers(None, reader=self, healthy=data)
        return self._account(data)

    def unpacker(self, fields: str) -> Callable[[bytes], tuple[Any, ...]]:
        """What takes the values of all servos at once out of a healthy answer.

        Args:
            fields: What the parameters of each hold, in the notation of :mod:`struct`.
        """
        layout, at = "<", 0
        for place in self.places:
            layout += f"{place.data.start - at}x{fields}"
            at = place.data.stop
        return Struct(f"{layout}{self._total - at}x").unpack

    def _is_healthy(self, data: bytes) -> bool:
        # FF FF FD elsewhere than at a packet's start means stuffing, which shifts the parameters.
        if data.count(_RUN) != len(self._seeds):
            return False
        fields = self._unpack(data)
        return (
            fields[::3] == self._prefixes
            and tuple(map(umts, fields[1::3], self._seeds)) == fields[2::3]
        )

    def _is_healthy_fast(self, data: bytes) -> bool:
        # A second header in the data is legal here, but only the scanner can weigh it.
        if data.count(HEADER) != 1 or not data.startswith(self._prefix):
            return False
        fields = self._unpack(data)
        crcs = fields[1::2]
        return (
            fields[::2] == self.expectation.ids
            and tuple(map(umts, self._unpack_tiles(data), (0, *crcs))) == crcs
        )

    def _account(self, data: bytes) -> Answers:
        """The same for any bytes whatever."""
        expectation = self.expectation
        segments, answered, at = self._in_order(data)
        unexpected: list[Status] = []
        rest = scan(data[at:], runs=False, start=at)
        segments += rest
        for segment in rest:
            if segment.kind in _FOREIGN:
                continue
            for status in self._statuses_of(segment, data):
                asked = expectation.broadcast_ping or status.id in expectation.ids
                if asked and status.id not in answered:
                    answered[status.id] = status
                else:
                    unexpected.append(status)
        statuses = sorted(answered.values(), key=attrgetter("end"))
        missing = tuple(servo_id for servo_id in expectation.ids if servo_id not in answered)
        clean = (
            not unexpected
            and all(segment.kind is Kind.PACKET for segment in segments)
            and len(segments) == (1 if expectation.fast else len(statuses))
            and self._as_expected(statuses)
        )
        return Answers(statuses, missing, tuple(unexpected), None if clean else segments)

    def _in_order(self, data: bytes) -> tuple[list[Segment], dict[int, Status], int]:
        """What data begins with: intact answers in order, before any of them at most a zero.

        Returns:
            The account of that, the answers by id, and where it ends.
        """
        segments: list[Segment] = []
        answered: dict[int, Status] = {}
        at = 0
        for servo_id, length, prefix, crc in self._each:
            start = at + data.startswith(b"\0", at)
            if not data.startswith(prefix, start):
                continue
            end = start + length
            body = data[start + PREFIX_BYTES + 1 : end - 2]
            if (
                end > len(data)
                or umts(body, crc) != data[end - 2] | data[end - 1] << 8
                # It is stuffed, or another packet's header is within.
                or data.find(_RUN, start + 1, end) >= 0
            ):
                break
            if start > at:
                segments.append(Segment(Kind.ZEROS, at, start))
            packet = StatusPacket(servo_id, body[0], body[1:])
            segments.append(Segment(Kind.PACKET, start, end, packet, None, servo_id))
            answered[servo_id] = Status(servo_id, packet.error, packet.parameters, end)
            at = end
        return segments, answered, at

    def _statuses_of(self, segment: Segment, data: bytes) -> list[Status]:
        if self.expectation.fast and data.startswith(self._prefix, segment.start):
            answer = parse_fast(data[segment.start : segment.start + self._total], self.expectation)
            return [
                Status(entry.id, entry.error, entry.parameters, segment.start + entry.end)
                for entry in answer.entries
                if entry.ok
            ]
        packet = segment.packet
        if not isinstance(packet, StatusPacket):
            return []
        return [Status(packet.id, packet.error, packet.parameters, segment.end)]

    def _as_expected(self, statuses: list[Status]) -> bool:
        ids = [status.id for status in statuses]
        lengths = [len(status.parameters) for status in statuses]
        if self.expectation.broadcast_ping:
            # Each servo waits for the slot of its id, so the answers come in ascending order.
            ping_data = PING_BYTES - STATUS_BYTES
            return bool(ids) and ids == sorted(ids) and set(lengths) == {ping_data}
        expected = self.expectation
        return ids == list(expected.ids) and lengths == list(expected.data_lengths)


def _places(expectation: Expectation) -> tuple[_Place, ...]:
    places: list[_Place] = []
    start = FAST_PREFIX_BYTES if expectation.fast else 0
    before_error = 0 if expectation.fast else PREFIX_BYTES + 1
    before_data = 2 if expectation.fast else PREFIX_BYTES + 2
    for servo_id, length in zip(expectation.ids, expectation.lengths, strict=True):
        end = start + length
        span = slice(start + before_data, end - 2)
        places.append(_Place(servo_id, start + before_error, span, end))
        start = end
    return tuple(places)


@lru_cache(maxsize=256)
def reader(instruction: bytes, status_return_level: int = 2) -> AnswerReader:
    """The reader for what :func:`.expectation.expect` makes of these bytes; kept for reuse."""
    return AnswerReader(expect(instruction, status_return_level))
