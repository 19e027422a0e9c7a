"""One servo: the instructions it obeys, its errors, its restart, its goals.

Source, unless named otherwise: ROBOTIS e-manual, Protocol 2.0, "Instruction Details", and the
control tables of the X series. Times are ns and come as arguments.
"""

from random import Random

from wackel_node.config import ServoConfig
from wackel_protocols.dynamixel2.control_table import (
    Register,
    baud_rate,
    baud_rate_register,
    configured,
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
from wackel_virtual.indirect import IndirectArea
from wackel_virtual.motion import STANDBY_A, Motion
from wackel_virtual.sensors import Measure, Sensors
from wackel_virtual.table import (
    ACCESS,
    CURRENT,
    DATA_LENGTH,
    DATA_RANGE,
    INSTRUCTION_ERROR,
    PWM,
    RESULT_FAIL,
    VELOCITY,
    ControlTable,
)

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
    Series.X335: 12.0,
    Series.MX: 12.0,
    Series.P: 24.0,
    Series.XL320: 7.4,
}
_USUAL_VELOCITY = 6.0
"""rad/s, some 57 rev/min, for models whose limit is not in the tables."""

_Plan = tuple[list[tuple[Register, Measure]], list[IndirectArea]]
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
        self._model = configured(config.model)
        self._firmware = FIRMWARE if firmware is None else firmware
        first_fast = self._model.fast_sync_read_firmware
        self.knows_fast_read = first_fast is not None and self._firmware >= first_fast
        self._table = table = ControlTable(self._model)
        self._motion = Motion(
            position=random.uniform(-0.5, 0.5),
            load=random.uniform(-0.2, 0.2),
            limit=_USUAL_VELOCITY,
        )
        self._sensors = Sensors(table, self._motion, random)
        self._plans: dict[tuple[int, int], _Plan] = {}
        self._registered: tuple[int, bytes] | None = None
        self._backup: bytes | None = None
        self._right_delay: int | None = None  # to come back after it was set wrongly
        self._stuck = False
        self._cause = 0  # hardware errors that come back after a restart
        self._locked = False  # torque stays off until a restart
        self._motor_off = False
        self._heard_ns = 0
        self.deaf_until_ns = 0
        self._reset_eeprom()
        table.put("id", config.id)
        table.put("baud_rate", baud_rate_register(baud_rate))
        if return_delay_us is not None:
            table.put("return_delay_time", return_delay_us // 2)
        low, high = table.get("min_voltage_limit") / 10, table.get("max_voltage_limit") / 10
        usual = _RECOMMENDED_VOLTS[self._model.series]
        self.recommended_volts = usual if low <= usual <= high else (low + high) / 2
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
                error = self._write_now(parameters, at_ns)
            case Instruction.REG_WRITE:
                error = self._write_later(parameters)
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
        """Error byte and data of a part of the control table; no data with an error.

        Gaps between registers read as zeros.
        """
        table = self._table
        if address + length > table.size:
            return ACCESS | self._alert(), b""
        plan = self._plans.get((address, length))
        if plan is None:
            plan = self._plans[address, length] = self._plan(address, length)
        measured, areas = plan
        if not self._stuck:
            for register, measure in measured:
                table.store(register, measure(at_ns))
        return self._alert(), table.read(address, length, areas)

    def write(self, address: int, data: bytes, at_ns: int) -> int:
        """Write a part of the control table; returns the number of an error, 0 for success."""
        targets = self._table.targets(address, data)
        for target, part in targets:
            error = self._table.check(target, part)
            if error:
                return error
        for target, part in targets:
            for name in self._table.write(target, part):
                self._react(name, at_ns)
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
        self._sensors.volts = volts
        low, high = self._table.get("min_voltage_limit"), self._table.get("max_voltage_limit")
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
            for name, measure in self._sensors.measures.items():
                self._table.put(name, measure(at_ns))
        self._stuck = stuck

    def misset_return_delay(self, value: int | None) -> None:
        """Set Return Delay Time wrongly; None puts it right unless somebody has written it."""
        if value is not None:
            if self._right_delay is None:
                self._right_delay = self._table.get("return_delay_time")
            self._table.put("return_delay_time", value)
        elif self._right_delay is not None:
            self._table.put("return_delay_time", self._right_delay)
            self._right_delay = None
        self._remember()

    def couple(self, shaft: Motion, *, turns: bool) -> None:
        """Have a part of the robot on the shaft from now on; before the first instruction.

        Args:
            shaft: Moves as that part does.
            turns: Whether it turns without end: its builder has set the operating mode to velocity.
        """
        shaft.limit = self._motion.limit
        self._motion = shaft
        self._sensors.couple(shaft)
        if turns:
            self._table.put("operating_mode", VELOCITY)
        self._reset_ram(0)

    def switch_motor_off(self, off: bool, at_ns: int) -> None:
        """Whether torque stays off; it does not come back by itself."""
        self._motor_off = off
        if off:
            self._table.put("torque_enable", 0)
            self._drive(at_ns)

    # Instructions.

    def _write_now(self, parameters: bytes, at_ns: int) -> int:
        if len(parameters) < 3:
            return DATA_LENGTH
        return self.write(parameters[0] | parameters[1] << 8, parameters[2:], at_ns)

    def _write_later(self, parameters: bytes) -> int:
        if len(parameters) < 3:
            return DATA_LENGTH
        address = parameters[0] | parameters[1] << 8
        for target, part in self._table.targets(address, parameters[2:]):
            error = self._table.check(target, part)
            if error:
                return error
        self._registered = (address, parameters[2:])
        self._table.put("registered_instruction", 1)
        return 0

    def _act(self, at_ns: int) -> int:
        if self._registered is None:
            return INSTRUCTION_ERROR
        address, data = self._registered
        self._registered = None
        self._table.put("registered_instruction", 0)
        return self.write(address, data, at_ns)

    def _factory_reset(self, packet: InstructionPacket, at_ns: int) -> int:
        option = packet.parameters[0] if len(packet.parameters) == 1 else None
        if option not in tuple(FactoryReset):
            return DATA_RANGE
        if packet.id == BROADCAST_ID and option == FactoryReset.ALL:
            return RESULT_FAIL  # would leave all servos with the same id
        table = self._table
        kept = table.get("id"), table.get("baud_rate")
        self._reset_eeprom()
        if option != FactoryReset.ALL:
            table.put("id", kept[0])
        if option == FactoryReset.EXCEPT_ID_AND_BAUD_RATE:
            table.put("baud_rate", kept[1])
        self._restart(at_ns)
        return 0

    def _clear(self, packet: InstructionPacket, at_ns: int) -> int:
        if packet.encode() != clear(packet.id):
            return DATA_RANGE
        self._motion.advance(at_ns)
        if abs(self._motion.velocity) > self._sensors.moving_threshold:
            return RESULT_FAIL
        self._unwind()
        return 0

    def _back_up(self, packet: InstructionPacket, at_ns: int) -> int:
        if self._table.get("torque_enable"):
            return RESULT_FAIL
        data = packet.encode()
        if data == control_table_backup(packet.id, Backup.STORE):
            self._backup = self._table.image()
            return 0
        if data != control_table_backup(packet.id, Backup.RESTORE):
            return DATA_RANGE
        if self._backup is None:
            return RESULT_FAIL
        self._table.restore(self._backup)
        self._restart(at_ns)
        return 0

    # What follows from a write.

    def _react(self, name: str, at_ns: int) -> None:
        table = self._table
        match name:
            case "torque_enable":
                if self._locked or self._motor_off:
                    table.put("torque_enable", 0)
                elif table.get("torque_enable"):
                    self._hold(at_ns)
                self._drive(at_ns)
            case "operating_mode":
                table.reset_goals()
                self._drive(at_ns)
            case "goal_position" | "goal_velocity" | "goal_current" | "goal_pwm":
                self._drive(at_ns)
            case "profile_velocity" | "velocity_limit":
                self._drive(at_ns)
            case "bus_watchdog":
                self._heard_ns = at_ns
            case "return_delay_time":
                self._right_delay = None
                self._remember()
            case "id" | "baud_rate" | "status_return_level":
                self._remember()

    def _remember(self) -> None:
        """Keep the registers at hand that every instruction needs."""
        self.id = self._table.get("id")
        self.baud_rate = baud_rate(self._table.get("baud_rate"))
        self.return_delay_ns = self._table.get("return_delay_time") * 2_000
        self.status_return_level = self._table.get("status_return_level")

    def _plan(self, address: int, length: int) -> _Plan:
        end = address + length
        areas = self._table.areas(address, length)
        measured = []
        for name, measure in self._sensors.measures.items():
            register = self._table.registers[name]
            # Indirect data may point anywhere.
            if areas or (register.address < end and address < register.address + register.length):
                measured.append((register, measure))
        return measured, areas

    # Restart and errors.

    def _restart(self, at_ns: int) -> None:
        self.deaf_until_ns = at_ns + BOOT_NS
        self._reset_ram(at_ns)

    def _reset_eeprom(self) -> None:
        self._table.reset_eeprom()
        self._table.put("model_number", self._model.number)
        self._table.put("firmware_version", self._firmware)

    def _reset_ram(self, at_ns: int) -> None:
        self._registered = None
        self._locked = False
        self._table.reset_ram()
        self._drive(at_ns)
        self._unwind()
        self._hold(at_ns)
        self._remember()
        self._raise_errors(self._cause, at_ns)

    def _alert(self) -> int:
        return ALERT if self._table.hardware_errors else 0

    def _raise_errors(self, bits: int, at_ns: int) -> None:
        if not bits:
            return
        if self._model.series is Series.XL320:
            bits = sum(1 << there for here, there in _XL320_BITS.items() if bits >> here & 1)
        self._table.put("hardware_error_status", self._table.hardware_errors | bits)
        if bits & self._table.get("shutdown"):
            self._locked = True
            self._table.put("torque_enable", 0)
            self._drive(at_ns)

    # Motion.

    def _drive(self, at_ns: int) -> None:
        """Take over the goals of the control table."""
        table, motion = self._table, self._motion
        if table.has("velocity_limit"):
            motion.limit = self._in_si("velocity_limit") or _USUAL_VELOCITY
        mode = table.mode
        if not table.get("torque_enable"):
            motion.drive("off", 0.0, 0.0, at_ns)
        elif mode == VELOCITY:
            motion.drive("velocity", self._in_si("goal_velocity"), motion.limit, at_ns)
        elif mode in (CURRENT, PWM):
            name = "current" if mode == CURRENT else "pwm"
            share = 0.0
            if table.has(f"goal_{name}"):
                share = table.get(f"goal_{name}") / (table.get(f"{name}_limit") or 1)
            motion.drive("velocity", share * motion.limit, motion.limit, at_ns)
        else:
            profile = self._in_si("profile_velocity") if table.has("profile_velocity") else 0.0
            motion.drive("position", self._in_si("goal_position"), profile or motion.limit, at_ns)

    def _in_si(self, name: str) -> float:
        return self._table.registers[name].to_si(self._table.get(name))

    def _hold(self, at_ns: int) -> None:
        """Make the present position the goal, as a servo does when it starts or gets torque."""
        self._table.put("goal_position", self._sensors.position(at_ns))

    def _watch(self, at_ns: int) -> None:
        """Let the watchdog stop the shaft if it should have by now."""
        watchdog = self._table.watchdog
        if watchdog > 0:
            bites_ns = self._heard_ns + watchdog * 20_000_000
            if at_ns > bites_ns:
                self._table.put("bus_watchdog", -1)
                self._motion.drive("velocity", 0.0, self._motion.limit, bites_ns)

    def _unwind(self) -> None:
        """Forget whole revolutions."""
        self._motion.unwind(
            self._model.resolution * self._table.registers["present_position"].scale
        )
