"""One servo: its control table, the instructions it obeys, its errors, its restart.

Source, unless named otherwise: ROBOTIS e-manual, Protocol 2.0, "Instruction Details" and "Error",
and the control tables of the X series. Times are ns and come as arguments.
"""

from collections.abc import Callable
from random import Random

from wackel_node.config import ConfigError, ServoConfig
from wackel_protocols.dynamixel2.control_table import (
    Model,
    Register,
    UnknownModel,
    baud_rate,
    baud_rate_register,
    generic,
    model,
)
from wackel_protocols.dynamixel2.packet import (
    ALERT,
    BROADCAST_ID,
    Backup,
    FactoryReset,
    Instruction,
    InstructionPacket,
    clear,
    control_table_backup,
)
from wackel_protocols.dynamixel2.tables import Series
from wackel_virtual.indirect import IndirectArea, indirect_areas
from wackel_virtual.motion import STANDBY_A, Motion

RESULT_FAIL, INSTRUCTION_ERROR, CRC_ERROR, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = range(1, 8)
"""Error numbers of the status packet."""

BOOT_NS = 400_000_000
"""From power or reboot until the servo answers; an assumption, the manual gives no figure."""
HOLD_UP_NS = 20_000_000
"""How long the capacitors of a servo keep its processor running without supply; an assumption."""
INPUT_VOLTAGE = 1 << 0
"""Bit of Hardware Error Status; so are those in :data:`_XL320_BITS`."""
FIRMWARE = 50
"""Newer than the first that knows fast reads, in every series."""

_XL320_BITS = {0: 2, 2: 1, 5: 0}
"""Bits of Hardware Error Status of the X series that the XL-320 has elsewhere."""
_RECOMMENDED_VOLTS = {
    Series.X: 12.0,
    Series.X330: 5.0,
    Series.MX: 12.0,
    Series.P: 24.0,
    Series.XL320: 7.4,
}
_USUAL_VELOCITY = 6.0
"""rad/s, some 57 rev/min, for models whose limit is not in the tables."""
_USUAL_LIMITS = {"min_voltage_limit": 0, "max_voltage_limit": 400, "shutdown": 52}
"""Raw initial values for models whose own are not in the tables: voltages that never alert."""
_UNKNOWN_CURRENT_UNIT = 1e-3
"""A, for models whose own is not in the tables."""

_MODES = frozenset((0, 1, 3, 4, 5, 16))
_CURRENT, _VELOCITY, _POSITION, _PWM = 0, 1, 3, 16

_Measured = list[tuple[Register, Callable[[int], int]]]
_Plan = tuple[_Measured, list[IndirectArea]]
"""What a read needs: registers to measure, and indirect areas to resolve."""


class Servo:
    """A servo at one place of the chain.

    Args:
        config: Id and model.
        random: Source of its measurement noise and of its load.
        baud_rate: At which it listens when new.
        return_delay_us: Return Delay Time; absent: as from the factory, 500 µs.
        firmware: Version; absent: one that knows everything.

    Attributes:
        id, baud_rate, return_delay_ns, status_return_level: As the registers say.
        knows_fast_read: Whether the firmware knows fast sync and bulk read.
        deaf_until_ns: It is starting until then.
        recommended_volts: Supply that it is made for.

    Raises:
        ConfigError: Unknown model, or a baud rate that the model does not have.
    """

    def __init__(
        self,
        config: ServoConfig,
        random: Random,
        *,
        baud_rate: int,
        return_delay_us: int | None = None,
        firmware: int | None = None,
    ) -> None:
        self._model = _model_of(config)
        self._random = random
        self._registers = self._model.registers
        self._firmware = FIRMWARE if firmware is None else firmware
        first_fast = self._model.fast_sync_read_firmware
        self.knows_fast_read = first_fast is not None and self._firmware >= first_fast
        self._by_address = {register.address: register for register in self._registers.values()}
        self._indirect = indirect_areas(self._model.series)
        ends = [register.address + register.length for register in self._registers.values()]
        ends += [area.end for area in self._indirect]
        self._table = bytearray(max(ends))
        self._is_x = self._model.series is not Series.XL320
        self._error_address = self._registers["hardware_error_status"].address
        watchdog = self._registers.get("bus_watchdog")
        self._watchdog_address = 0 if watchdog is None else watchdog.address
        self._least_position, self._greatest_position = self._registers["present_position"].bounds
        self._mode = _POSITION
        self._locked = False  # torque stays off until a restart
        self._backup: bytes | None = None
        self._registered: tuple[int, bytes] | None = None
        self._spoiled_delay: int | None = None
        self._stuck = False
        self._cause = 0  # hardware errors that come back after a restart
        self._heard_ns = 0
        self._volts = 0.0
        self.deaf_until_ns = 0
        self._motion = Motion(
            position=random.uniform(-0.5, 0.5),
            load=random.uniform(-0.2, 0.2),
            limit=_USUAL_VELOCITY,
        )
        self._measured = self._measurements()
        self._plans: dict[tuple[int, int], _Plan] = {}
        self._reset_eeprom()
        self._put("id", config.id)
        self._put("baud_rate", _baud_rate_value(baud_rate, self._registers["baud_rate"], config))
        if return_delay_us is not None:
            self._put("return_delay_time", return_delay_us // 2)
        low, high = self._get("min_voltage_limit") / 10, self._get("max_voltage_limit") / 10
        usual = _RECOMMENDED_VOLTS[self._model.series]
        self.recommended_volts = usual if low <= usual <= high else (low + high) / 2
        self._volts = self.recommended_volts
        self._reset_ram(0)

    # What the bus asks.

    def execute(self, packet: InstructionPacket, at_ns: int) -> tuple[int, bytes] | None:
        """Obey an instruction for one servo.

        Returns:
            Error byte and parameters of the answer; None if Status Return Level wants none.
        """
        level = self.status_return_level
        parameters = packet.parameters
        match packet.instruction:
            case Instruction.PING:
                number = self._model.number.to_bytes(2, "little")
                return self._alert(), number + bytes((self._firmware,))
            case Instruction.READ:
                if len(parameters) != 4:
                    return (DATA_LENGTH | self._alert(), b"") if level >= 1 else None
                address = parameters[0] | parameters[1] << 8
                answer = self.read(address, parameters[2] | parameters[3] << 8, at_ns)
                return answer if level >= 1 else None
            case Instruction.WRITE:
                error = self._write_parameters(parameters, at_ns)
            case Instruction.REG_WRITE:
                error = self._register(parameters)
            case Instruction.ACTION:
                error = self._act(at_ns)
            case Instruction.FACTORY_RESET:
                error = self._factory_reset(packet, at_ns)
            case Instruction.REBOOT:
                alert = self._alert()
                self._restart(at_ns)
                return (alert, b"") if level >= 2 else None
            case Instruction.CLEAR:
                error = self._clear(packet, at_ns)
            case Instruction.CONTROL_TABLE_BACKUP:
                error = self._back_up(packet, at_ns)
            case _:
                error = INSTRUCTION_ERROR
        return (error | self._alert(), b"") if level >= 2 else None

    def read(self, address: int, length: int, at_ns: int) -> tuple[int, bytes]:
        """Error byte and data of a part of the control table; no data with an error."""
        table = self._table
        if address + length > len(table):
            return ACCESS | self._alert(), b""
        plan = self._plans.get((address, length))
        if plan is None:
            plan = self._plans[address, length] = self._plan(address, length)
        measured, areas = plan
        if not self._stuck:
            for register, measure in measured:
                self._store(register, measure(at_ns))
        data = bytes(table[address : address + length])
        for area in areas:
            data = area.read(table, address, data)
        return self._alert(), data

    def write(self, address: int, data: bytes, at_ns: int) -> int:
        """Write a part of the control table; returns the number of an error, 0 for success."""
        for target, part in self._targets(address, data):
            error = self._check(target, part)
            if error:
                return error
        for target, part in self._targets(address, data):
            self._apply(target, part, at_ns)
        return 0

    def note_instruction(self, at_ns: int) -> None:
        """Any instruction on the bus feeds the watchdog, if it has not bitten yet."""
        self._watch(at_ns)
        self._heard_ns = at_ns

    # What befalls it.

    def power_returns(self, at_ns: int, outage_ns: int) -> None:
        """Supply is back; after a longer outage the servo starts anew."""
        if outage_ns > HOLD_UP_NS:
            self._restart(at_ns)

    def feel_voltage(self, volts: float, at_ns: int) -> None:
        """The input voltage from now on, V; outside its limits it is a hardware error."""
        self._volts = volts
        low, high = self._get("min_voltage_limit"), self._get("max_voltage_limit")
        if not low <= round(volts * 10) <= high:
            self._raise_errors(INPUT_VOLTAGE, at_ns)

    def drawn_amperes(self, at_ns: int) -> float:
        """What it takes from the supply."""
        self._watch(at_ns)
        self._motion.advance(at_ns)
        return STANDBY_A + abs(self._motion.current)

    def suffer(self, hardware_errors: int, at_ns: int) -> None:
        """Causes of hardware errors from now on, bits as in the X series; 0 when they are gone.

        What a cause has raised stays until the servo restarts.
        """
        if hardware_errors != self._cause:
            self._cause = hardware_errors
            self._raise_errors(hardware_errors, at_ns)

    def stick(self, stuck: bool, at_ns: int) -> None:
        """Whether measured values stay as they are at this moment."""
        if stuck and not self._stuck:
            for register, measure in self._measured:
                self._store(register, measure(at_ns))
        self._stuck = stuck

    def misset_return_delay(self, value: int | None) -> None:
        """Set Return Delay Time wrongly; None puts it right unless somebody has written it."""
        if value is not None:
            if self._spoiled_delay is None:
                self._spoiled_delay = self._get("return_delay_time")
            self._put("return_delay_time", value)
        elif self._spoiled_delay is not None:
            self._put("return_delay_time", self._spoiled_delay)
            self._spoiled_delay = None
        self._remember()

    # Control table.

    def _get(self, name: str) -> int:
        register = self._registers[name]
        return register.decode(
            bytes(self._table[register.address : register.address + register.length])
        )

    def _put(self, name: str, raw: int) -> None:
        self._store(self._registers[name], raw)

    def _store(self, register: Register, raw: int) -> None:
        address = register.address
        self._table[address : address + register.length] = register.encode(raw)

    def _plan(self, address: int, length: int) -> _Plan:
        """What a read of these bytes needs."""
        end = address + length
        areas = [area for area in self._indirect if area.overlaps(address, end)]
        # Indirect data may point anywhere.
        measured = [
            (register, measure)
            for register, measure in self._measured
            if areas or (register.address < end and address < register.address + register.length)
        ]
        return measured, areas

    def _targets(self, address: int, data: bytes) -> list[tuple[int, bytes]]:
        """Where bytes written to an address really go."""
        for area in self._indirect:
            if area.holds_data(address):
                return area.resolve(self._table, address, data)
        return [(address, data)]

    def _check(self, address: int, data: bytes) -> int:
        """The error that writing would meet."""
        for area in self._indirect:
            if area.holds_addresses(address, len(data)) or area.holds_data(address):
                return 0
        torque = self._get("torque_enable")
        while data:
            register = self._by_address.get(address)
            if register is None or register.access == "r":
                return ACCESS
            if register.area == "eeprom" and torque:
                return ACCESS
            if len(data) < register.length:
                return DATA_LENGTH
            error = self._check_value(register, register.decode(data[: register.length]))
            if error:
                return error
            address += register.length
            data = data[register.length :]
        return 0

    def _check_value(self, register: Register, raw: int) -> int:
        low, high = register.bounds
        if not low <= raw <= high:
            return DATA_RANGE
        name = register.name
        if name == "operating_mode" and self._is_x and raw not in _MODES:
            return DATA_RANGE
        if not name.startswith("goal_"):
            return 0
        if self._watchdog_address and self._table[self._watchdog_address] >= 128:
            return DATA_RANGE
        limit = self._registers.get(name.removeprefix("goal_") + "_limit")
        if limit is not None and abs(raw) > self._get(limit.name) > 0:
            return DATA_LIMIT
        if name == "goal_position" and self._mode == _POSITION:
            low, high = self._get("min_position_limit"), self._get("max_position_limit")
            if low < high and not low <= raw <= high:
                return DATA_LIMIT
        return 0

    def _apply(self, address: int, data: bytes, at_ns: int) -> None:
        """Write bytes that have been checked, and do what follows from them."""
        self._table[address : address + len(data)] = data
        end = address + len(data)
        while address < end:
            register = self._by_address.get(address)
            if register is None:
                return  # addresses of indirect registers, without any effect of their own
            self._react(register.name, at_ns)
            address += register.length

    def _react(self, name: str, at_ns: int) -> None:
        if name == "torque_enable":
            if self._locked:
                self._put("torque_enable", 0)
            elif self._get("torque_enable"):
                self._hold(at_ns)
        elif name == "bus_watchdog":
            self._heard_ns = at_ns
        elif name == "return_delay_time":
            self._spoiled_delay = None
        elif name == "operating_mode" and self._is_x:
            self._reset_goals()
        if name.startswith(("goal_", "profile_")) or name in ("torque_enable", "operating_mode"):
            self._drive(at_ns)
        else:
            self._remember()

    def _remember(self) -> None:
        """Keep the registers at hand that every instruction needs."""
        self.id = self._get("id")
        self.baud_rate = baud_rate(self._get("baud_rate"))
        self.return_delay_ns = self._get("return_delay_time") * 2_000
        self.status_return_level = self._get("status_return_level")

    def _alert(self) -> int:
        return ALERT if self._table[self._error_address] else 0

    # Instructions.

    def _write_parameters(self, parameters: bytes, at_ns: int) -> int:
        if len(parameters) < 3:
            return DATA_LENGTH
        return self.write(parameters[0] | parameters[1] << 8, parameters[2:], at_ns)

    def _register(self, parameters: bytes) -> int:
        if len(parameters) < 3:
            return DATA_LENGTH
        address = parameters[0] | parameters[1] << 8
        for target, part in self._targets(address, parameters[2:]):
            error = self._check(target, part)
            if error:
                return error
        self._registered = (address, parameters[2:])
        self._put("registered_instruction", 1)
        return 0

    def _act(self, at_ns: int) -> int:
        if self._registered is None:
            return INSTRUCTION_ERROR
        address, data = self._registered
        self._registered = None
        self._put("registered_instruction", 0)
        return self.write(address, data, at_ns)

    def _factory_reset(self, packet: InstructionPacket, at_ns: int) -> int:
        option = packet.parameters[0] if len(packet.parameters) == 1 else None
        if option not in tuple(FactoryReset):
            return DATA_RANGE
        if packet.id == BROADCAST_ID and option == FactoryReset.ALL:
            return RESULT_FAIL  # would leave all servos with the same id
        kept = self._get("id"), self._get("baud_rate")
        self._reset_eeprom()
        if option != FactoryReset.ALL:
            self._put("id", kept[0])
        if option == FactoryReset.EXCEPT_ID_AND_BAUD_RATE:
            self._put("baud_rate", kept[1])
        self._restart(at_ns)
        return 0

    def _clear(self, packet: InstructionPacket, at_ns: int) -> int:
        if packet.encode() != clear(packet.id):
            return DATA_RANGE
        self._motion.advance(at_ns)
        if abs(self._motion.velocity) > self._moving_threshold():
            return RESULT_FAIL
        self._unwind()
        return 0

    def _back_up(self, packet: InstructionPacket, at_ns: int) -> int:
        if self._get("torque_enable"):
            return RESULT_FAIL
        data = packet.encode()
        if data == control_table_backup(packet.id, Backup.STORE):
            self._backup = bytes(self._table)
            return 0
        if data != control_table_backup(packet.id, Backup.RESTORE):
            return DATA_RANGE
        if self._backup is None:
            return RESULT_FAIL
        self._table[:] = self._backup
        self._restart(at_ns)
        return 0

    # Restart and errors.

    def _restart(self, at_ns: int) -> None:
        self.deaf_until_ns = at_ns + BOOT_NS
        self._reset_ram(at_ns)

    def _reset_eeprom(self) -> None:
        for register in self._registers.values():
            if register.area == "eeprom":
                self._store(register, self._initial(register))
        self._put("model_number", self._model.number)
        self._put("firmware_version", self._firmware)

    def _initial(self, register: Register) -> int:
        if register.initial is not None:
            return register.initial
        return _USUAL_LIMITS.get(register.name, 0)

    def _reset_ram(self, at_ns: int) -> None:
        self._registered = None
        self._locked = False
        for register in self._registers.values():
            if register.area == "ram":
                self._store(register, self._initial(register))
        for area in self._indirect:
            area.reset(self._table)
        self._reset_goals()
        self._unwind()
        self._drive(at_ns)
        self._hold(at_ns)
        self._remember()
        self._raise_errors(self._cause, at_ns)

    def _reset_goals(self) -> None:
        """Goals that limit others are at their limit, goals that move something at zero."""
        for name, own_mode in (("pwm", _PWM), ("current", _CURRENT)):
            if f"goal_{name}" in self._registers:
                limit = self._get(f"{name}_limit")
                self._put(f"goal_{name}", 0 if self._get("operating_mode") == own_mode else limit)
        self._put("goal_velocity", 0)

    def _raise_errors(self, bits: int, at_ns: int) -> None:
        if not bits:
            return
        if not self._is_x:
            bits = sum(1 << there for here, there in _XL320_BITS.items() if bits >> here & 1)
        self._table[self._error_address] |= bits
        if bits & self._get("shutdown"):
            self._locked = True
            self._put("torque_enable", 0)
            self._drive(at_ns)

    # Motion.

    def _drive(self, at_ns: int) -> None:
        """Take over the goals of the control table."""
        motion = self._motion
        get, registers = self._get, self._registers
        limit = registers.get("velocity_limit")
        if limit is not None:
            motion.limit = limit.to_si(get("velocity_limit")) or _USUAL_VELOCITY
        self._mode = get("operating_mode")
        if not self._is_x:  # 1 is wheel mode, 2 joint mode
            self._mode = _VELOCITY if self._mode == 1 else _POSITION
        if not get("torque_enable"):
            motion.drive("off", 0.0, 0.0, at_ns)
        elif self._mode == _VELOCITY:
            velocity = registers["goal_velocity"].to_si(get("goal_velocity"))
            motion.drive("velocity", velocity, motion.limit, at_ns)
        elif self._mode in (_CURRENT, _PWM):
            name = "current" if self._mode == _CURRENT else "pwm"
            share = 0.0
            if f"goal_{name}" in registers:
                share = get(f"goal_{name}") / (get(f"{name}_limit") or 1)
            motion.drive("velocity", share * motion.limit, motion.limit, at_ns)
        else:
            goal = registers["goal_position"].to_si(get("goal_position"))
            profile = registers.get("profile_velocity")
            allowed = profile.to_si(get("profile_velocity")) if profile is not None else 0.0
            motion.drive("position", goal, allowed or motion.limit, at_ns)

    def _hold(self, at_ns: int) -> None:
        """Make the present position the goal, as a servo does when it starts or gets torque."""
        self._motion.advance(at_ns)
        self._put("goal_position", self._position())

    def _position(self) -> int:
        register = self._registers["present_position"]
        raw = round(self._motion.position / register.scale) + register.zero
        return min(max(raw, self._least_position), self._greatest_position)

    def _watch(self, at_ns: int) -> None:
        """Let the watchdog stop the shaft if it should have by now."""
        watchdog = self._table[self._watchdog_address] if self._watchdog_address else 0
        if 0 < watchdog < 128:
            bites_ns = self._heard_ns + watchdog * 20_000_000
            if at_ns > bites_ns:
                self._put("bus_watchdog", -1)
                self._motion.drive("velocity", 0.0, self._motion.limit, bites_ns)

    def _unwind(self) -> None:
        """Forget whole revolutions."""
        turn = self._model.resolution * self._registers["present_position"].scale
        half = turn / 2
        self._motion.position = (self._motion.position + half) % turn - half

    def _moving_threshold(self) -> float:
        """rad/s."""
        register = self._registers.get("moving_threshold")
        if register is None:
            return 0.1
        return register.to_si(self._get("moving_threshold"))

    def _measurements(self) -> _Measured:
        """The registers whose values are measured, each with how."""
        motion, random = self._motion, self._random
        registers = self._registers

        def velocity(at_ns: int) -> int:
            motion.advance(at_ns)
            return round(motion.velocity / registers["present_velocity"].scale)

        def position(at_ns: int) -> int:
            motion.advance(at_ns)
            return self._position()

        def current(at_ns: int) -> int:
            motion.advance(at_ns)
            register = registers["present_current"]
            scale = register.scale if register.unit else _UNKNOWN_CURRENT_UNIT
            noise = int(random.random() * 5.0) - 2  # LSB
            return round(motion.current / scale) + noise

        def load(at_ns: int) -> int:
            motion.advance(at_ns)
            return round(1000 * min(1.0, max(-1.0, motion.current / 1.5))) + random.randrange(-2, 3)

        def pwm(at_ns: int) -> int:
            motion.advance(at_ns)
            full = 1 / registers["present_pwm"].scale
            return round(full * min(1.0, max(-1.0, motion.velocity / motion.limit)))

        def moving(at_ns: int) -> int:
            motion.advance(at_ns)
            return int(abs(motion.velocity) > self._moving_threshold())

        def arrived(at_ns: int) -> int:
            motion.advance(at_ns)
            return int(motion.arrived)

        def voltage(_: int) -> int:
            # The last digit of the converter flickers.
            return round(self._volts * 10 + random.uniform(-0.6, 0.6))

        table: dict[str, Callable[[int], int]] = {
            "realtime_tick": lambda at_ns: at_ns // 1_000_000 % 32768,
            "moving": moving,
            "moving_status": arrived,
            "present_pwm": pwm,
            "present_current": current,
            "present_load": load,
            "present_velocity": velocity,
            "present_position": position,
            "velocity_trajectory": velocity,
            "position_trajectory": position,
            "present_input_voltage": voltage,
            "present_temperature": lambda at_ns: round(motion.warm(at_ns)),
        }
        return [(registers[name], measure) for name, measure in table.items() if name in registers]


def _model_of(config: ServoConfig) -> Model:
    """The model, or the stand-in of its series where only that is given."""
    if config.model in tuple(Series):
        return generic(Series(config.model))
    try:
        return model(config.model)
    except UnknownModel as error:
        raise ConfigError(f"servo {config.id}: {error}") from error


def _baud_rate_value(bits_per_second: int, register: Register, config: ServoConfig) -> int:
    try:
        value = baud_rate_register(bits_per_second)
    except ValueError as error:
        raise ConfigError(f"servo {config.id}: {error}") from error
    if value > register.bounds[1]:
        raise ConfigError(
            f"servo {config.id}: a {config.model} cannot run at {bits_per_second} bit/s"
        )
    return value
