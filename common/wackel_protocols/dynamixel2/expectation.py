"""Which answers an instruction calls for, from its bytes alone.

Source: ROBOTIS e-manual, Protocol 2.0, "Response Policy" and "Instruction Details"; control tables,
"Status Return Level(68)": 0 answers ping only, 1 ping and reads, 2 everything. To the broadcast id
only ping and the reads of several servos are answered.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

from wackel_protocols.dynamixel2.packet import (
    BROADCAST_ID,
    MAX_ID,
    MAX_LEN,
    PREFIX_BYTES,
    STATUS_BYTES,
    Instruction,
    InstructionPacket,
    PacketError,
    decode,
)

PING_BYTES = STATUS_BYTES + 3
"""The answer to a ping: model number and firmware version."""
FAST_PREFIX_BYTES = 8
"""Header, id, LEN and instruction of a fast answer."""
FAST_BLOCK_BYTES = 4
"""Error, id and CRC of one servo in a fast answer, beside its data."""

SLOWEST_NS = 1_200_000
"""No servo at work needs longer: Return Delay Time at most 508 µs, processing and USB frame some
600 µs more (thesis, 2.7: 672 µs with a delay of 500 µs; 1000 µs with a latency timer of 1 ms)."""


@dataclass(frozen=True)
class Expectation:
    """What has to come back.

    Attributes:
        ids: Servos that have to answer, in the order of their answers.
        lengths: Bytes of each answer: of the unstuffed status packet, or, in a fast answer, of
            the servo's block (error, id, data, CRC).
        fast: All of them answer in one packet.
        broadcast_ping: Any servo may answer, each with :data:`PING_BYTES`.
    """

    ids: tuple[int, ...] = ()
    lengths: tuple[int, ...] = ()
    fast: bool = False
    broadcast_ping: bool = False

    @cached_property
    def total_bytes(self) -> int:
        """Bytes of all answers together if none is stuffed."""
        return sum(self.lengths) + (FAST_PREFIX_BYTES if self.fast else 0)

    @cached_property
    def data_lengths(self) -> tuple[int, ...]:
        """Bytes of parameters of each answer."""
        overhead = FAST_BLOCK_BYTES if self.fast else STATUS_BYTES
        return tuple(length - overhead for length in self.lengths)


NOTHING = Expectation()
_BROADCAST_PING = Expectation(broadcast_ping=True)


@lru_cache(maxsize=1024)
def expect(instruction: bytes, status_return_level: int = 2) -> Expectation:
    """What has to come back after these bytes; nothing if they are no valid instruction packet."""
    try:
        packet = decode(instruction)
    except PacketError:
        return NOTHING
    if not isinstance(packet, InstructionPacket):
        return NOTHING
    if packet.instruction == Instruction.PING:
        if packet.id == BROADCAST_ID:
            return _BROADCAST_PING
        return Expectation((packet.id,), (PING_BYTES,))
    if packet.id == BROADCAST_ID:
        return _group(packet) if status_return_level >= 1 else NOTHING
    if packet.instruction == Instruction.READ:
        if status_return_level < 1 or len(packet.parameters) != 4:
            return NOTHING
        length = int.from_bytes(packet.parameters[2:], "little")
        return _possible(Expectation((packet.id,), (STATUS_BYTES + length,)))
    if status_return_level < 2 or packet.instruction in _GROUP:
        return NOTHING
    return Expectation((packet.id,), (STATUS_BYTES,))


_FAST = frozenset((Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ))
_SYNC_READ = frozenset((Instruction.SYNC_READ, Instruction.FAST_SYNC_READ))
_BULK_READ = frozenset((Instruction.BULK_READ, Instruction.FAST_BULK_READ))
_GROUP = _SYNC_READ | _BULK_READ | {Instruction.SYNC_WRITE, Instruction.BULK_WRITE}


def _group(packet: InstructionPacket) -> Expectation:
    """The answers to a read of several servos; nothing where its parameters are malformed."""
    parameters = packet.parameters
    if packet.instruction in _SYNC_READ and len(parameters) > 4:
        ids = tuple(parameters[4:])
        lengths = (int.from_bytes(parameters[2:4], "little"),) * len(ids)
    elif packet.instruction in _BULK_READ and len(parameters) % 5 == 0:
        ids = tuple(parameters[::5])
        lengths = tuple(
            int.from_bytes(parameters[i : i + 2], "little") for i in range(3, len(parameters), 5)
        )
    else:
        return NOTHING
    if not ids or max(ids) > MAX_ID or len(set(ids)) != len(ids):
        return NOTHING
    fast = packet.instruction in _FAST
    overhead = FAST_BLOCK_BYTES if fast else STATUS_BYTES
    return _possible(Expectation(ids, tuple(overhead + length for length in lengths), fast))


def _possible(expectation: Expectation) -> Expectation:
    """The same, or nothing if LEN cannot hold an answer that long."""
    packets = (expectation.total_bytes,) if expectation.fast else expectation.lengths
    return NOTHING if max(packets) - PREFIX_BYTES > MAX_LEN else expectation
