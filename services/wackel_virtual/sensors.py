"""What a servo measures, as raw values of its registers."""

from collections.abc import Callable
from random import Random

from wackel_protocols.dynamixel2.control_table import Register
from wackel_virtual.motion import Motion
from wackel_virtual.table import ControlTable

Measure = Callable[[int], int]
"""Raw value at a time in ns."""

_UNKNOWN_CURRENT_UNIT = 1e-3
"""A, for models whose own is not in the tables."""
_FULL_LOAD_A = 1.5
"""What models without current sensor call 100 % load; an assumption."""


class Sensors:
    """The measured registers of one servo.

    Attributes:
        volts: Input voltage.
        measures: How each measured register gets its value, by name.
    """

    def __init__(self, table: ControlTable, motion: Motion, random: Random) -> None:
        self.volts = 0.0
        self._table = table
        self._motion = motion
        self._random = random
        registers = table.registers
        self._position_register = registers["present_position"]
        self._velocity_register = registers["present_velocity"]
        measures: dict[str, Measure] = {
            "realtime_tick": lambda at_ns: at_ns // 1_000_000 % 32768,
            "moving": self._moving,
            "moving_status": self._arrived,
            "present_pwm": self._pwm,
            "present_current": self._current,
            "present_load": self._load,
            "present_velocity": self._velocity,
            "present_position": self.position,
            "velocity_trajectory": self._velocity,
            "position_trajectory": self.position,
            "present_input_voltage": self._voltage,
            "present_temperature": self._temperature,
        }
        self.measures = {name: how for name, how in measures.items() if name in registers}

    def couple(self, motion: Motion) -> None:
        """Measure this shaft from now on."""
        self._motion = motion

    def position(self, at_ns: int) -> int:
        """Present Position."""
        self._motion.advance(at_ns)
        register = self._position_register
        return _nearest(register, round(self._motion.position / register.scale) + register.zero)

    @property
    def moving_threshold(self) -> float:
        """rad/s."""
        if not self._table.has("moving_threshold"):
            return 0.1  # XL-320: not adjustable, nor documented
        return self._table.registers["moving_threshold"].to_si(self._table.get("moving_threshold"))

    def _velocity(self, at_ns: int) -> int:
        self._motion.advance(at_ns)
        register = self._velocity_register
        return _nearest(register, round(self._motion.velocity / register.scale))

    def _current(self, at_ns: int) -> int:
        self._motion.advance(at_ns)
        register = self._table.registers["present_current"]
        scale = register.scale if register.unit else _UNKNOWN_CURRENT_UNIT
        return round(self._motion.current / scale) + self._flicker()

    def _load(self, at_ns: int) -> int:
        self._motion.advance(at_ns)
        share = min(1.0, max(-1.0, self._motion.current / _FULL_LOAD_A))
        return round(1000 * share) + self._flicker()

    def _pwm(self, at_ns: int) -> int:
        self._motion.advance(at_ns)
        share = min(1.0, max(-1.0, self._motion.velocity / self._motion.limit))
        return round(share / self._table.registers["present_pwm"].scale)

    def _moving(self, at_ns: int) -> int:
        self._motion.advance(at_ns)
        return int(abs(self._motion.velocity) > self.moving_threshold)

    def _arrived(self, at_ns: int) -> int:
        self._motion.advance(at_ns)
        return int(self._motion.arrived)

    def _voltage(self, _: int) -> int:
        # In between two values the last digit flickers.
        return max(0, round(self.volts * 10 + self._random.uniform(-0.6, 0.6)))

    def _temperature(self, at_ns: int) -> int:
        self._motion.advance(at_ns)
        return round(self._motion.warm(at_ns))

    def _flicker(self) -> int:
        """Noise of a current sensor, raw."""
        return int(self._random.random() * 5.0) - 2


def _nearest(register: Register, raw: int) -> int:
    """What a register can show of a raw value."""
    least, greatest = register.bounds
    return min(max(raw, least), greatest)
