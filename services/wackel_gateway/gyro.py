"""A gyro in the registers of a device on the bus, such as an OpenCR: what to read, what it says."""

import math
from struct import Struct

from wackel_gateway.commands import Refused
from wackel_gateway.roster import Block
from wackel_node.config_drive import GyroConfig, GyroRegister
from wackel_schemas.drive import ImuSample

_LAYOUTS = {"int16": Struct("<h"), "int32": Struct("<i"), "float32": Struct("<f")}


class BusGyro:
    """One gyro.

    Args:
        config: Its section; of source bus, and checked.

    Attributes:
        id: Of the device.
        block: What holds all its registers.
    """

    def __init__(self, config: GyroConfig) -> None:
        if config.id is None:
            raise ValueError("a gyro on a bus has an id")
        registers = config.registers.values()
        start = min(register.address for register in registers)
        self.id = config.id
        self.block = Block(start, max(register.end for register in registers) - start)
        self._axes = [config.registers.get(axis) for axis in ("x", "y", "z")]

    def sample(self, data: bytes, stamp: int, late_s: float) -> ImuSample:
        """What an answer says.

        Args:
            data: Its parameters.
            stamp: UTC ns, of when the device read its registers.
            late_s: How much later than usual it came.

        Raises:
            Refused: It does not hold what was asked for, or no numbers.
        """
        if len(data) != self.block.length:
            raise Refused("gyro refuses", f"{len(data)} bytes instead of {self.block.length}")
        x, y, z = (self._rate(register, data) for register in self._axes)
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            raise Refused("gyro sends no number", f"{x}, {y}, {z}")
        return ImuSample(stamp=stamp, angular_velocity=(x, y, z), late_s=late_s)

    def _rate(self, register: GyroRegister | None, data: bytes) -> float:
        if register is None:
            return 0.0
        (raw,) = _LAYOUTS[register.encoding].unpack_from(
            data, register.address - self.block.address
        )
        return float(raw) * register.factor
