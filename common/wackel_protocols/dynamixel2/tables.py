"""Control tables and models as data: what the manual prints, row by row.

Sources: ROBOTIS e-manual, the page of each model, "Control Table of EEPROM Area" and "Control Table
of RAM Area" (addresses, initial values, ranges, units), all models compared with it; ``.model``
files of the vendor's DynamixelSDK 4.1 (model numbers, addresses, pulses in a revolution, velocity
unit); the vendor's Dynamixel2Arduino (``actuator.h``: model numbers; ``Dynamixel2Arduino.cpp``:
current units, velocity and PWM limits). Where they disagree the newest edition of the model's page
stands; older ones have higher velocity limits for XM430 and MX and, like the library, a current
limit of 2047 for XH540-V. A value that no source settles is absent, not guessed.
"""

from enum import StrEnum
from typing import Literal, NamedTuple

Area = Literal["eeprom", "ram"]
Access = Literal["r", "rw"]


class Series(StrEnum):
    """Models that share a control table."""

    X = "X"
    X330 = "X330"
    X335 = "X335"
    MX = "MX"
    P = "P"
    XL320 = "XL320"


class Quantity(StrEnum):
    """What a register's number means; unit and scale follow from it and the model."""

    NUMBER = "number"
    POSITION = "position"
    ANGLE = "angle"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    CURRENT = "current"
    PWM = "pwm"
    LOAD = "load"
    VOLTAGE = "voltage"
    TEMPERATURE = "temperature"
    DELAY = "delay"
    WATCHDOG = "watchdog"
    TICK = "tick"


class Row(NamedTuple):
    """One register: address and length in bytes, then raw values; limits are inclusive.

    ``direction_bit`` marks the bit that means clockwise in a register with a magnitude below it;
    other signed registers are two's complement.
    """

    name: str
    address: int
    length: int
    quantity: Quantity = Quantity.NUMBER
    area: Area = "ram"
    access: Access = "rw"
    initial: int | None = None
    minimum: int | None = None
    maximum: int | None = None
    signed: bool = False
    direction_bit: int | None = None


class Voltages(NamedTuple):
    """Raw values of the voltage limits, 0.1 V: both may be set to ``least`` … ``high``."""

    least: int
    low: int
    high: int


class Facts(NamedTuple):
    """What tells one model from others of its series.

    Attributes:
        name: Without the suffix for the connection (-T, -R).
        number: Model Number register.
        series: Whose control table it has.
        current_unit: A for each raw unit.
        current_limit: Greatest current, raw.
        velocity_limit: Initial value, raw.
        voltages: Initial minimal and maximal voltage limit, and the range of both.
        temperature_limit: Initial value, °C.
        shutdown: Initial value.
        moving_threshold: Initial value, raw.
        baud_rate: Initial value, raw.
        acceleration_limit: Greatest value, raw; P series only.
        position_limit: Initial value to both sides of the centre, raw; 0: a whole revolution.
        resolution: Pulses in a revolution.
        centre: Raw position that is 0 rad.
        has_current: Reports current; otherwise load.
        has_led: Has a status LED.
        dual: Two servos in one case, which have no fast sync read.
    """

    name: str
    number: int
    series: Series
    current_unit: float | None = None
    current_limit: int | None = None
    velocity_limit: int | None = None
    voltages: Voltages | None = None
    temperature_limit: int | None = None
    shutdown: int | None = 52
    moving_threshold: int = 10
    baud_rate: int = 1
    acceleration_limit: int = 0
    position_limit: int = 0
    resolution: float = 4096
    centre: int = 2048
    has_current: bool = True
    has_led: bool = True
    dual: bool = False


Q = Quantity

_X_EEPROM = (
    Row("model_number", 0, 2, area="eeprom", access="r"),
    Row("model_information", 2, 4, area="eeprom", access="r"),
    Row("firmware_version", 6, 1, area="eeprom", access="r"),
    Row("id", 7, 1, area="eeprom", initial=1, minimum=0, maximum=252),
    Row("baud_rate", 8, 1, area="eeprom", initial=1, minimum=0),
    Row("return_delay_time", 9, 1, Q.DELAY, "eeprom", initial=250, minimum=0, maximum=254),
    Row("drive_mode", 10, 1, area="eeprom", initial=0),
    Row("operating_mode", 11, 1, area="eeprom", initial=3, minimum=0, maximum=16),
    Row("secondary_id", 12, 1, area="eeprom", initial=255),
    Row("protocol_type", 13, 1, area="eeprom", initial=2),
    Row("homing_offset", 20, 4, Q.ANGLE, "eeprom", initial=0, signed=True),
    Row("moving_threshold", 24, 4, Q.VELOCITY, "eeprom", minimum=0),
    Row("temperature_limit", 31, 1, Q.TEMPERATURE, "eeprom", minimum=0, maximum=100),
    Row("max_voltage_limit", 32, 2, Q.VOLTAGE, "eeprom"),
    Row("min_voltage_limit", 34, 2, Q.VOLTAGE, "eeprom"),
    Row("pwm_limit", 36, 2, Q.PWM, "eeprom", minimum=0),
    Row("current_limit", 38, 2, Q.CURRENT, "eeprom", minimum=0),
    Row("velocity_limit", 44, 4, Q.VELOCITY, "eeprom", minimum=0),
    Row("max_position_limit", 48, 4, Q.POSITION, "eeprom", signed=True),
    Row("min_position_limit", 52, 4, Q.POSITION, "eeprom", signed=True),
    Row("shutdown", 63, 1, area="eeprom"),
)

_X_RAM = (
    Row("torque_enable", 64, 1, initial=0, minimum=0, maximum=1),
    Row("led", 65, 1, initial=0),
    Row("status_return_level", 68, 1, initial=2, minimum=0, maximum=2),
    Row("registered_instruction", 69, 1, access="r", initial=0),
    Row("hardware_error_status", 70, 1, access="r", initial=0),
    Row("velocity_i_gain", 76, 2, minimum=0, maximum=16383),
    Row("velocity_p_gain", 78, 2, minimum=0, maximum=16383),
    Row("position_d_gain", 80, 2, minimum=0, maximum=16383),
    Row("position_i_gain", 82, 2, minimum=0, maximum=16383),
    Row("position_p_gain", 84, 2, minimum=0, maximum=16383),
    Row("feedforward_2nd_gain", 88, 2, initial=0, minimum=0, maximum=16383),
    Row("feedforward_1st_gain", 90, 2, initial=0, minimum=0, maximum=16383),
    # -1 is how the servo reports that the watchdog has bitten; it cannot be written.
    Row("bus_watchdog", 98, 1, Q.WATCHDOG, initial=0, minimum=0, maximum=127, signed=True),
    Row("goal_pwm", 100, 2, Q.PWM, signed=True),
    Row("goal_current", 102, 2, Q.CURRENT, signed=True),
    Row("goal_velocity", 104, 4, Q.VELOCITY, signed=True),
    Row("profile_acceleration", 108, 4, Q.ACCELERATION, initial=0, minimum=0, maximum=32767),
    Row("profile_velocity", 112, 4, Q.VELOCITY, initial=0, minimum=0, maximum=32767),
    Row("goal_position", 116, 4, Q.POSITION, signed=True),
    Row("realtime_tick", 120, 2, Q.TICK, access="r", minimum=0, maximum=32767),
    Row("moving", 122, 1, access="r", initial=0),
    Row("moving_status", 123, 1, access="r", initial=0),
    Row("present_pwm", 124, 2, Q.PWM, access="r", signed=True),
    Row("present_current", 126, 2, Q.CURRENT, access="r", signed=True),
    Row("present_velocity", 128, 4, Q.VELOCITY, access="r", signed=True),
    Row("present_position", 132, 4, Q.POSITION, access="r", signed=True),
    Row("velocity_trajectory", 136, 4, Q.VELOCITY, access="r", signed=True),
    Row("position_trajectory", 140, 4, Q.POSITION, access="r", signed=True),
    Row("present_input_voltage", 144, 2, Q.VOLTAGE, access="r"),
    Row("present_temperature", 146, 1, Q.TEMPERATURE, access="r"),
)

P_RAM_OFFSET = 448
"""The P series keeps the X series' RAM area in the same order, this much higher."""

X_ROWS = _X_EEPROM + _X_RAM
P_ROWS = (
    *_X_EEPROM,
    Row("acceleration_limit", 40, 4, Q.ACCELERATION, "eeprom", minimum=0),
    *(row._replace(address=row.address + P_RAM_OFFSET) for row in _X_RAM),
    # "led" is the red one here.
    Row("led_green", 514, 1, initial=0),
    Row("led_blue", 515, 1, initial=0),
)

LOAD_ROW = Row("present_load", 126, 2, Q.LOAD, access="r", signed=True)
"""Stands where models that measure current have Present Current."""

# The unit of the two velocities is that of Joint Mode, in which 1023 are 114 rev/min. In Wheel Mode
# 1023 are all that the motor can, which is the page's "No Load Speed" of 114 rev/min at 7.4 V.
XL320_ROWS = (
    Row("model_number", 0, 2, area="eeprom", access="r"),
    Row("firmware_version", 2, 1, area="eeprom", access="r"),
    Row("id", 3, 1, area="eeprom", initial=1, minimum=0, maximum=252),
    Row("baud_rate", 4, 1, area="eeprom", initial=3, minimum=0, maximum=3),
    Row("return_delay_time", 5, 1, Q.DELAY, "eeprom", initial=250, minimum=0, maximum=254),
    Row("min_position_limit", 6, 2, Q.POSITION, "eeprom", initial=0, minimum=0, maximum=1023),
    Row("max_position_limit", 8, 2, Q.POSITION, "eeprom", initial=1023, minimum=0, maximum=1023),
    Row("operating_mode", 11, 1, area="eeprom", initial=2, minimum=1, maximum=2),
    Row("temperature_limit", 12, 1, Q.TEMPERATURE, "eeprom", initial=65, minimum=0, maximum=150),
    Row("min_voltage_limit", 13, 1, Q.VOLTAGE, "eeprom", initial=60, minimum=50, maximum=250),
    Row("max_voltage_limit", 14, 1, Q.VOLTAGE, "eeprom", initial=90, minimum=50, maximum=250),
    Row("max_torque", 15, 2, Q.LOAD, "eeprom", initial=1023, minimum=0, maximum=1023),
    Row("status_return_level", 17, 1, area="eeprom", initial=2, minimum=0, maximum=2),
    Row("shutdown", 18, 1, area="eeprom", initial=3, minimum=0, maximum=7),
    Row("torque_enable", 24, 1, initial=0, minimum=0, maximum=1),
    Row("led", 25, 1, initial=0, minimum=0, maximum=7),
    Row("position_d_gain", 27, 1, initial=0, minimum=0, maximum=254),
    Row("position_i_gain", 28, 1, initial=0, minimum=0, maximum=254),
    Row("position_p_gain", 29, 1, initial=32, minimum=0, maximum=254),
    Row("goal_position", 30, 2, Q.POSITION, minimum=0, maximum=1023),
    Row("goal_velocity", 32, 2, Q.VELOCITY, minimum=-1023, maximum=1023, direction_bit=10),
    Row("goal_torque", 35, 2, Q.LOAD, minimum=0, maximum=1023),
    Row("present_position", 37, 2, Q.POSITION, access="r"),
    Row("present_velocity", 39, 2, Q.VELOCITY, access="r", direction_bit=10),
    Row("present_load", 41, 2, Q.LOAD, access="r", direction_bit=10),
    Row("present_input_voltage", 45, 1, Q.VOLTAGE, access="r"),
    Row("present_temperature", 46, 1, Q.TEMPERATURE, access="r"),
    Row("registered_instruction", 47, 1, access="r", initial=0),
    Row("moving", 49, 1, access="r", initial=0),
    Row("hardware_error_status", 50, 1, access="r", initial=0),
    Row("punch", 51, 2, initial=32, minimum=0, maximum=1023),
)

FAST_SYNC_READ_FIRMWARE = {Series.X: 45, Series.X330: 46, Series.P: 12}
"""First firmware that knows fast sync read (e-manual, Protocol 2.0, "Fast Sync Read").

rustypot 1.13 also has 46 for the XL330. Users of the vendor's SDK report no answer from an XL-320.
Nothing is said of the X335 series.
"""

_5_V, _12_V, _24_V = Voltages(31, 35, 70), Voltages(95, 95, 160), Voltages(110, 110, 300)
_XL_V, _XC_V, _XC330_T_V = Voltages(60, 60, 140), Voltages(60, 60, 160), Voltages(55, 55, 140)
_P_V = Voltages(150, 150, 350)
_X, _X330, _X335, _MX = Series.X, Series.X330, Series.X335, Series.MX


def _load(name: str, number: int, velocity_limit: int, voltages: Voltages, degrees: int) -> Facts:
    """A model of the X series that measures load instead of current."""
    return Facts(name, number, _X, None, None, velocity_limit, voltages, degrees, has_current=False)


def _p(name: str, number: int, limits: tuple[int, int, int, int], half_turn: int) -> Facts:
    """A model of the P series.

    Args:
        name: As in :class:`Facts`.
        number: As in :class:`Facts`.
        limits: Of current, velocity, acceleration and position, raw.
        half_turn: How far the position limits may be set.
    """
    current, velocity, acceleration, position = limits
    return Facts(
        name,
        number,
        Series.P,
        1e-3,
        current,
        velocity,
        _P_V,
        80,
        shutdown=58,
        moving_threshold=20,
        acceleration_limit=acceleration,
        position_limit=position,
        resolution=2 * half_turn,
        centre=0,
    )


# By number; then as in Facts: A for each raw unit, current limit, velocity limit, voltages, °C.
# The XC330 and the XM335 measure the current at their supply, unlike the others (their pages,
# "Current Limit").
MODELS = (
    Facts("MX-28", 30, _MX, None, None, 230, _12_V, 80, has_current=False),
    # 1941 is the control table's, in all editions, and the English text's; the Korean text and
    # Dynamixel2Arduino have the XM430's 1193. That would be 4.0 A, less than the page's stall
    # currents (4.1 A at 12 V, 5.2 A at 14.8 V); the limits of MX-106, XM and XH lie above theirs.
    Facts("MX-64", 311, _MX, 3.36e-3, 1941, 285, _12_V, 80),
    Facts("MX-106", 321, _MX, 3.36e-3, 2047, 210, _12_V, 80),
    # 0 … 1023 over 300°; 512 is the middle.
    Facts("XL-320", 350, Series.XL320, resolution=1024 * 360 / 300, centre=512, has_current=False),
    Facts("XH430-W350", 1000, _X, 2.69e-3, 648, 130, _12_V, 80),
    # Early editions of the XD pages repeat the XH's numbers; these are of ``actuator.h``.
    Facts("XD430-T350", 1001, _X, 2.69e-3, 648, 130, _12_V, 80),
    Facts("XH430-W210", 1010, _X, 2.69e-3, 648, 210, _12_V, 80),
    Facts("XD430-T210", 1011, _X, 2.69e-3, 648, 210, _12_V, 80),
    Facts("XM430-W350", 1020, _X, 2.69e-3, 1193, 200, _12_V, 80),
    Facts("XM430-W210", 1030, _X, 2.69e-3, 1193, 330, _12_V, 80),
    Facts("XH430-V350", 1040, _X, 1.34e-3, 689, 135, _24_V, 80),
    Facts("XH430-V210", 1050, _X, 1.34e-3, 689, 230, _24_V, 80),
    _load("XL430-W250", 1060, 265, _XL_V, 72),
    _load("XC430-W150", 1070, 460, _XC_V, 80)._replace(moving_threshold=20),
    _load("XC430-W240", 1080, 306, _XC_V, 80),
    _load("2XL430-W250", 1090, 250, _XL_V, 72)._replace(dual=True),
    Facts("XH540-W270", 1100, _X, 2.69e-3, 2047, 167, _12_V, 80),
    Facts("XD540-T270", 1101, _X, 2.69e-3, 2047, 167, _12_V, 80),
    Facts("XH540-W150", 1110, _X, 2.69e-3, 2047, 300, _12_V, 80),
    Facts("XD540-T150", 1111, _X, 2.69e-3, 2047, 300, _12_V, 80),
    Facts("XM540-W270", 1120, _X, 2.69e-3, 2047, 128, _12_V, 80),
    Facts("XM540-W150", 1130, _X, 2.69e-3, 2047, 230, _12_V, 80),
    Facts("XH540-V270", 1140, _X, 2.69e-3, 1188, 128, _24_V, 80),
    Facts("XH540-V150", 1150, _X, 2.69e-3, 1188, 230, _24_V, 80),
    _load("2XC430-W250", 1160, 275, _XC_V, 80)._replace(dual=True),
    Facts("XW540-T260", 1170, _X, 2.69e-3, 2047, 170, _12_V, 80, has_led=False),
    Facts("XW540-T140", 1180, _X, 2.69e-3, 2047, 304, _12_V, 80, has_led=False),
    Facts("XL330-M077", 1190, _X330, 1e-3, 1750, 1620, _5_V, 70, shutdown=53),
    Facts("XL330-M288", 1200, _X330, 1e-3, 1750, 445, _5_V, 70, shutdown=53),
    Facts("XC330-T181", 1210, _X330, 1e-3, 910, 510, _XC330_T_V, 70),
    Facts("XC330-T288", 1220, _X330, 1e-3, 910, 320, _XC330_T_V, 70),
    Facts("XC330-M181", 1230, _X330, 1e-3, 2352, 545, _5_V, 70),
    Facts("XC330-M288", 1240, _X330, 1e-3, 2352, 350, _5_V, 70),
    Facts("XW430-T333", 1270, _X, 2.69e-3, 2047, 139, _12_V, 80, has_led=False),
    Facts("XW430-T200", 1280, _X, 2.69e-3, 2047, 235, _12_V, 80, has_led=False),
    Facts("XW540-H260", 1310, _X, 2.69e-3, 1188, 145, _24_V, 80, has_led=False),
    # Without a page. The vendor's dynamixel_hardware_interface has its registers, its current
    # without a unit, and its name, which before release 1.5.2 was XC335-T332.
    Facts("XM335-T332", 1700, _X335, shutdown=None, baud_rate=3, position_limit=1024),
    # Editions of its page differ in the velocity limit, 320 and 280; those of 280 have the other
    # registers of the vendor's file.
    Facts(
        "XM335-T323",
        1710,
        _X335,
        1e-3,
        910,
        280,
        _XC330_T_V,
        70,
        baud_rate=3,
        position_limit=1024,
    ),
    _p("PH42-020-S300", 2000, (4500, 2920, 4_306_173, 303_454), 303_750),
    _p("PH54-100-S500", 2010, (15900, 2920, 4_255_632, 501_433), 501_923),
    # Its table has 52 for Shutdown, its text marks the bits of 58 as default.
    _p("PH54-200-S500", 2020, (22740, 2900, 3_992_644, 501_433), 501_923)._replace(shutdown=None),
    _p("PM42-010-S260", 2100, (1461, 2600, 4_346_756, 262_931), 263_187),
    _p("PM54-040-S250", 2110, (4470, 2840, 4_414_976, 251_173), 251_417),
    _p("PM54-060-S250", 2120, (7980, 2830, 4_457_932, 251_173), 251_417),
)
