"""What the tests of the wire protocols share: generators of bytes, and a slow, plain judge."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import strategies as st

from wackel_protocols.dynamixel2 import InstructionPacket, Kind, Segment, StatusPacket, decode
from wackel_protocols.dynamixel2.packet import BROADCAST_ID, HEADER, MAX_ID, Packet, PacketError

VECTORS = Path(__file__).parents[2].parent / "shared" / "data" / "dynamixel_vectors.json"

# The bytes that framing is made of, so that accidents of framing happen often.
FRAMING = st.sampled_from([0xFF, 0xFF, 0xFD, 0x00, 0x55, 0xFE, 0x01, 0x03, 0x08])
nasty_bytes = st.binary(max_size=40) | st.lists(FRAMING, max_size=40).map(bytes)
ids = st.integers(0, MAX_ID)
status_packets = st.builds(StatusPacket, ids, st.integers(0, 255), nasty_bytes)
instruction_packets = st.builds(
    InstructionPacket,
    ids | st.just(BROADCAST_ID),
    st.integers(0, 255).filter(lambda number: number != 0x55),
    nasty_bytes,
)
packets = status_packets | instruction_packets


class Wire:
    """A port for the vendor's packet handler: keeps what it writes, gives what it shall read."""

    is_using = False

    def __init__(self, to_read: bytes = b"") -> None:
        self.written = b""
        self._to_read = list(to_read)

    def clearPort(self) -> None: ...

    def writePort(self, data: list[int]) -> int:
        self.written += bytes(data)
        return len(data)

    def readPort(self, length: int) -> list[int]:
        taken, self._to_read = self._to_read[:length], self._to_read[length:]
        return taken

    def setPacketTimeout(self, length: int) -> None: ...

    def isPacketTimeout(self) -> bool:
        return not self._to_read


def vectors() -> list[dict[str, Any]]:
    """The published packets; skips where they are absent."""
    if not VECTORS.exists():
        pytest.skip(f"needs {VECTORS}")
    found: list[dict[str, Any]] = json.loads(VECTORS.read_text())["vectors"]
    return found


def bitwise_crc(data: bytes) -> int:
    """The manual's CRC, one bit at a time: x^16 + x^15 + x^2 + 1, most significant bit first."""
    register = 0
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x8005 if register & 0x8000 else 0)) & 0xFFFF
    return register


def judge(data: bytes) -> list[tuple[int, int, Packet]]:
    """Start, end and content of all packets in ``data``: the one complete first, then onwards."""
    claims: list[tuple[int, int]] = []
    start = data.find(HEADER)
    while start >= 0:
        length = int.from_bytes(data[start + 5 : start + 7], "little")
        claims.append((start + 7 + length, start))
        start = data.find(HEADER, start + 1)
    accepted: list[tuple[int, int, Packet]] = []
    settled = 0
    for end, start in sorted(claims):
        if start < settled or end > len(data):
            continue
        try:
            accepted.append((start, end, decode(data[start:end])))
        except PacketError:
            continue
        settled = end
    return accepted


def assert_tiles(segments: list[Segment], data: bytes, *, runs: bool = True) -> None:
    """No byte is lost or counted twice, and each segment is what its kind says.

    ``runs``: whether zeros and other bytes outside packets are segments of their own.
    """
    end = 0
    for segment in segments:
        assert segment.start == end
        assert segment.end > segment.start
        end = segment.end
        piece = data[segment.start : segment.end]
        if segment.kind is Kind.PACKET:
            assert segment.packet == decode(piece)
        elif segment.kind is Kind.ZEROS:
            assert not any(piece)
        elif segment.kind is Kind.STRAY:
            assert all(piece) if runs else any(piece)
        else:
            assert piece.startswith(HEADER)
            assert HEADER not in piece[1:]
        if segment.damage is not None:
            assert segment.start < segment.damage <= segment.end
    assert end == len(data)
