"""Status packets to SI units.

Which registers an answer holds follows from the instruction (address and length) and the servo's
model, so reads of any master are decoded, not only our own. Plans are made once per instruction.
"""

from collections.abc import Callable, Sequence
from struct import calcsize
from typing import NamedTuple

from wackel_gateway.roster import Roster
from wackel_protocols.dynamixel2.answers import AnswerReader, Answers, Status, reader
from wackel_protocols.dynamixel2.control_table import Model, Register
from wackel_protocols.dynamixel2.packet import (
    ALERT,
    Instruction,
    InstructionPacket,
    PacketError,
    decode,
)
from wackel_schemas.bus import ServoState

_FIELDS = {
    "position": "present_position",
    "velocity": "present_velocity",
    "current": "present_current",
    "load": "present_load",
    "pwm": "present_pwm",
    "voltage": "present_input_voltage",
    "temperature": "present_temperature",
}
_UNITS = {"current": "A"}  # of a model whose scale is unknown the raw value would be a lie
_MAX_PLANS = 512  # a master that never asks the same twice shall not fill the memory
_ROW = 2  # servos from which on decoding them together pays
_SINGLE_READ = Instruction.READ
_SYNC_READS = (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ)
_BULK_READS = (Instruction.BULK_READ, Instruction.FAST_BULK_READ)

Plan = Callable[[Status], ServoState]


class Row(NamedTuple):
    """How to decode healthy answers of servos of one model all at once.

    Attributes:
        reader: Whose layout they have.
        decode: From the bytes; no error byte may be set.
    """

    reader: AnswerReader
    decode: Callable[[bytes], list[ServoState]]


class Decoder:
    """Decodes the answers of one bus; ``roster`` knows the models."""

    def __init__(self, roster: Roster) -> None:
        self._roster = roster
        self._plans: dict[bytes, tuple[dict[int, Plan], Row | None]] = {}

    def states(self, instruction: bytes, answers: Answers) -> list[ServoState]:
        """What the answers to a read say; empty for any other instruction."""
        found = self._plans.get(instruction)
        if found is None:
            if len(self._plans) >= _MAX_PLANS:
                self._plans.clear()
            found = self._plans[instruction] = self._plan(instruction)
        plans, row = found
        if row is not None and answers.reader is row.reader and not answers.has_errors:
            return row.decode(answers.healthy)
        return [plans[status.id](status) for status in answers.statuses if status.id in plans]

    def _plan(self, instruction: bytes) -> tuple[dict[int, Plan], Row | None]:
        """How to decode each servo's answer, and all of them at once if they are of one model."""
        blocks = blocks_read(instruction)
        tables = {servo_id: self._roster.model(servo_id) for servo_id, _, _ in blocks}
        plans = {
            servo_id: plan(table, address, length)
            for servo_id, address, length in blocks
            if (table := tables[servo_id]) is not None
        }
        first = next(iter(tables.values()), None)
        alike = first is not None and all(table is first for table in tables.values())
        same_block = len({(address, length) for _, address, length in blocks}) == 1
        if first is None or not alike or not same_block or len(plans) < _ROW:
            return plans, None
        return plans, row(first, instruction, *blocks[0][1:])

    def forget(self) -> None:
        """Plans anew: a servo turned out to be another model."""
        self._plans.clear()


def blocks_read(instruction: bytes) -> list[tuple[int, int, int]]:
    """(id, address, length) of every block that an instruction reads; empty if it reads none."""
    try:
        packet = decode(instruction)
    except PacketError:
        return []
    if not isinstance(packet, InstructionPacket):
        return []
    parameters = packet.parameters
    if packet.instruction in _BULK_READS:
        triples = (parameters[i : i + 5] for i in range(0, len(parameters) - 4, 5))
        return [(part[0], _word(part[1:3]), _word(part[3:5])) for part in triples]
    if packet.instruction == _SINGLE_READ and len(parameters) == 4:
        ids: Sequence[int] = (packet.id,)
    elif packet.instruction in _SYNC_READS and len(parameters) > 4:
        ids = parameters[4:]
    else:
        return []
    address, length = _word(parameters[:2]), _word(parameters[2:4])
    return [(servo_id, address, length) for servo_id in ids]


def plan(table: Model, address: int, length: int) -> Plan:
    """How to decode ``length`` bytes read at ``address`` of a model."""
    end = address + length

    def within(name: str) -> Register | None:
        register = table.registers.get(name)
        inside = register is not None and (
            address <= register.address and register.address + register.length <= end
        )
        return register if inside else None

    fields = {
        field: register
        for field, name in _FIELDS.items()
        if (register := within(name)) is not None
        and register.unit == _UNITS.get(field, register.unit)
    }
    torque, hardware = within("torque_enable"), within("hardware_error_status")

    def decode_any(status: Status) -> ServoState:
        data = status.parameters
        error = status.error
        state = ServoState(id=status.id, alert=error >= ALERT, error=error & ~ALERT)
        if len(data) != length:  # refused: an answer with an error number carries no data
            return state
        for field, register in fields.items():
            setattr(state, field, register.to_si(_raw(register, data, address)))
        if torque is not None:
            state.torque_enabled = _raw(torque, data, address) != 0
        if hardware is not None:
            state.hardware_error = _raw(hardware, data, address)
        return state

    return decode_any


def row(table: Model, instruction: bytes, address: int, length: int) -> Row | None:
    """A short cut for what every cycle reads: current, velocity and position in a row.

    Args:
        table: The model of all servos.
        instruction: What reads them.
        address: Of the block.
        length: Of the block.
    """
    names = ("present_current", "present_velocity", "present_position")
    registers = [table.registers[name] for name in names if name in table.registers]
    # X, MX and P have them in this order, without a gap, in two's complement.
    fields = "hii"
    starts = [register.address for register in registers]
    if starts != [address, address + 2, address + 6] or length != calcsize(f"<{fields}"):
        return None
    current, velocity, position = registers
    if current.unit != _UNITS["current"]:
        return None
    answers = reader(instruction)
    ids, unpack = answers.expectation.ids, answers.unpacker(fields)
    current_scale, velocity_scale = current.scale, velocity.scale
    position_scale, centre = position.scale, position.zero

    def decode_row(data: bytes) -> list[ServoState]:
        values = iter(unpack(data))
        return [
            ServoState(
                id=servo_id,
                position=(raw_position - centre) * position_scale,
                velocity=raw_velocity * velocity_scale,
                current=raw_current * current_scale,
            )
            for servo_id, raw_current, raw_velocity, raw_position in zip(
                ids, values, values, values, strict=True
            )
        ]

    return Row(answers, decode_row)


def _raw(register: Register, data: bytes, address: int) -> int:
    start = register.address - address
    return register.decode(data[start : start + register.length])


def _word(data: bytes) -> int:
    return int.from_bytes(data, "little")
