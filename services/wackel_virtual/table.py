"""The control table of one servo: its bytes, and what may be written where.

Source: ROBOTIS e-manual, Protocol 2.0, "Error", and the control tables of the X series. Values are
raw unless a name has a unit.
"""

from collections.abc import Sequence

from wackel_protocols.dynamixel2.control_table import Model, Register
from wackel_protocols.dynamixel2.tables import Series
from wackel_virtual.indirect import IndirectArea, indirect_areas

RESULT_FAIL, INSTRUCTION_ERROR, CRC_ERROR, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = range(1, 8)
"""Error numbers of the status packet."""

CURRENT, VELOCITY, POSITION, PWM = 0, 1, 3, 16
"""Operating modes whose goals differ; 4 (extended) and 5 (current-based) are positions, too."""
_MODES = frozenset((CURRENT, VELOCITY, POSITION, 4, 5, PWM))

_USUAL = {"min_voltage_limit": 0, "max_voltage_limit": 400, "shutdown": 52}
"""Initial values for models whose own are not in the tables: voltages that never alert."""


class ControlTable:
    """The bytes of a control table, addressed by address or by a register's name."""

    def __init__(self, model: Model) -> None:
        self.registers = model.registers
        self.is_x_like = model.series is not Series.XL320
        """Whether operating modes and goals are those of the X series."""
        self._by_address = {register.address: register for register in self.registers.values()}
        self._areas = indirect_areas(model.series)
        ends = [register.address + register.length for register in self.registers.values()]
        self.size = max(ends + [area.end for area in self._areas])
        self._bytes = bytearray(self.size)
        self._error_address = self.registers["hardware_error_status"].address
        watchdog = self.registers.get("bus_watchdog")
        self._watchdog_address = None if watchdog is None else watchdog.address

    # By name.

    def get(self, name: str) -> int:
        """Value of a register."""
        register = self.registers[name]
        address = register.address
        return register.decode(bytes(self._bytes[address : address + register.length]))

    def put(self, name: str, raw: int) -> None:
        """Set a register, whatever its access and limits are."""
        self.store(self.registers[name], raw)

    def store(self, register: Register, raw: int) -> None:
        """As :meth:`put`, for a register at hand."""
        address = register.address
        self._bytes[address : address + register.length] = register.encode(raw)

    def has(self, name: str) -> bool:
        """Whether the model has the register."""
        return name in self.registers

    @property
    def hardware_errors(self) -> int:
        """Hardware Error Status."""
        return self._bytes[self._error_address]

    @property
    def watchdog(self) -> int:
        """Bus Watchdog, 20 ms units; 0 without one, -1 once it has bitten."""
        if self._watchdog_address is None:
            return 0
        value = self._bytes[self._watchdog_address]
        return -1 if value > 127 else value

    @property
    def mode(self) -> int:
        """Operating mode in the numbers of the X series."""
        mode = self.get("operating_mode")
        if self.is_x_like:
            return mode
        return VELOCITY if mode == 1 else POSITION  # XL-320: 1 wheel, 2 joint

    # By address.

    def areas(self, address: int, length: int) -> list[IndirectArea]:
        """The indirect areas of which these bytes contain data."""
        return [area for area in self._areas if area.overlaps(address, address + length)]

    def read(self, address: int, length: int, areas: Sequence[IndirectArea]) -> bytes:
        """Bytes of the table, with those of the indirect areas resolved."""
        data = bytes(self._bytes[address : address + length])
        for area in areas:
            data = area.read(self._bytes, address, data)
        return data

    def targets(self, address: int, data: bytes) -> list[tuple[int, bytes]]:
        """Where bytes written to an address really go."""
        for area in self._areas:
            if area.holds_data(address):
                return area.resolve(self._bytes, address, data)
        return [(address, data)]

    def check(self, address: int, data: bytes) -> int:
        """The number of the error that writing would meet, 0 for none."""
        for area in self._areas:
            if area.holds_addresses(address, len(data)) or area.holds_data(address):
                return 0
        while data:
            register = self._by_address.get(address)
            if register is None or register.access == "r":
                return ACCESS
            if register.area == "eeprom" and self.get("torque_enable"):
                return ACCESS
            if len(data) < register.length:
                return DATA_LENGTH
            error = self._check_value(register, register.decode(data[: register.length]))
            if error:
                return error
            address += register.length
            data = data[register.length :]
        return 0

    def write(self, address: int, data: bytes) -> list[str]:
        """Write bytes that have been checked; returns the names of the registers concerned."""
        end = address + len(data)
        self._bytes[address:end] = data
        written = []
        while address < end:
            register = self._by_address.get(address)
            if register is None:
                break  # indirect registers have no effect of their own
            written.append(register.name)
            address += register.length
        return written

    # As a whole.

    def reset_eeprom(self) -> None:
        """Factory settings."""
        self._reset("eeprom")

    def reset_ram(self) -> None:
        """As after power-up."""
        self._reset("ram")
        for area in self._areas:
            area.reset(self._bytes)
        self.reset_goals()

    def reset_goals(self) -> None:
        """Goals that limit others are at their limit, goals that move something at zero."""
        for name, mode in (("pwm", PWM), ("current", CURRENT)):
            if self.has(f"goal_{name}"):
                limit = self.get(f"{name}_limit")
                self.put(f"goal_{name}", 0 if self.mode == mode else limit)
        self.put("goal_velocity", 0)

    def image(self) -> bytes:
        """All bytes."""
        return bytes(self._bytes)

    def restore(self, image: bytes) -> None:
        """Set all bytes."""
        self._bytes[:] = image

    def _reset(self, area: str) -> None:
        for register in self.registers.values():
            if register.area == area:
                initial = register.initial
                self.store(register, _USUAL.get(register.name, 0) if initial is None else initial)

    def _check_value(self, register: Register, raw: int) -> int:
        low, high = register.bounds
        if not low <= raw <= high:
            return DATA_RANGE
        name = register.name
        if name == "operating_mode" and self.is_x_like and raw not in _MODES:
            return DATA_RANGE
        if not name.startswith("goal_"):
            return 0
        if self.watchdog < 0:
            return DATA_RANGE
        limit = name.removeprefix("goal_") + "_limit"
        if self.has(limit) and abs(raw) > self.get(limit) > 0:
            return DATA_LIMIT
        if name == "goal_position" and self.mode == POSITION:
            low, high = self.get("min_position_limit"), self.get("max_position_limit")
            if low < high and not low <= raw <= high:
                return DATA_LIMIT
        return 0
