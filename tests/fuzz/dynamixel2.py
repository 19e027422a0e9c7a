"""Dynamixel Protocol 2.0 under fire: the scanner on streams, the answer reader on bursts."""

from itertools import pairwise

import numpy as np

from tests.fuzz.target import Outcome, Target
from tests.protocols.material import assert_tiles, judge
from wackel_protocols.dynamixel2 import Kind, Scanner, StatusPacket, reader, scan
from wackel_protocols.dynamixel2 import packet as dxl
from wackel_protocols.dynamixel2.expectation import expect
from wackel_protocols.dynamixel2.fast import encode_fast
from wackel_protocols.dynamixel2.packet import HEADER, InstructionPacket

STREAM_PIECES = 400
FRAMING = np.frombuffer(bytes([0xFF, 0xFF, 0xFD, 0x00, 0x55, 0xFE, 1, 3, 8]), np.uint8)


def random_bytes(rng: np.random.Generator, most: int) -> bytes:
    """Up to ``most`` bytes: evenly distributed, or of those that framing is made of."""
    length = int(rng.integers(most + 1))
    if rng.random() < 0.5:
        return rng.bytes(length)
    return rng.choice(FRAMING, length).tobytes()


def random_packet(rng: np.random.Generator) -> bytes:
    """An intact packet of any kind."""
    parameters = random_bytes(rng, 40)
    if rng.random() < 0.7:
        return StatusPacket(int(rng.integers(253)), int(rng.integers(256)), parameters).encode()
    instruction = int(rng.choice([1, 2, 3, 4, 5, 8, 0x82, 0x83, 0x8A, 0x92, 0x93]))
    servo_id = int(rng.choice([254, rng.integers(253)]))
    return InstructionPacket(servo_id, instruction, parameters).encode()


def mutated(rng: np.random.Generator, data: bytes) -> bytes:
    """The same with a few bytes changed, lost or put in."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(changed) + 1))
        way = rng.integers(3)
        if way == 0:
            changed[at : at + 1] = rng.bytes(1)
        elif way == 1:
            del changed[at : at + int(rng.integers(1, 6))]
        else:
            changed[at:at] = random_bytes(rng, 6)
    return bytes(changed)


def scanner_round(rng: np.random.Generator) -> Outcome:
    """A stream of intact, mutated, cut and invented packets, zeros and noise, in random chunks."""
    pieces: list[bytes] = []
    planted: list[tuple[int, int]] = []
    length = 0
    for _ in range(STREAM_PIECES):
        way = rng.random()
        if way < 0.35:
            piece = random_packet(rng)
            planted.append((length, length + len(piece)))
        elif way < 0.6:
            piece = mutated(rng, random_packet(rng))
        elif way < 0.7:
            claim = int(rng.choice([0xFFFF, rng.integers(65536), rng.integers(40)]))
            piece = HEADER + rng.bytes(1) + claim.to_bytes(2, "little")
        elif way < 0.8:
            piece = bytes(int(rng.integers(20)))
        else:
            piece = random_bytes(rng, 200)
        pieces.append(piece)
        length += len(piece)
    data = b"".join(pieces)

    segments = scan(data)
    outcome = Outcome(bytes=len(data), planted=len(planted))
    outcome.kinds.update(segment.kind.name for segment in segments)
    try:
        assert_tiles(segments, data)
    except AssertionError as broken:
        outcome.violations.append(f"segments do not tile the stream: {broken}")
    accepted = [(s.start, s.end, s.packet) for s in segments if s.kind is Kind.PACKET]
    if accepted != judge(data):
        outcome.violations.append("the packets found are not those that are there")
    if in_chunks(rng, data) != segments:
        outcome.violations.append("the result depends on how the stream was cut")

    places = [(start, end) for start, end, _ in accepted]
    for start, end in set(planted) - set(places):
        if any(other < end and start < other_end <= end for other, other_end in places):
            outcome.shadowed += 1
        else:
            outcome.violations.append(f"the packet at {start} … {end} was not found")
    outcome.found = len(planted) - len(set(planted) - set(places))
    return outcome


def in_chunks(rng: np.random.Generator, data: bytes) -> list[object]:
    """The scanner's account of the same bytes, fed in random chunks."""
    longest = int(rng.choice([3, 50, 5000]))
    steps = rng.integers(1, longest + 1, 2 * len(data) // longest + 2)
    cuts = [0, *(int(cut) for cut in np.cumsum(steps) if cut < len(data)), len(data)]
    scanner = Scanner()
    segments: list[object] = []
    for start, end in pairwise(cuts):
        segments += scanner.feed(data[start:end])
    return segments + list(scanner.finish())


def answers_round(rng: np.random.Generator) -> Outcome:
    """Bursts of answers, healthy and mutated: the short way and the scanner say the same."""
    outcome = Outcome()
    for _ in range(200):
        ids = [int(i) for i in rng.permutation(253)[: int(rng.integers(1, 21))]]
        width = int(rng.integers(1, 13))
        fast = rng.random() < 0.5
        letters = FRAMING if rng.random() < 0.3 else np.arange(256, dtype=np.uint8)
        values = [(int(rng.integers(256)), rng.choice(letters, width).tobytes()) for _ in ids]
        request = (dxl.fast_sync_read if fast else dxl.sync_read)(ids, 132, width)
        if fast:
            data = encode_fast(expect(request), values)
        else:
            data = b"".join(
                StatusPacket(servo_id, error, parameters).encode()
                for servo_id, (error, parameters) in zip(ids, values, strict=True)
            )
        healthy = rng.random() < 0.3
        if healthy:
            outcome.planted += len(ids)
        else:
            data = mutated(rng, data)
        answer_reader = reader(request)
        quick, slow = answer_reader.read(data), answer_reader._account(data)
        outcome.bytes += len(data)
        outcome.kinds["clean" if quick.clean else "accounted"] += 1
        both = [(a.clean, a.statuses, a.missing, a.unexpected, a.segments) for a in (quick, slow)]
        if both[0] != both[1]:
            outcome.violations.append(f"the short way differs from the scanner: {data.hex()}")
        said = [(status.id, status.error, status.parameters) for status in quick.statuses]
        if healthy:
            expected = [(i, e, d) for i, (e, d) in zip(ids, values, strict=True)]
            outcome.found += sum(one in said for one in expected)
            if said != expected or not quick.clean:
                outcome.violations.append(f"a healthy answer was not read: {data.hex()}")
        if quick.segments is not None:
            try:
                assert_tiles(quick.segments, data, runs=False)
            except AssertionError as broken:
                outcome.violations.append(f"segments do not tile the burst: {broken}")
    return outcome


TARGETS = (
    Target("dynamixel2 scanner", 0.8, scanner_round),
    Target("dynamixel2 answers", 0.2, answers_round),
)
