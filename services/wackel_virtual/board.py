"""A board on the bus that is no servo: gyros in its control table, as on an OpenCR.

It hangs directly at the adapter and has a supply of its own, so no cable fault concerns it.
"""

from collections.abc import Mapping
from struct import Struct

from wackel_node.config_drive import GyroConfig
from wackel_protocols.dynamixel2.packet import Instruction, InstructionPacket
from wackel_virtual.table import ACCESS, DATA_LENGTH, INSTRUCTION_ERROR

_LAYOUTS = {"int16": Struct("<h"), "int32": Struct("<i"), "float32": Struct("<f")}
_MOST = {"int16": 2**15 - 1, "int32": 2**31 - 1}
_IDENTITY = bytes((0x00, 0x74, 24))
"""Model number and firmware of a board of no known make."""


class Board:
    """One board.

    Args:
        gyros: Their sections, by name.

    Attributes:
        rates: What each gyro measures now, about its own axes, rad/s.
        silent: Whether it does not answer.
    """

    def __init__(self, gyros: Mapping[str, GyroConfig]) -> None:
        self.rates = dict.fromkeys(gyros, (0.0, 0.0, 0.0))
        self.silent = False
        self._gyros = gyros
        self._size = max(r.end for gyro in gyros.values() for r in gyro.registers.values())

    def execute(self, packet: InstructionPacket) -> tuple[int, bytes]:
        """Error byte and parameters of the answer to an instruction."""
        parameters = packet.parameters
        if packet.instruction == Instruction.PING:
            return 0, _IDENTITY
        if packet.instruction == Instruction.WRITE:
            return ACCESS, b""
        if packet.instruction != Instruction.READ:
            return INSTRUCTION_ERROR, b""
        if len(parameters) != 4:
            return DATA_LENGTH, b""
        start = int.from_bytes(parameters[:2], "little")
        end = start + int.from_bytes(parameters[2:], "little")
        return (0, self._table()[start:end]) if end <= self._size else (ACCESS, b"")

    def _table(self) -> bytes:
        table = bytearray(self._size)
        for name, gyro in self._gyros.items():
            for axis, register in gyro.registers.items():
                value: float = self.rates[name]["xyz".index(axis)] / register.factor
                if register.encoding != "float32":
                    most = _MOST[register.encoding]
                    value = min(max(round(value), -most), most)
                _LAYOUTS[register.encoding].pack_into(table, register.address, value)
        return bytes(table)


def boards(gyros: Mapping[str, GyroConfig], bus: str) -> dict[int, Board]:
    """The boards of a bus, by id."""
    by_id: dict[int, dict[str, GyroConfig]] = {}
    for name, gyro in gyros.items():
        if gyro.source == "bus" and gyro.bus == bus and gyro.id is not None:
            by_id.setdefault(gyro.id, {})[name] = gyro
    return {board_id: Board(on_it) for board_id, on_it in by_id.items()}
