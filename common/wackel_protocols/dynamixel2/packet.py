"""Packets of Dynamixel Protocol 2.0: their types, their bytes, one builder for each instruction.

On the wire: ``FF FF FD 00 | ID | LEN (2) | instruction | [error] | parameters | CRC (2)``, numbers
little-endian, LEN counting everything after itself. LEN and CRC are made after stuffing. Source:
ROBOTIS e-manual, Protocol 2.0, "Instruction Packet", "Status Packet", "Instruction Details".
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum

from fastcrc.crc16 import umts

from wackel_protocols.dynamixel2.stuffing import stuff, unstuff

HEADER = b"\xff\xff\xfd\x00"
BROADCAST_ID = 0xFE
MAX_ID = 252
MAX_LEN = 0xFFFF
PREFIX_BYTES = 7
"""Header, id and LEN: what stands before the bytes that LEN counts."""
STATUS_BYTES = 11
"""A status packet without parameters."""
ALERT = 0x80
"""Bit of the error byte: Hardware Error Status is not zero."""


class Instruction(IntEnum):
    """What a packet asks for; :attr:`STATUS` marks an answer."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class FactoryReset(IntEnum):
    """What a factory reset spares."""

    ALL = 0xFF
    EXCEPT_ID = 0x01
    EXCEPT_ID_AND_BAUD_RATE = 0x02


class Backup(IntEnum):
    """Direction of a control table backup."""

    STORE = 0x01
    RESTORE = 0x02


_STATUS = int(Instruction.STATUS)  # compares much faster than the enumeration
_CLEAR_REVOLUTIONS = b"\x01\x44\x58\x4c\x22"
_BACKUP_KEY = b"\x43\x54\x52\x4c"


class PacketError(ValueError):
    """Bytes that are no packet, or values that fit into none.

    Attributes:
        actual: What was found.
        expected: What should have been there.
    """

    part = "packet"

    def __init__(self, actual: object, expected: object) -> None:
        super().__init__(f"{self.part} is {actual!r}, expected {expected!r}")
        self.actual = actual
        self.expected = expected


class HeaderError(PacketError):
    """The bytes do not begin with FF FF FD 00."""

    part = "header"


class IdError(PacketError):
    """An id that no device can have."""

    part = "id"


class InstructionError(PacketError):
    """An instruction byte that cannot stand in this kind of packet."""

    part = "instruction"


class LengthError(PacketError):
    """More or fewer bytes than the length says or allows."""

    part = "length"


class CrcError(PacketError):
    """The CRC does not fit the bytes before it."""

    part = "CRC"


@dataclass(frozen=True, slots=True)
class InstructionPacket:
    """A packet from the host.

    Attributes:
        id: The servo, or :data:`BROADCAST_ID`.
        instruction: An :class:`Instruction`, or the number of one unknown here.
        parameters: Unstuffed.
    """

    id: int
    instruction: int
    parameters: bytes = b""

    def encode(self) -> bytes:
        """The bytes on the wire. Raises :class:`PacketError` for values that fit into none."""
        if self.instruction == Instruction.STATUS or not 0 <= self.instruction <= 0xFF:
            raise InstructionError(self.instruction, "0 … 255 except 85 (status)")
        return _frame(self.id, stuff(bytes((self.instruction,)) + self.parameters))


@dataclass(frozen=True, slots=True)
class StatusPacket:
    """A packet from a servo; one with :data:`BROADCAST_ID` is a fast answer of several servos.

    Attributes:
        id: The servo that answers.
        error: The error byte: bit 7 alert, bits 0 … 6 error number.
        parameters: Unstuffed. Of a fast answer everything after the first error byte but the last
            CRC, as it came: these answers are never stuffed.
    """

    id: int
    error: int = 0
    parameters: bytes = b""

    @property
    def alert(self) -> bool:
        """Whether Hardware Error Status is not zero."""
        return bool(self.error & ALERT)

    @property
    def error_number(self) -> int:
        """Why the instruction failed, 0 if it did not (see :mod:`.errors`)."""
        return self.error & ~ALERT

    def encode(self) -> bytes:
        """The bytes on the wire. Raises :class:`PacketError` for values that fit into none."""
        body = bytes((Instruction.STATUS, self.error)) + self.parameters
        return _frame(self.id, body if self.id == BROADCAST_ID else stuff(body))


Packet = InstructionPacket | StatusPacket


def crc(data: bytes | bytearray | memoryview) -> int:
    """CRC-16/UMTS over header through parameters as they are on the wire."""
    return umts(data)


def is_id(value: int) -> bool:
    """Whether a packet can carry this id; 253 and 255 are kept free for the header."""
    return 0 <= value <= MAX_ID or value == BROADCAST_ID


def decode(data: bytes) -> Packet:
    """Exactly one packet. Raises a :class:`PacketError` that says what was expected."""
    if data[:4] != HEADER:
        raise HeaderError(data[:4], HEADER)
    if len(data) < PREFIX_BYTES + 3:
        raise LengthError(len(data), "at least 10 bytes")
    if not is_id(data[4]):
        raise IdError(data[4], "0 … 252 or 254")
    length = int.from_bytes(data[5:7], "little")
    least = 4 if data[7] == Instruction.STATUS else 3
    if length < least:
        raise LengthError(length, f"at least {least}")
    if len(data) != PREFIX_BYTES + length:
        raise LengthError(len(data), PREFIX_BYTES + length)
    actual, expected = int.from_bytes(data[-2:], "little"), crc(data[:-2])
    if actual != expected:
        raise CrcError(actual, expected)
    return content(data)


def content(frame: bytes) -> Packet:
    """What a frame says whose header, id, length and CRC have been found right."""
    servo_id, body = frame[4], frame[7:-2]
    if body[0] != _STATUS:
        return InstructionPacket(servo_id, body[0], unstuff(body)[1:])
    if servo_id != BROADCAST_ID:
        # Together with the error byte: FF there may be the first of a stuffed FF FF FD.
        body = unstuff(body)
    return StatusPacket(servo_id, body[1], body[2:])


def _frame(servo_id: int, body: bytes) -> bytes:
    if not is_id(servo_id):
        raise IdError(servo_id, "0 … 252 or 254")
    if len(body) + 2 > MAX_LEN:
        raise LengthError(len(body) + 2, f"at most {MAX_LEN}")
    head = HEADER + bytes((servo_id,)) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc(head).to_bytes(2, "little")


def _word(value: int) -> bytes:
    if not 0 <= value <= 0xFFFF:
        raise LengthError(value, "0 … 65535")
    return value.to_bytes(2, "little")


def _ids(ids: Iterable[int]) -> bytes:
    listed = list(ids)
    for servo_id in listed:
        if not 0 <= servo_id <= MAX_ID:
            raise IdError(servo_id, "0 … 252")
    if len(set(listed)) != len(listed):
        raise IdError(listed, "each id once")
    return bytes(listed)


def ping(servo_id: int) -> bytes:
    """Who is there; to :data:`BROADCAST_ID` every servo answers in its own time slot."""
    return InstructionPacket(servo_id, Instruction.PING).encode()


def read(servo_id: int, address: int, length: int) -> bytes:
    """Read ``length`` bytes of the control table."""
    return InstructionPacket(servo_id, Instruction.READ, _word(address) + _word(length)).encode()


def write(servo_id: int, address: int, data: bytes) -> bytes:
    """Write to the control table at once."""
    return InstructionPacket(servo_id, Instruction.WRITE, _word(address) + data).encode()


def reg_write(servo_id: int, address: int, data: bytes) -> bytes:
    """Keep a write until :func:`action`."""
    return InstructionPacket(servo_id, Instruction.REG_WRITE, _word(address) + data).encode()


def action(servo_id: int) -> bytes:
    """Run what :func:`reg_write` kept."""
    return InstructionPacket(servo_id, Instruction.ACTION).encode()


def factory_reset(servo_id: int, option: int = FactoryReset.EXCEPT_ID_AND_BAUD_RATE) -> bytes:
    """Set the control table to its initial values; ``option`` is a :class:`FactoryReset`."""
    return InstructionPacket(servo_id, Instruction.FACTORY_RESET, bytes((option,))).encode()


def reboot(servo_id: int) -> bytes:
    """Restart the servo; the only way out of a latched hardware error."""
    return InstructionPacket(servo_id, Instruction.REBOOT).encode()


def clear(servo_id: int) -> bytes:
    """Drop the whole revolutions from Present Position, the only thing this clears."""
    return InstructionPacket(servo_id, Instruction.CLEAR, _CLEAR_REVOLUTIONS).encode()


def control_table_backup(servo_id: int, option: int = Backup.STORE) -> bytes:
    """Store the control table in the servo, or restore it; ``option`` is a :class:`Backup`."""
    parameters = bytes((option,)) + _BACKUP_KEY
    return InstructionPacket(servo_id, Instruction.CONTROL_TABLE_BACKUP, parameters).encode()


def sync_read(ids: Iterable[int], address: int, length: int) -> bytes:
    """Read the same registers of several servos; they answer in the order of ``ids``."""
    parameters = _word(address) + _word(length) + _ids(ids)
    return InstructionPacket(BROADCAST_ID, Instruction.SYNC_READ, parameters).encode()


def fast_sync_read(ids: Iterable[int], address: int, length: int) -> bytes:
    """As :func:`sync_read`, but all of them answer in one packet (see :mod:`.fast`)."""
    parameters = _word(address) + _word(length) + _ids(ids)
    return InstructionPacket(BROADCAST_ID, Instruction.FAST_SYNC_READ, parameters).encode()


def sync_write(address: int, length: int, values: Mapping[int, bytes]) -> bytes:
    """Write the same registers of several servos; ``values`` are ``length`` bytes for each id."""
    parameters = _word(address) + _word(length)
    for servo_id, data in zip(_ids(values), values.values(), strict=True):
        if len(data) != length:
            raise LengthError(len(data), length)
        parameters += bytes((servo_id,)) + data
    return InstructionPacket(BROADCAST_ID, Instruction.SYNC_WRITE, parameters).encode()


def bulk_read(requests: Iterable[tuple[int, int, int]]) -> bytes:
    """Read (id, address, length) of several servos; they answer in this order."""
    return InstructionPacket(BROADCAST_ID, Instruction.BULK_READ, _bulk(requests)).encode()


def fast_bulk_read(requests: Iterable[tuple[int, int, int]]) -> bytes:
    """As :func:`bulk_read`, but all of them answer in one packet (see :mod:`.fast`)."""
    return InstructionPacket(BROADCAST_ID, Instruction.FAST_BULK_READ, _bulk(requests)).encode()


def bulk_write(requests: Iterable[tuple[int, int, bytes]]) -> bytes:
    """Write (id, address, data) to several servos."""
    listed = list(requests)
    ids = _ids(servo_id for servo_id, _, _ in listed)
    parameters = b"".join(
        bytes((servo_id,)) + _word(address) + _word(len(data)) + data
        for servo_id, (_, address, data) in zip(ids, listed, strict=True)
    )
    return InstructionPacket(BROADCAST_ID, Instruction.BULK_WRITE, parameters).encode()


def _bulk(requests: Iterable[tuple[int, int, int]]) -> bytes:
    listed = list(requests)
    ids = _ids(servo_id for servo_id, _, _ in listed)
    return b"".join(
        bytes((servo_id,)) + _word(address) + _word(length)
        for servo_id, (_, address, length) in zip(ids, listed, strict=True)
    )
