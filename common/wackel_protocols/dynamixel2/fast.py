"""Answers to fast sync read and fast bulk read: one packet that several servos write in turn.

``FF FF FD 00 | FE | LEN | 55 | error id data… CRC | error id data… CRC | …``, never stuffed. Each
CRC runs over everything before it, earlier CRCs included, so the packet is a valid status packet of
the broadcast id if its last CRC is right. Source: ROBOTIS e-manual, Protocol 2.0, "Fast Sync Read".

A CRC over a string that ends in a right CRC can be continued from that CRC's own value. So each
block is checked against the CRC that stands before it: damage in one block costs that servo, and
the next one only if the CRC itself is hit.
"""

from dataclasses import dataclass
from functools import lru_cache

from fastcrc.crc16 import umts

from wackel_protocols.dynamixel2.expectation import FAST_PREFIX_BYTES, Expectation
from wackel_protocols.dynamixel2.packet import BROADCAST_ID, HEADER, Instruction


@dataclass(frozen=True, slots=True)
class FastEntry:
    """What one servo wrote into a fast answer.

    Attributes:
        id: The servo that had to write here.
        error: Its error byte.
        parameters: Its data.
        ok: Whether the block's CRC and id are right; if not, the other values cannot be trusted.
        end: Offset after the block's CRC within the answer.
    """

    id: int
    error: int
    parameters: bytes
    ok: bool
    end: int


@dataclass(frozen=True, slots=True)
class FastAnswer:
    """A fast answer, as far as it came.

    Attributes:
        entries: One for each block that came in full, in the order of the request.
        ok: Whether every servo's block came and is right.
    """

    entries: tuple[FastEntry, ...]
    ok: bool


@lru_cache(maxsize=256)
def fast_prefix(expectation: Expectation) -> bytes:
    """The first eight bytes of the answer: header, broadcast id, LEN and instruction."""
    length = 1 + sum(expectation.lengths)
    return (
        HEADER
        + bytes((BROADCAST_ID,))
        + length.to_bytes(2, "little")
        + bytes((Instruction.STATUS,))
    )


def parse_fast(data: bytes, expectation: Expectation) -> FastAnswer:
    """Read an answer that starts at ``data[0]`` and may be damaged or cut off.

    Without the right first eight bytes there is nothing to read.
    """
    if not data.startswith(fast_prefix(expectation)):
        return FastAnswer((), ok=False)
    entries: list[FastEntry] = []
    start, seed, checked_from = FAST_PREFIX_BYTES, 0, 0
    for servo_id, length in zip(expectation.ids, expectation.lengths, strict=True):
        end = start + length
        if end > len(data):
            break
        found = int.from_bytes(data[end - 2 : end], "little")
        right = umts(data[checked_from : end - 2], seed) == found and data[start + 1] == servo_id
        entries.append(FastEntry(servo_id, data[start], data[start + 2 : end - 2], right, end))
        start, seed, checked_from = end, found, end - 2
    complete = len(entries) == len(expectation.ids)
    return FastAnswer(tuple(entries), ok=complete and all(entry.ok for entry in entries))


def encode_fast(expectation: Expectation, values: list[tuple[int, bytes]]) -> bytes:
    """The answer that servos write: (error, data) of the first ``len(values)`` of them.

    Fewer values than servos is what stands on the bus when a servo breaks the chain.
    """
    answer = fast_prefix(expectation)
    for servo_id, (error, parameters) in zip(expectation.ids, values, strict=False):
        answer += bytes((error, servo_id)) + parameters
        answer += umts(answer).to_bytes(2, "little")
    return answer
