"""Models and registers with SI units: raw register values to radians, volts, amperes and back.

Names are the manual's, in lower case with underscores, and the same for all series; the XL-320's
own words are translated (Moving Speed is ``goal_velocity``, CW Angle Limit ``min_position_limit``).
Units: rad, rad/s, rad/s², A, V, °C, s; PWM and load as a share of the greatest, -1 … 1; numbers and
flags have no unit. The data and their sources are in :mod:`.tables`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from math import tau
from types import MappingProxyType
from typing import NamedTuple

from wackel_protocols.dynamixel2.tables import (
    FAST_SYNC_READ_FIRMWARE,
    LOAD_ROW,
    MODELS,
    P_ROWS,
    X_ROWS,
    XL320_ROWS,
    Access,
    Area,
    Facts,
    Quantity,
    Row,
    Series,
)

BAUD_RATES = (
    9_600,
    57_600,
    115_200,
    1_000_000,
    2_000_000,
    3_000_000,
    4_000_000,
    4_500_000,
    6_000_000,
    10_500_000,
)
"""Bit/s by the value of the Baud Rate register (e-manual, "Baud Rate").

Only the P series knows all; X and MX end at 7, the X330 and X335 series at 6, the XL-320 at 3.
"""

_RPM = tau / 60
_X_VELOCITY = 0.0239691227
"""rad/s; the manual rounds it to 0.229 rev/min, the vendor's ``.model`` files give these digits."""
_X_PWM_FULL, _P_PWM_FULL = 885, 2009
_HIGHEST_BAUD_RATE = {Series.X: 7, Series.X330: 6, Series.X335: 6, Series.MX: 7, Series.P: 9}
_HIGHEST_VELOCITY_LIMIT = {Series.X: 1023, Series.X330: 2047, Series.X335: 2047, Series.MX: 1023}
"""The P series may not be set beyond its initial value."""
_P_HIGHEST_GAIN = 32767
_PER_MINUTE_SQUARED = tau / 3600


class UnknownModel(LookupError):
    """A model name or number that is in no table."""


@dataclass(frozen=True, slots=True)
class Register:
    """One register of a control table.

    Attributes:
        name: As in the manual, lower case.
        address: Of its first byte.
        length: Bytes: 1, 2 or 4.
        signed: Whether raw values can be negative.
        unit: SI unit of :meth:`to_si`; "" where raw values are numbers or flags, or where the
            model's scale is not known.
        scale: SI units for each raw unit.
        zero: Raw value that is 0 in SI units.
        area: ``eeprom`` cannot be written while torque is enabled and survives a reboot.
        access: ``r`` or ``rw``.
        initial: Raw value when new; absent if it differs by model and was not looked up, or if it
            is measured.
        minimum, maximum: Raw values that may be written, inclusive; absent where only the length
            limits them, or another register does.
        direction_bit: Bit that means clockwise, the bits below being the magnitude; absent for
            two's complement.
    """

    name: str
    address: int
    length: int
    signed: bool
    unit: str
    scale: float
    zero: int
    area: Area
    access: Access
    initial: int | None
    minimum: int | None
    maximum: int | None
    direction_bit: int | None

    def to_si(self, raw: int) -> float:
        """A raw value in SI units."""
        return (raw - self.zero) * self.scale

    def from_si(self, value: float) -> int:
        """The nearest raw value. Raises ValueError if the register does not allow it."""
        raw = round(value / self.scale) + self.zero
        low, high = self.bounds
        if not low <= raw <= high:
            allowed = f"{self.to_si(low):g} … {self.to_si(high):g}"
            raise ValueError(f"{self.name} cannot be {value:g} {self.unit}: allowed is {allowed}")
        return raw

    @property
    def bounds(self) -> tuple[int, int]:
        """Least and greatest raw value that may be written."""
        if self.direction_bit is not None:
            greatest = (1 << self.direction_bit) - 1
            least = -greatest
        else:
            bits = 8 * self.length - self.signed
            greatest = (1 << bits) - 1
            least = -(1 << bits) if self.signed else 0
        return (
            least if self.minimum is None else self.minimum,
            greatest if self.maximum is None else self.maximum,
        )

    def decode(self, data: bytes) -> int:
        """The raw value of the register's bytes. Raises ValueError for another number of them."""
        if len(data) != self.length:
            raise ValueError(f"{self.name} has {self.length} bytes, not {len(data)}")
        if self.direction_bit is None:
            return int.from_bytes(data, "little", signed=self.signed)
        word = int.from_bytes(data, "little")
        magnitude = word & (1 << self.direction_bit) - 1
        return -magnitude if word >> self.direction_bit & 1 else magnitude

    def encode(self, raw: int) -> bytes:
        """The register's bytes. Raises OverflowError if the value does not fit into them."""
        if self.direction_bit is None:
            return raw.to_bytes(self.length, "little", signed=self.signed)
        if abs(raw) >> self.direction_bit:
            raise OverflowError(f"{raw} does not fit into {self.name}")
        word = abs(raw) | (raw < 0) << self.direction_bit
        return word.to_bytes(self.length, "little")


@dataclass(frozen=True, slots=True)
class Model:
    """One kind of servo.

    Attributes:
        name: As the vendor writes it, without the suffix for the connection (-T, -R).
        number: Model Number register; 0 for the fallback of :func:`generic`.
        series: Models that share a control table.
        registers: By name.
        resolution: Raw position units in a revolution.
        centre: Raw position that is 0 rad.
        fast_sync_read_firmware: First firmware that knows fast sync read; absent if none does.
    """

    name: str
    number: int
    series: Series
    registers: Mapping[str, Register]
    resolution: float
    centre: int
    fast_sync_read_firmware: int | None


@cache
def model(number_or_name: int | str) -> Model:
    """A model by its number or its name, in any case, with or without -T and -R at the end.

    Raises :class:`UnknownModel`; :func:`generic` is then the way to go on if the series is known.
    """
    if isinstance(number_or_name, int):
        if number_or_name not in _BY_NUMBER:
            known = ", ".join(map(str, _BY_NUMBER))
            raise UnknownModel(f"no model has the number {number_or_name}; known are {known}")
        return _build(_BY_NUMBER[number_or_name])
    key = _key(number_or_name)
    if key not in _BY_KEY:
        similar = [_BY_KEY[match].name for match in get_close_matches(key, _BY_KEY)]
        hint = f"; similar are {', '.join(similar)}" if similar else ""
        raise UnknownModel(f"no model is called {number_or_name!r}{hint}")
    return _build(_BY_KEY[key])


def models() -> tuple[str, ...]:
    """The names of all known models."""
    return tuple(facts.name for facts in MODELS)


@cache
def generic(series: Series) -> Model:
    """A stand-in for a model of a known series that is in no table.

    Addresses, voltage, temperature, position and velocity hold for the whole series; currents stay
    raw, without unit. Raises :class:`UnknownModel` for the P series, where every model has its own
    pulses in a revolution.
    """
    if series is Series.P:
        raise UnknownModel("every model of the P series has a position unit of its own")
    relative = next(facts for facts in MODELS if facts.series is series)
    return _build(
        Facts(
            f"generic {series}",
            0,
            series,
            resolution=relative.resolution,
            centre=relative.centre,
            shutdown=None,
            has_current=series is not Series.XL320,
        )
    )


def configured(name: str) -> Model:
    """A model as people write it into a configuration: its name, or that of its series.

    Raises :class:`UnknownModel`, with what is similar.
    """
    if name.upper() in tuple(Series):
        return generic(Series(name.upper()))
    return model(name)


def baud_rate(raw: int) -> int:
    """Bit/s of a value of the Baud Rate register. Raises ValueError for an unknown one."""
    if not 0 <= raw < len(BAUD_RATES):
        raise ValueError(f"baud rate register is {raw}, known are 0 … {len(BAUD_RATES) - 1}")
    return BAUD_RATES[raw]


def baud_rate_register(bits_per_second: int) -> int:
    """The inverse of :func:`baud_rate`. Raises ValueError for a rate that no servo has."""
    if bits_per_second not in BAUD_RATES:
        raise ValueError(f"no servo runs at {bits_per_second} bit/s, possible are {BAUD_RATES}")
    return BAUD_RATES.index(bits_per_second)


def _key(name: str) -> str:
    plain = re.sub(r"-(T|R|TR|T/R)$", "", name.strip().upper().replace("_", "-"))
    return plain.replace("-", "")


_BY_NUMBER = {facts.number: facts for facts in MODELS}
_BY_KEY = {_key(facts.name): facts for facts in MODELS}


def _build(facts: Facts) -> Model:
    rows = _rows(facts)
    return Model(
        facts.name,
        facts.number,
        facts.series,
        MappingProxyType({row.name: _register(row, facts) for row in rows}),
        facts.resolution,
        facts.centre,
        None if facts.dual else FAST_SYNC_READ_FIRMWARE.get(facts.series),
    )


class _Values(NamedTuple):
    initial: int | None = None
    minimum: int | None = None
    maximum: int | None = None


def _rows(facts: Facts) -> list[Row]:
    """The series' registers with what this model has otherwise."""
    if facts.series is Series.XL320:
        return list(XL320_ROWS)
    own = _own_values(facts)
    rows: list[Row] = []
    for row in P_ROWS if facts.series is Series.P else X_ROWS:
        if row.name == "led" and not facts.has_led:
            continue
        if row.quantity is Quantity.CURRENT and not facts.has_current:
            if row.name == "present_current":
                rows.append(LOAD_ROW)
            continue
        rows.append(row._replace(**own[row.name]._asdict()) if row.name in own else row)
    return rows


def _own_values(facts: Facts) -> dict[str, _Values]:
    """Initial value and limits by register where they are not the same for all series."""
    full_pwm = _P_PWM_FULL if facts.series is Series.P else _X_PWM_FULL
    own = {
        "baud_rate": _Values(facts.baud_rate, 0, _HIGHEST_BAUD_RATE[facts.series]),
        "pwm_limit": _Values(full_pwm, 0, full_pwm),
        "current_limit": _Values(facts.current_limit, 0, facts.current_limit),
        "temperature_limit": _Values(facts.temperature_limit, 0, 100),
        "shutdown": _Values(facts.shutdown),
    }
    if facts.voltages is not None:
        least, low, high = facts.voltages
        own["min_voltage_limit"] = _Values(low, least, high)
        own["max_voltage_limit"] = _Values(high, least, high)
    return own | (_own_p_values(facts) if facts.series is Series.P else _own_x_values(facts))


def _own_x_values(facts: Facts) -> dict[str, _Values]:
    last = round(facts.resolution) - 1
    greatest_velocity = _HIGHEST_VELOCITY_LIMIT[facts.series]
    low, high = 0, last
    if facts.position_limit:
        low, high = facts.centre - facts.position_limit, facts.centre + facts.position_limit
    return {
        "homing_offset": _Values(0, -1_044_479, 1_044_479),
        "moving_threshold": _Values(facts.moving_threshold, 0, 1023),
        "velocity_limit": _Values(facts.velocity_limit, 0, greatest_velocity),
        "min_position_limit": _Values(low, 0, last),
        "max_position_limit": _Values(high, 0, last),
    }


def _own_p_values(facts: Facts) -> dict[str, _Values]:
    half_turn = round(facts.resolution / 2)
    own = {
        "moving_threshold": _Values(facts.moving_threshold, 0, facts.velocity_limit),
        "velocity_limit": _Values(facts.velocity_limit, 0, facts.velocity_limit),
        "acceleration_limit": _Values(None, 0, facts.acceleration_limit),
        "min_position_limit": _Values(-facts.position_limit, -half_turn, half_turn),
        "max_position_limit": _Values(facts.position_limit, -half_turn, half_turn),
        "profile_velocity": _Values(None, 0),
        "profile_acceleration": _Values(None, 0),
    }
    gains = [row for row in P_ROWS if row.name.endswith("_gain")]
    return own | {gain.name: _Values(gain.initial, 0, _P_HIGHEST_GAIN) for gain in gains}


def _register(row: Row, facts: Facts) -> Register:
    unit, scale, zero = _unit(row.quantity, facts)
    return Register(
        row.name,
        row.address,
        row.length,
        row.signed or row.direction_bit is not None,
        unit,
        scale,
        zero,
        row.area,
        row.access,
        row.initial,
        row.minimum,
        row.maximum,
        row.direction_bit,
    )


def _unit(quantity: Quantity, facts: Facts) -> tuple[str, float, int]:
    """Unit, scale and raw zero of a quantity of a model."""
    p_series = facts.series is Series.P
    if facts.series is Series.XL320:
        velocity = 0.111 * _RPM
    else:
        velocity = 0.01 * _RPM if p_series else _X_VELOCITY
    angle = tau / facts.resolution
    acceleration = (1 if p_series else 214.577) * _PER_MINUTE_SQUARED
    full_pwm = _P_PWM_FULL if p_series else _X_PWM_FULL
    current = ("", 1.0, 0) if facts.current_unit is None else ("A", facts.current_unit, 0)
    units: dict[Quantity, tuple[str, float, int]] = {
        Quantity.NUMBER: ("", 1.0, 0),
        Quantity.POSITION: ("rad", angle, facts.centre),
        Quantity.ANGLE: ("rad", angle, 0),
        Quantity.VELOCITY: ("rad/s", velocity, 0),
        Quantity.ACCELERATION: ("rad/s²", acceleration, 0),
        Quantity.CURRENT: current,
        Quantity.PWM: ("1", 1 / full_pwm, 0),
        Quantity.LOAD: ("1", 1e-3, 0),
        Quantity.VOLTAGE: ("V", 0.1, 0),
        Quantity.TEMPERATURE: ("°C", 1.0, 0),
        Quantity.DELAY: ("s", 2e-6, 0),
        Quantity.WATCHDOG: ("s", 20e-3, 0),
        Quantity.TICK: ("s", 1e-3, 0),
    }
    return units[quantity]
