"""The error byte of a status packet and the Hardware Error Status register, in words.

Sources: ROBOTIS e-manual, Protocol 2.0, "Error"; control tables, "Shutdown" and "Hardware Error
Status", which differ by series.
"""

from wackel_protocols.dynamixel2.packet import ALERT
from wackel_protocols.dynamixel2.tables import Series

ERROR_NUMBERS: dict[int, str] = {
    1: "result fail: the servo could not process the instruction",
    2: "instruction error: unknown instruction, or action without reg write",
    3: "CRC error: the instruction reached the servo damaged",
    4: "data range error: the value is outside the register's range",
    5: "data length error: fewer bytes than the register has",
    6: "data limit error: the value is beyond the limit set in the servo",
    7: "access error: no such register, read-only, or EEPROM while torque is enabled",
}
"""Low seven bits of the error byte; 0 means success."""

_X_BITS = {
    0: "input voltage",
    2: "overheating",
    3: "motor encoder",
    4: "electrical shock",
    5: "overload",
}
_HARDWARE_ERRORS: dict[Series, dict[int, str]] = {
    Series.X: _X_BITS,
    Series.X330: _X_BITS,
    Series.X335: _X_BITS,
    Series.MX: _X_BITS,
    Series.P: _X_BITS | {1: "motor Hall sensor"},
    Series.XL320: {0: "overload", 1: "overheating", 2: "input voltage"},
}


def describe_error(error: int) -> list[str]:
    """What an error byte says, in words; empty if it is 0."""
    words: list[str] = []
    if error & ALERT:
        words.append("alert: Hardware Error Status is set")
    number = error & ~ALERT
    if number:
        words.append(ERROR_NUMBERS.get(number, f"unknown error number {number}"))
    return words


def hardware_errors(status: int, series: Series = Series.X) -> list[str]:
    """Names of the bits set in Hardware Error Status, lowest bit first; empty if it is 0."""
    names = _HARDWARE_ERRORS[series]
    return [names.get(bit, f"unknown bit {bit}") for bit in range(8) if status >> bit & 1]
