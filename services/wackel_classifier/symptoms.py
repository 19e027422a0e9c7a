"""What a single transaction shows: the thesis's tree (section 3.3), from the account of bytes.

Where the thesis counts packets of a broadcast ping, this looks at any request: who answered, who
spoke but was damaged, who was silent, who could not be heard because a predecessor was silent, and
which bytes belong to nobody.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import accumulate

from wackel_protocols.dynamixel2.answers import Answers
from wackel_protocols.dynamixel2.expectation import FAST_PREFIX_BYTES, Expectation
from wackel_protocols.dynamixel2.packet import PREFIX_BYTES
from wackel_protocols.dynamixel2.scanner import Kind, Segment

BITS_PER_BYTE = 10  # start, eight, stop

PAUSE_FILLED = 0.5
"""Share of the pauses that foreign bytes fill when somebody writes without pause. A jammer fills
them all; the rest is slack for a window that is reported longer than the host listened."""
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


def examine(expectation: Expectation, answers: Answers, capacity: int) -> Symptoms:
    """The symptoms of one transaction.

    Args:
        expectation: What had to come.
        answers: What came.
        capacity: Bytes that the wire could have carried while the host listened.
    """
    if answers.segments is None:
        return Symptoms([Outcome.ANSWERED] * len(expectation.ids), len(expectation.ids) or 1)
    if expectation.broadcast_ping or expectation.fast:
        symptoms = _without_places(expectation, answers)
    else:
        symptoms = _by_places(expectation, answers)
    symptoms.rhythmic = _is_rhythmic(answers.segments)
    taken = sum(s.end - s.start for s in answers.segments if s.kind is Kind.PACKET)
    foreign = symptoms.zeros + symptoms.stray + symptoms.broken
    if capacity > taken:
        symptoms.filled = min(1.0, foreign / (capacity - taken))
    return symptoms


def _by_places(expectation: Expectation, answers: Answers) -> Symptoms:
    """For answers that follow each other: a gap between packets is the place of who is missing."""
    assert answers.segments is not None
    places = {servo_id: place for place, servo_id in enumerate(expectation.ids)}
    outcomes = [
        Outcome.UNTESTED if servo_id in answers.missing else Outcome.ANSWERED
        for servo_id in expectation.ids
    ]
    symptoms = Symptoms(outcomes)
    gap: list[Segment] = []
    turn = 0  # whose answer is due
    for segment in answers.segments:
        if segment.kind is not Kind.PACKET:
            gap.append(segment)
            continue
        symptoms.packets += 1
        place = places.get(segment.id if segment.id is not None else -1, -1)
        if place < turn:
            continue  # somebody who was not asked, or a second answer
        _judge_gap(symptoms, expectation.lengths, _missing(outcomes, turn, place), gap, True)
        gap, turn = [], place + 1
    _judge_gap(symptoms, expectation.lengths, _missing(outcomes, turn, len(outcomes)), gap, False)
    return symptoms


def _missing(outcomes: list[Outcome], first: int, end: int) -> list[int]:
    return [place for place in range(first, end) if outcomes[place] != Outcome.ANSWERED]


def _judge_gap(
    symptoms: Symptoms,
    lengths: Sequence[int],
    missing: list[int],
    gap: list[Segment],
    followed: bool,
) -> None:
    """Accounts for the bytes between two answers, or after the last one."""
    outcomes = symptoms.outcomes
    total = sum(segment.end - segment.start for segment in gap)
    zeros = sum(segment.end - segment.start for segment in gap if segment.kind is Kind.ZEROS)
    if missing and total == zeros <= len(missing):
        # Nothing was said; single zeros are a line without a driver, or a rhythmic jammer.
        symptoms.zeros += zeros
        _mark(outcomes, missing, Outcome.LOST if followed else Outcome.SILENT, followed)
        return
    damaged = _damaged_in_place(lengths, missing, total, zeros, followed)
    if damaged:
        for place in missing[:damaged]:
            outcomes[place] = Outcome.DAMAGED
        return
    for segment in gap:
        size = segment.end - segment.start
        if segment.kind is Kind.ZEROS:
            symptoms.zeros += size
        elif segment.kind is Kind.STRAY:
            symptoms.stray += size
        else:
            symptoms.broken += size
    if not missing:
        return
    begun = any(s.kind in (Kind.BAD_CRC, Kind.TRUNCATED) and _is_head(s) for s in gap)
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


def _without_places(expectation: Expectation, answers: Answers) -> Symptoms:
    """For a fast answer (one packet) and a broadcast ping (each servo in its own time slot)."""
    assert answers.segments is not None
    symptoms = Symptoms([], sum(s.kind is Kind.PACKET for s in answers.segments))
    total = 0
    for segment in answers.segments:
        size = segment.end - segment.start
        total += size
        if segment.kind is Kind.ZEROS:
            symptoms.zeros += size
        elif segment.kind is Kind.STRAY:
            symptoms.stray += size
        elif segment.kind is not Kind.PACKET:
            symptoms.broken += size
    if not expectation.fast:
        symptoms.outcomes = [
            Outcome.SILENT if servo_id in answers.missing else Outcome.ANSWERED
            for servo_id in expectation.ids
        ]
        return symptoms
    symptoms.packets += len(answers.statuses)
    _judge_fast(symptoms, expectation, answers, total)
    return symptoms


def _judge_fast(symptoms: Symptoms, expectation: Expectation, answers: Answers, total: int) -> None:
    """Each CRC covers all before it, so nothing is known of those behind the first failure."""
    ends = accumulate(expectation.lengths, initial=FAST_PREFIX_BYTES)
    failed = False
    for servo_id, start, length in zip(expectation.ids, ends, expectation.lengths, strict=False):
        if servo_id not in answers.missing:
            symptoms.outcomes.append(Outcome.ANSWERED)
            continue
        if failed:
            symptoms.outcomes.append(Outcome.UNTESTED)
            continue
        failed = True
        spoken = total - (0 if start == FAST_PREFIX_BYTES else start)
        if total == expectation.total_bytes or spoken == length:
            outcome = Outcome.DAMAGED
        elif total == expectation.total_bytes - length or spoken > length:
            outcome = Outcome.LOST  # others have spoken after it
        else:
            outcome = Outcome.SILENT
        symptoms.outcomes.append(outcome)
        if spoken == 0 or outcome in (Outcome.DAMAGED, Outcome.LOST):
            # The beginning of the frame, or bytes in their place: nothing foreign.
            symptoms.stray = symptoms.broken = 0


def _is_rhythmic(segments: list[Segment]) -> bool:
    """Zero, packet, zero, packet, … (thesis, 2.5.4).

    The zero after the last packet of the transaction before may stand first, too, and the one
    after the last packet may come when the host no longer listens.
    """
    zeros = 0
    packets = 0
    for index, segment in enumerate(segments):
        if segment.kind is Kind.ZEROS:
            zeros = segment.end - segment.start
            if zeros > (2 if index == 0 else 1):
                return False
        elif segment.kind is Kind.PACKET:
            if not zeros:
                return False
            packets += 1
            zeros = 0
        elif segment.kind is Kind.STRAY:
            return False
    return packets > 0
