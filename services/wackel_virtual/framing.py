"""How servos find instructions in the bytes that the host sends.

Source: ROBOTIS e-manual, Protocol 2.0, "Packet Process"; a gap of more than 1.5 ms within an
instruction makes them drop it.
"""

from dataclasses import dataclass
from functools import lru_cache

from wackel_protocols.dynamixel2.packet import CrcError, InstructionPacket, PacketError, decode
from wackel_protocols.dynamixel2.scanner import Kind, Scanner

GAP_NS = 1_500_000
"""The longest pause within an instruction."""


@dataclass(slots=True, eq=False)
class Heard:
    """An instruction on the wire.

    Attributes:
        start_ns, end_ns: Of its bytes.
        baud_rate: At which it was sent.
        packet: What it says; None if its CRC is wrong.
        bad_crc_id: Then, the id that it names.
        collided: Somebody else was sending, so nobody understands it.
        missed_from: Servos from this position on were not connected all the time.
    """

    start_ns: int
    end_ns: int
    baud_rate: int
    packet: InstructionPacket | None
    bad_crc_id: int | None
    collided: bool = False
    missed_from: int = 1 << 30


class Framer:
    """Finds the instructions in a stream of bytes with pauses."""

    def __init__(self) -> None:
        self._scanner = Scanner()
        self._scanned = 0
        self._partial = False  # whether the scanner may hold the beginning of an instruction
        self._end_ns = 0
        self._baud_rate = 0

    def take(self, data: bytes, start_ns: int, byte_ns: int, baud_rate: int) -> list[Heard]:
        """The instructions that end within ``data``, whose first byte begins at ``start_ns``."""
        if start_ns - self._end_ns > GAP_NS or baud_rate != self._baud_rate:
            self._partial = False
        self._end_ns = start_ns + len(data) * byte_ns
        self._baud_rate = baud_rate
        if not self._partial:
            # Nearly always one write is one instruction.
            understood = _understand(data)
            if isinstance(understood, InstructionPacket):
                return [Heard(start_ns, self._end_ns, baud_rate, understood, None)]
            if understood is not None:
                return [Heard(start_ns, self._end_ns, baud_rate, None, understood)]
            self._scanner, self._scanned, self._partial = Scanner(), 0, True
        offset = self._scanned
        self._scanned += len(data)
        heard = []
        for segment in self._scanner.feed(data):
            first = start_ns + (segment.start - offset) * byte_ns
            last = start_ns + (segment.end - offset) * byte_ns
            if segment.kind is Kind.PACKET and isinstance(segment.packet, InstructionPacket):
                heard.append(Heard(first, last, baud_rate, segment.packet, None))
            elif segment.kind is Kind.BAD_CRC:
                heard.append(Heard(first, max(last, start_ns), baud_rate, None, segment.id))
        return heard


@lru_cache(maxsize=256)
def _understand(data: bytes) -> InstructionPacket | int | None:
    """The instruction in ``data``; the id in it if only its CRC is wrong; None if neither."""
    try:
        packet = decode(data)
    except CrcError:
        return data[4]
    except PacketError:
        return None
    return packet if isinstance(packet, InstructionPacket) else None
