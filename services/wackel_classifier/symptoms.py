"""What a single transaction shows: the thesis's tree (section 3.3), from the account of bytes.

Where the thesis counts packets of a broadcast ping, this looks at any request: who answered, who
spoke but was damaged, who was silent, who could not be heard because a predecessor was silent, and
which bytes belong to nobody.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from wackel_protocols.dynamixel2.answers import Answers
from wackel_protocols.dynamixel2.expectation import FAST_PREFIX_BYTES, Expectation
from wackel_protocols.dynamixel2.fast import parse_fast
from wackel_protocols.dynamixel2.packet import HEADER, PREFIX_BYTES
from wackel_protocols.dynamixel2.scanner import Kind, Segment

BITS_PER_BYTE = 10  # start, eight, stop

PAUSE_FILLED = 0.5
"""Share of the pauses that foreign bytes fill when somebody writes without pause. A jammer fills
them all; the rest is slack for a window that is reported longer than the host listened."""
LEADING_ZEROS = 2
"""Of a rhythmic jammer before the first answer: its own, and the one after the last packet of the
transaction before, which came when the host no longer listened."""
LEAST_BEATS = 2
"""Zeros at the right places within one fast answer that make a rhythm: one may be a spark."""
PAUSE_BYTES = 8
"""Fewer foreign bytes say nothing about a pause: a contact that sparks throws some."""


class Outcome(IntEnum):
    """What one transaction tells of one servo that was asked.

    ``SILENT``: it had its turn and nothing came. ``LOST``: nothing came, but a successor that
    waits for it answered, so it must have spoken. ``DAMAGED``: its answer came, but not intact.
    ``UNTESTED``: it waits for a predecessor that was not heard, which says nothing about it.
    """

    ANSWERED = 0
    SILENT = 1
    LOST = 2
    DAMAGED = 3
    UNTESTED = 4


# Looking up members of an enumeration takes longer than comparing them.
_ANSWERED, _UNTESTED = Outcome.ANSWERED, Outcome.UNTESTED
_PACKET, _ZEROS, _STRAY = Kind.PACKET, Kind.ZEROS, Kind.STRAY


class Sign(IntEnum):
    """The leaves of the thesis's tree for a single transaction."""

    HEALTHY = 0
    NO_SIGNAL = 1
    INCOMPLETE = 2
    RHYTHMIC = 3
    SATURATED = 4
    STRAY = 5


@dataclass(slots=True)
class Symptoms:
    """The account of one transaction.

    Attributes:
        outcomes: Of the expected servos, in request order.
        packets: Intact packets.
        zeros: Bytes 0x00 that belong to no packet and stand in no packet's place.
        stray: Other bytes of that kind.
        broken: Bytes of packets that break off or whose CRC is wrong, outside the place of one.
        rhythmic: Exactly one 0x00 before every packet and no other foreign byte.
        filled: Share of the pauses between packets that foreign bytes fill, 0 … 1.
    """

    outcomes: list[Outcome]
    packets: int = 0
    zeros: int = 0
    stray: int = 0
    broken: int = 0
    rhythmic: bool = False
    filled: float = 0.0

    @property
    def sign(self) -> Sign:
        """Where the thesis's tree ends."""
        if self.rhythmic:
            return Sign.RHYTHMIC
        foreign = self.stray + self.broken
        if self.filled >= PAUSE_FILLED and foreign >= PAUSE_BYTES:
            return Sign.SATURATED
        if foreign:
            return Sign.STRAY
        missing = any(outcome != Outcome.ANSWERED for outcome in self.outcomes)
        if not self.packets and (missing or self.zeros):
            return Sign.NO_SIGNAL
        if missing:
            return Sign.INCOMPLETE
        # Zeros beside packets are a short discharge.
        return Sign.STRAY if self.zeros else Sign.HEALTHY


def examine(expectation: Expectation, answers: Answers, data: bytes, capacity: int) -> Symptoms:
    """The symptoms of one transaction.

    Args:
        expectation: What had to come.
        answers: What came, read.
        data: What came.
        capacity: Bytes that the wire could have carried while the host listened.
    """
    if answers.segments is None and not answers.missing:
        return Symptoms([Outcome.ANSWERED] * len(expectation.ids), len(expectation.ids) or 1)
    if expectation.broadcast_ping or expectation.fast:
        symptoms = _without_places(expectation, answers, data)
    else:
        symptoms = _by_places(expectation, answers, data)
    segments = answers.segments or []
    # In a fast answer of several a jammer's zeros stand between the blocks, not just before it.
    if not expectation.fast or len(expectation.ids) == 1:
        symptoms.rhythmic = _is_rhythmic(segments)
    taken = sum(s.end - s.start for s in segments if s.kind is _PACKET)
    foreign = symptoms.zeros + symptoms.stray + symptoms.broken
    if capacity > taken:
        symptoms.filled = min(1.0, foreign / (capacity - taken))
    return symptoms


def _by_places(expectation: Expectation, answers: Answers, data: bytes) -> Symptoms:
    """For answers that follow each other: a gap between packets is the place of who is missing."""
    assert answers.segments is not None
    ids, missing = expectation.ids, answers.missing
    outcomes = [_UNTESTED if servo_id in missing else _ANSWERED for servo_id in ids]
    places = {servo_id: place for place, servo_id in enumerate(ids)}
    symptoms = Symptoms(outcomes)
    gap: list[Segment] = []
    turn = 0  # whose answer is due
    for segment in answers.segments:
        if segment.kind is not _PACKET:
            gap.append(segment)
            continue
        symptoms.packets += 1
        place = places.get(segment.id, -1) if segment.id is not None else -1
        if place < turn:
            continue  # somebody who was not asked, or a second answer
        if gap or place > turn:
            unheard = _missing(outcomes, turn, place) if place > turn else []
            _judge_gap(symptoms, expectation.lengths, unheard, gap, data, followed=True)
            gap = []
        turn = place + 1
    if gap or turn < len(ids):
        unheard = _missing(outcomes, turn, len(ids))
        _judge_gap(symptoms, expectation.lengths, unheard, gap, data, followed=False)
    return symptoms


def _missing(outcomes: list[Outcome], first: int, end: int) -> list[int]:
    return [place for place in range(first, end) if outcomes[place] is not _ANSWERED]


def _judge_gap(
    symptoms: Symptoms,
    lengths: Sequence[int],
    missing: list[int],
    gap: list[Segment],
    data: bytes,
    *,
    followed: bool,
) -> None:
    """Accounts for the bytes between two answers, or after the last one."""
    outcomes = symptoms.outcomes
    zeros = stray = broken = 0
    for segment in gap:
        size = segment.end - segment.start
        if segment.kind is _ZEROS:
            zeros += size
        elif segment.kind is _STRAY:
            nothing = data.count(0, segment.start, segment.end)
            zeros += nothing
            stray += size - nothing
        else:
            broken += size
    total = zeros + stray + broken
    if missing and total == zeros <= len(missing):
        # Nothing was said; single zeros are a line without a driver, or a rhythmic jammer.
        symptoms.zeros += zeros
        _mark(outcomes, missing, Outcome.LOST if followed else Outcome.SILENT, followed)
        return
    damaged = _damaged_in_place(lengths, missing, total, zeros, followed) if missing else 0
    if damaged:
        for place in missing[:damaged]:
            outcomes[place] = Outcome.DAMAGED
        return
    symptoms.zeros += zeros
    symptoms.stray += stray
    symptoms.broken += broken
    if not missing:
        return
    begun = broken and any(s.kind in (Kind.BAD_CRC, Kind.TRUNCATED) and _is_head(s) for s in gap)
    if begun or (followed and total > zeros):
        _mark(outcomes, missing, Outcome.DAMAGED, followed)
    else:
        _mark(outcomes, missing, Outcome.LOST if followed else Outcome.SILENT, followed)


def _is_head(segment: Segment) -> bool:
    return segment.end - segment.start >= PREFIX_BYTES


def _mark(outcomes: list[Outcome], missing: list[int], outcome: Outcome, followed: bool) -> None:
    """All of the missing if somebody answered after them, else only the one whose turn it was."""
    for place in missing if followed else missing[:1]:
        outcomes[place] = outcome


def _damaged_in_place(
    lengths: Sequence[int], missing: list[int], total: int, zeros: int, followed: bool
) -> int:
    """How many of the missing fill the gap exactly: noise alters bytes, but never their number."""
    if followed:
        needed = sum(lengths[place] for place in missing)
        return len(missing) if missing and needed in (total, total - zeros) else 0
    length = 0
    for count, place in enumerate(missing, start=1):
        length += lengths[place]
        if length in (total, total - zeros):
            return count
    return 0


def _without_places(expectation: Expectation, answers: Answers, data: bytes) -> Symptoms:
    """For a fast answer (one packet) and a broadcast ping (each servo in its own time slot)."""
    segments = answers.segments or []
    symptoms = Symptoms([], len(answers.statuses))
    for segment in segments:
        size = segment.end - segment.start
        if segment.kind is _ZEROS:
            symptoms.zeros += size
        elif segment.kind is _STRAY:
            nothing = data.count(0, segment.start, segment.end)
            symptoms.zeros += nothing
            symptoms.stray += size - nothing
        elif segment.kind is not _PACKET:
            symptoms.broken += size
    if not expectation.fast:
        symptoms.outcomes = [
            Outcome.SILENT if servo_id in answers.missing else Outcome.ANSWERED
            for servo_id in expectation.ids
        ]
        return symptoms
    _judge_fast(symptoms, expectation, answers, data)
    return symptoms


def _judge_fast(
    symptoms: Symptoms, expectation: Expectation, answers: Answers, data: bytes
) -> None:
    """Accounts for a fast answer: each servo's block has its place in the one packet."""
    ids, lengths = expectation.ids, expectation.lengths
    beats = _beats(expectation, data)
    if beats:
        symptoms.rhythmic = True
        # A host that counts bytes stops listening too early, by as many as there are zeros.
        early = len(data) >= expectation.total_bytes
        next_one = Outcome.UNTESTED if early else Outcome.SILENT
        behind = [next_one] + [Outcome.UNTESTED] * len(ids)
        symptoms.outcomes = ([Outcome.ANSWERED] * beats + behind)[: len(ids)]
        symptoms.packets = symptoms.zeros = beats
        symptoms.stray = symptoms.broken = 0
        return
    missing = answers.missing
    outcomes = symptoms.outcomes = [
        Outcome.UNTESTED if servo_id in missing else Outcome.ANSWERED for servo_id in ids
    ]
    tail = len(ids)
    while tail and outcomes[tail - 1] is not Outcome.ANSWERED:
        tail -= 1
    # Blocks have fixed places, so one between intact ones came damaged; a damaged CRC costs the
    # next block, too, which says nothing about its servo.
    for index in range(tail):
        damaged_before = index and outcomes[index - 1] is Outcome.DAMAGED
        if outcomes[index] is not Outcome.ANSWERED and not damaged_before:
            outcomes[index] = Outcome.DAMAGED
    head = 0 if tail else FAST_PREFIX_BYTES
    foreign = data[answers.statuses[-1].end :] if tail else data
    if tail < len(ids):
        rest = head + sum(lengths[tail:])
        outcomes[tail], in_place = _judge_tail(foreign, head + lengths[tail], rest, ids[tail])
        for later in range(tail + 1, len(ids)):
            if len(foreign) == sum(lengths[later:]) and foreign[1] == ids[later]:
                # The others have spoken after it; their CRCs cover what was lost.
                outcomes[tail], in_place = Outcome.LOST, True
                if later > tail + 1:
                    outcomes[tail + 1] = Outcome.LOST
                break
    else:
        in_place = not foreign
    symptoms.broken = 0
    symptoms.zeros = 0 if in_place else foreign.count(0)
    symptoms.stray = 0 if in_place else len(foreign) - symptoms.zeros
    if not in_place and tail < len(ids) and outcomes[tail] is Outcome.DAMAGED:
        symptoms.broken, symptoms.zeros, symptoms.stray = len(foreign), 0, 0


def _judge_tail(tail: bytes, own: int, rest: int, servo_id: int) -> tuple[Outcome, bool]:
    """What became of the first servo behind the intact part of a fast answer.

    Args:
        tail: Bytes behind the intact part.
        own: Bytes that this servo had to send.
        rest: Bytes that it and all behind it had to send.
        servo_id: Its id.

    Returns:
        The outcome, and whether these bytes are what is left of answers and not foreign.
    """
    if not tail.strip(b"\0") and len(tail) <= 1:
        return Outcome.SILENT, True
    mine = tail[1:2] == bytes((servo_id,)) or tail.startswith(HEADER[:3])
    if len(tail) in (rest, own):
        return Outcome.DAMAGED, True
    if len(tail) > rest:
        return Outcome.UNTESTED, False  # among foreign bytes it cannot be told
    return (Outcome.DAMAGED if mine else Outcome.SILENT), False


def _beats(expectation: Expectation, data: bytes) -> int:
    """How many blocks of a fast answer are intact but for a zero after each; 0 if they are not."""
    begin = data.find(HEADER)
    if not 0 <= begin <= LEADING_ZEROS or data[:begin].strip(b"\0"):
        return 0
    start = begin
    parts = bytearray()
    count = 0
    for length in expectation.lengths:
        end = start + length + (0 if count else FAST_PREFIX_BYTES)
        if end > len(data) or data[end : end + 1] not in (b"\0", b""):
            break
        parts += data[start:end]
        start = end + 1
        count += 1
    if count < LEAST_BEATS:
        return 0
    entries = parse_fast(bytes(parts), expectation).entries
    return count if all(entry.ok for entry in entries) else 0


def _is_rhythmic(segments: list[Segment]) -> bool:
    """Zero, packet, zero, packet, … (thesis, 2.5.4).

    The zero after the last packet of the transaction before may stand first, too, and the one
    after the last packet may come when the host no longer listens.
    """
    zeros = 0
    packets = 0
    for index, segment in enumerate(segments):
        if segment.kind is _ZEROS:
            zeros = segment.end - segment.start
            if zeros > (LEADING_ZEROS if index == 0 else 1):
                return False
        elif segment.kind is _PACKET:
            if not zeros:
                return False
            packets += 1
            zeros = 0
        elif segment.kind is _STRAY:
            return False
    return packets > 0
