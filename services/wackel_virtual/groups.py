"""Instructions for several servos: who reads and writes what.

Source: ROBOTIS e-manual, Protocol 2.0, "Sync Read" to "Fast Bulk Read".
"""

from collections.abc import Iterator
from functools import lru_cache

from wackel_protocols.dynamixel2.expectation import Expectation, expect
from wackel_protocols.dynamixel2.packet import Instruction, InstructionPacket

READS = frozenset(
    (
        Instruction.SYNC_READ,
        Instruction.BULK_READ,
        Instruction.FAST_SYNC_READ,
        Instruction.FAST_BULK_READ,
    )
)
WRITES = frozenset((Instruction.SYNC_WRITE, Instruction.BULK_WRITE))


@lru_cache(maxsize=256)
def reads(packet: InstructionPacket) -> tuple[Expectation, tuple[tuple[int, int], ...]] | None:
    """Who answers one of :data:`READS`, with (address, length) for each; None if malformed."""
    expectation = expect(packet.encode())
    if not expectation.ids:
        return None
    parameters = packet.parameters
    if packet.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        addresses = [_word(parameters)] * len(expectation.ids)
    else:
        addresses = [_word(parameters[i + 1 :]) for i in range(0, len(parameters), 5)]
    return expectation, tuple(zip(addresses, expectation.data_lengths, strict=True))


def writes(packet: InstructionPacket) -> Iterator[tuple[int, int, bytes]]:
    """(id, address, data) of one of :data:`WRITES`; an incomplete piece at the end is ignored."""
    data = packet.parameters
    if packet.instruction == Instruction.SYNC_WRITE:
        if len(data) < 4:
            return
        address, step = _word(data), 1 + _word(data[2:])
        for start in range(4, len(data) - step + 1, step):
            yield data[start], address, data[start + 1 : start + step]
        return
    start = 0
    while start + 5 <= len(data):
        end = start + 5 + _word(data[start + 3 :])
        if end > len(data):
            return
        yield data[start], _word(data[start + 1 :]), data[start + 5 : end]
        start = end


def _word(data: bytes) -> int:
    return data[0] | data[1] << 8
