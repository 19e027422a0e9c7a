from itertools import pairwise
from math import isclose, pi
from pathlib import Path

import dynamixel_easy_sdk
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_protocols.dynamixel2 import Register, Series, UnknownModel, model
from wackel_protocols.dynamixel2.control_table import (
    baud_rate,
    baud_rate_register,
    configured,
    generic,
    models,
)
from wackel_protocols.dynamixel2.errors import describe_error, hardware_errors

VENDOR = Path(dynamixel_easy_sdk.__file__).parent / "control_table"
XM430 = model("XM430-W350").registers
XL320 = model("XL-320").registers
XL330 = model("XL330-M077").registers
PH54 = model("PH54-200-S500").registers
# Where the vendor's word is not ours.
TRANSLATED = {
    "secondary(shadow) id": "secondary_id",
    "led red": "led",
    "cw angle limit": "min_position_limit",
    "ccw angle limit": "max_position_limit",
    "control mode": "operating_mode",
    "d gain": "position_d_gain",
    "i gain": "position_i_gain",
    "p gain": "position_p_gain",
    "moving speed": "goal_velocity",
    "present speed": "present_velocity",
    "torque limit": "goal_torque",
    "present voltage": "present_input_voltage",
}
# Typed from the e-manual's pages, in their units: model number, mA for each raw unit of current,
# greatest current, initial velocity limit, initial and least minimal voltage limit, maximal voltage
# limit, temperature limit, shutdown. 0 stands where the page has no such row, None where its
# editions disagree.
MANUAL: dict[str, tuple[int, float, int, int, int, int, int, int, int | None]] = {
    "MX-28": (30, 0, 0, 230, 95, 95, 160, 80, 52),
    "MX-64": (311, 3.36, 1941, 285, 95, 95, 160, 80, 52),
    "MX-106": (321, 3.36, 2047, 210, 95, 95, 160, 80, 52),
    "XL330-M077": (1190, 1, 1750, 1620, 35, 31, 70, 70, 53),
    "XL330-M288": (1200, 1, 1750, 445, 35, 31, 70, 70, 53),
    "XC330-M181": (1230, 1, 2352, 545, 35, 31, 70, 70, 52),
    "XC330-M288": (1240, 1, 2352, 350, 35, 31, 70, 70, 52),
    "XC330-T181": (1210, 1, 910, 510, 55, 55, 140, 70, 52),
    "XC330-T288": (1220, 1, 910, 320, 55, 55, 140, 70, 52),
    "XM335-T323": (1710, 1, 910, 280, 55, 55, 140, 70, 52),
    "XL430-W250": (1060, 0, 0, 265, 60, 60, 140, 72, 52),
    "2XL430-W250": (1090, 0, 0, 250, 60, 60, 140, 72, 52),
    "XC430-W150": (1070, 0, 0, 460, 60, 60, 160, 80, 52),
    "XC430-W240": (1080, 0, 0, 306, 60, 60, 160, 80, 52),
    "2XC430-W250": (1160, 0, 0, 275, 60, 60, 160, 80, 52),
    "XM430-W210": (1030, 2.69, 1193, 330, 95, 95, 160, 80, 52),
    "XM430-W350": (1020, 2.69, 1193, 200, 95, 95, 160, 80, 52),
    "XH430-W210": (1010, 2.69, 648, 210, 95, 95, 160, 80, 52),
    "XH430-W350": (1000, 2.69, 648, 130, 95, 95, 160, 80, 52),
    "XH430-V210": (1050, 1.34, 689, 230, 110, 110, 300, 80, 52),
    "XH430-V350": (1040, 1.34, 689, 135, 110, 110, 300, 80, 52),
    "XD430-T210": (1011, 2.69, 648, 210, 95, 95, 160, 80, 52),
    "XD430-T350": (1001, 2.69, 648, 130, 95, 95, 160, 80, 52),
    "XW430-T200": (1280, 2.69, 2047, 235, 95, 95, 160, 80, 52),
    "XW430-T333": (1270, 2.69, 2047, 139, 95, 95, 160, 80, 52),
    "XM540-W150": (1130, 2.69, 2047, 230, 95, 95, 160, 80, 52),
    "XM540-W270": (1120, 2.69, 2047, 128, 95, 95, 160, 80, 52),
    "XH540-W150": (1110, 2.69, 2047, 300, 95, 95, 160, 80, 52),
    "XH540-W270": (1100, 2.69, 2047, 167, 95, 95, 160, 80, 52),
    "XH540-V150": (1150, 2.69, 1188, 230, 110, 110, 300, 80, 52),
    "XH540-V270": (1140, 2.69, 1188, 128, 110, 110, 300, 80, 52),
    "XD540-T150": (1111, 2.69, 2047, 300, 95, 95, 160, 80, 52),
    "XD540-T270": (1101, 2.69, 2047, 167, 95, 95, 160, 80, 52),
    "XW540-T140": (1180, 2.69, 2047, 304, 95, 95, 160, 80, 52),
    "XW540-T260": (1170, 2.69, 2047, 170, 95, 95, 160, 80, 52),
    "XW540-H260": (1310, 2.69, 1188, 145, 110, 110, 300, 80, 52),
    "PH42-020-S300": (2000, 1, 4500, 2920, 150, 150, 350, 80, 58),
    "PH54-100-S500": (2010, 1, 15900, 2920, 150, 150, 350, 80, 58),
    "PH54-200-S500": (2020, 1, 22740, 2900, 150, 150, 350, 80, None),
    "PM42-010-S260": (2100, 1, 1461, 2600, 150, 150, 350, 80, 58),
    "PM54-040-S250": (2110, 1, 4470, 2840, 150, 150, 350, 80, 58),
    "PM54-060-S250": (2120, 1, 7980, 2830, 150, 150, 350, 80, 58),
}
# Newer than the vendor's library.
NEWER = {"XM335-T323", "XM335-T332"}
WITHOUT_PAGE = {"XL-320", "XM335-T332"}
# The vendor's file repeats the X series' position range for this one; the manual has 0 … 1023.
OTHER_POSITION_RANGE = {"XL-320"}


def vendor_file(name: str) -> Path:
    return VENDOR / (name.lower().replace("-", "_").replace("xl_320", "xl320") + ".model")


def vendor_sections(name: str) -> dict[str, list[list[str]]]:
    sections: dict[str, list[list[str]]] = {}
    for line in vendor_file(name).read_text().splitlines():
        if line.startswith("["):
            current = sections.setdefault(line.strip("[]"), [])
        elif line.strip():
            current.append(line.split("\t"))
    return sections


with_vendor_file = [name for name in models() if vendor_file(name).exists()]


def test_the_vendor_describes_all_models() -> None:
    assert set(models()) - NEWER == set(with_vendor_file)


@pytest.mark.parametrize("name", with_vendor_file)
def test_every_register_is_where_the_vendor_s_library_has_it(name: str) -> None:
    theirs = {}
    for address, length, title in vendor_sections(name)["control table"][1:]:
        word = title.strip().lower()
        theirs[TRANSLATED.get(word, word.replace(" ", "_"))] = (int(address), int(length))
    registers = model(name).registers
    assert {n: (r.address, r.length) for n, r in registers.items() if n in theirs} == {
        n: place for n, place in theirs.items() if n in registers
    }
    unknown_to_them = set(registers) - set(theirs)
    assert unknown_to_them <= {"model_information", "secondary_id", "protocol_type"}


@pytest.mark.parametrize("name", with_vendor_file)
def test_position_and_velocity_units_are_the_vendor_s(name: str) -> None:
    sections = vendor_sections(name)
    registers = model(name).registers
    velocity = next(row for row in sections["unit info"][1:] if row[0] == "Present Velocity")
    assert isclose(registers["present_velocity"].to_si(1), float(velocity[1]), rel_tol=1e-3)
    if name in OTHER_POSITION_RANGE:
        return
    about = {row[0]: float(row[1]) for row in sections["type info"][1:]}
    position = registers["present_position"]
    assert position.to_si(int(about["value_of_zero_radian_position"])) == 0
    greatest = position.to_si(int(about["value_of_max_radian_position"]))
    assert isclose(greatest, about["max_radian"], rel_tol=1e-3)


def test_model_numbers_are_the_vendor_s() -> None:
    rows = [line.split("\t") for line in (VENDOR / "dynamixel.model").read_text().splitlines()[1:]]
    numbers = {file.strip(): int(number) for number, file in rows}
    for name in models():
        file = vendor_file(name).name
        if file in numbers:
            assert model(name).number == numbers[file]


def test_the_manual_s_page_of_every_model_was_typed_in() -> None:
    assert {*MANUAL, *WITHOUT_PAGE} == set(models())


@pytest.mark.parametrize("name", MANUAL)
def test_units_and_limits_are_those_of_the_model_s_page(name: str) -> None:
    number, milliamperes, current, velocity, low, least, high, degrees, shutdown = MANUAL[name]
    assert model(name).number == number
    registers = model(name).registers
    if milliamperes:
        for register in ("present_current", "goal_current", "current_limit"):
            assert registers[register].to_si(1) == pytest.approx(milliamperes / 1000)
            assert registers[register].unit == "A"
        assert registers["current_limit"].initial == current
        assert registers["current_limit"].bounds == (0, current)
    else:
        assert not {"present_current", "goal_current", "current_limit"} & set(registers)
        assert registers["present_load"].to_si(1000) == 1.0
    assert registers["velocity_limit"].initial == velocity
    assert registers["min_voltage_limit"].initial == low
    assert registers["max_voltage_limit"].initial == high
    assert registers["min_voltage_limit"].bounds == (least, high)
    assert registers["max_voltage_limit"].bounds == (least, high)
    assert registers["present_input_voltage"].to_si(121) == pytest.approx(12.1)
    assert registers["temperature_limit"].initial == degrees
    assert registers["temperature_limit"].bounds == (0, 100)
    assert registers["shutdown"].initial == shutdown


@pytest.mark.parametrize(
    ("name", "register", "least", "greatest"),
    [
        ("XM430-W350", "velocity_limit", 0, 1023),
        ("MX-64", "velocity_limit", 0, 1023),
        ("XL330-M077", "velocity_limit", 0, 2047),
        ("PM54-060-S250", "velocity_limit", 0, 2830),
        ("XH540-V270", "pwm_limit", 0, 885),
        ("PH42-020-S300", "pwm_limit", 0, 2009),
        ("XC330-T181", "baud_rate", 0, 6),
        ("XW540-H260", "baud_rate", 0, 7),
        ("XM335-T323", "baud_rate", 0, 6),
        ("XM335-T332", "velocity_limit", 0, 2047),
        ("PM42-010-S260", "baud_rate", 0, 9),
        ("XL-320", "baud_rate", 0, 3),
        ("XH430-V210", "homing_offset", -1_044_479, 1_044_479),
        ("PH54-100-S500", "homing_offset", -(2**31), 2**31 - 1),
        ("XC430-W240", "position_p_gain", 0, 16_383),
        ("PM54-040-S250", "position_p_gain", 0, 32_767),
        ("XL330-M288", "profile_velocity", 0, 32_767),
        ("PH42-020-S300", "max_position_limit", -303_750, 303_750),
        ("PH54-100-S500", "min_position_limit", -501_923, 501_923),
        ("PM42-010-S260", "max_position_limit", -263_187, 263_187),
        ("PM54-040-S250", "min_position_limit", -251_417, 251_417),
        ("PH54-200-S500", "acceleration_limit", 0, 3_992_644),
        ("PM42-010-S260", "moving_threshold", 0, 2600),
        ("XL-320", "goal_velocity", -1023, 1023),
    ],
)
def test_what_may_be_written_is_the_manual_s_range(
    name: str, register: str, least: int, greatest: int
) -> None:
    assert model(name).registers[register].bounds == (least, greatest)


@pytest.mark.parametrize(
    ("name", "stall_amperes"),
    [
        ("MX-64", 5.2),
        ("MX-106", 6.3),
        ("XM430-W350", 2.7),
        ("XH430-V350", 0.7),
        ("XM540-W270", 5.5),
        ("XH540-V270", 2.4),
    ],
)
def test_a_stalled_motor_stays_below_the_greatest_current_limit(
    name: str, stall_amperes: float
) -> None:
    limit = model(name).registers["current_limit"]
    assert stall_amperes < limit.to_si(limit.bounds[1]) < 1.4 * stall_amperes


def test_a_new_x335_runs_at_a_megabit_and_moves_by_half_a_turn() -> None:
    registers = model(1710).registers
    assert baud_rate(registers["baud_rate"].initial or 0) == 1_000_000
    assert registers["min_position_limit"].initial == 1024
    assert registers["max_position_limit"].initial == 3072


def test_a_model_whose_current_has_no_known_unit_tells_all_the_rest() -> None:
    registers = model(1700).registers
    assert registers["present_current"].unit == ""
    assert registers["present_position"] == XL330["present_position"]
    assert registers["present_input_voltage"].to_si(121) == pytest.approx(12.1)


def test_a_new_p_stops_short_of_half_a_turn() -> None:
    limits = {
        "PH42-020-S300": 303_454,
        "PH54-100-S500": 501_433,
        "PH54-200-S500": 501_433,
        "PM42-010-S260": 262_931,
        "PM54-040-S250": 251_173,
        "PM54-060-S250": 251_173,
    }
    for name, limit in limits.items():
        registers = model(name).registers
        assert registers["max_position_limit"].initial == limit
        assert registers["min_position_limit"].initial == -limit
        assert 3.13 < registers["max_position_limit"].to_si(limit) < pi


@pytest.mark.parametrize("name", models())
def test_registers_do_not_overlap_and_their_limits_fit_into_them(name: str) -> None:
    registers = sorted(model(name).registers.values(), key=lambda register: register.address)
    for before, after in pairwise(registers):
        assert before.address + before.length <= after.address
    for register in registers:
        for value in register.bounds:
            assert register.decode(register.encode(value)) == value
        if register.initial is not None:
            assert register.decode(register.encode(register.initial)) == register.initial


@pytest.mark.parametrize("name", models())
def test_what_diagnosis_needs_is_in_every_table(name: str) -> None:
    registers = model(name).registers
    for needed in (
        "model_number",
        "firmware_version",
        "id",
        "baud_rate",
        "return_delay_time",
        "status_return_level",
        "shutdown",
        "torque_enable",
        "hardware_error_status",
        "min_voltage_limit",
        "max_voltage_limit",
        "present_position",
        "present_velocity",
        "present_input_voltage",
        "present_temperature",
    ):
        assert needed in registers
    assert ("present_current" in registers) != ("present_load" in registers)


@pytest.mark.parametrize(
    ("register", "raw", "si"),
    [
        (XM430["present_position"], 2048, 0.0),
        (XM430["present_position"], 3072, pi / 2),
        (XM430["present_position"], -2048, -2 * pi),
        (XM430["present_current"], -100, -0.269),
        (model("XH430-V350").registers["current_limit"], 500, 0.67),
        (model("XL330-M288").registers["goal_current"], -450, -0.45),
        (model("MX-106").registers["goal_current"], 1000, 3.36),
        (XM430["present_input_voltage"], 121, 12.1),
        (XM430["present_temperature"], 36, 36.0),
        (XM430["goal_pwm"], 885, 1.0),
        (XM430["return_delay_time"], 250, 500e-6),
        (XM430["bus_watchdog"], 50, 1.0),
        (XM430["homing_offset"], 1024, pi / 2),
        (model("PH54-200-S500").registers["goal_velocity"], 6000, 2 * pi),
        (model("PH54-200-S500").registers["present_position"], 501923, pi),
        (XL320["present_position"], 512, 0.0),
        (XL320["present_load"], -500, -0.5),
        (model("XL430-W250").registers["present_load"], -500, -0.5),
    ],
)
def test_raw_values_become_si_and_back(register: Register, raw: int, si: float) -> None:
    assert register.to_si(raw) == pytest.approx(si)
    if register.access == "rw":
        assert register.from_si(si) == raw


@given(
    st.sampled_from([XM430, XL320, PH54, XL330]).flatmap(lambda r: st.sampled_from([*r.values()])),
    st.data(),
)
def test_every_allowed_value_survives_the_way_through_bytes_and_si(
    register: Register, data: st.DataObject
) -> None:
    raw = data.draw(st.integers(*register.bounds))
    assert register.decode(register.encode(raw)) == raw
    assert register.from_si(register.to_si(raw)) == raw


def test_a_value_beyond_the_limits_is_refused_with_what_is_allowed() -> None:
    with pytest.raises(ValueError, match=r"temperature_limit cannot be 200 °C: allowed is 0 … 100"):
        XM430["temperature_limit"].from_si(200)
    with pytest.raises(ValueError, match="present_position has 4 bytes, not 2"):
        XM430["present_position"].decode(b"\x00\x00")


def test_the_xl_320_keeps_the_direction_in_bit_10() -> None:
    velocity = XL320["present_velocity"]
    assert velocity.decode((1024 + 300).to_bytes(2, "little")) == -300
    assert velocity.decode((300).to_bytes(2, "little")) == 300
    assert velocity.encode(-300) == (1024 + 300).to_bytes(2, "little")
    with pytest.raises(OverflowError):
        velocity.encode(1024)


@pytest.mark.parametrize(
    "name", ["XM430-W350", "xm430-w350-t", "XM430_W350", "xm430w350", "XM430-W350-R"]
)
def test_a_model_is_found_however_its_name_is_written(name: str) -> None:
    assert model(name) is not None
    assert model(name).number == 1020
    assert model(1020).name == "XM430-W350"


def test_an_unknown_model_is_refused_and_similar_names_are_told() -> None:
    with pytest.raises(UnknownModel, match="similar are XM430-W350"):
        model("XM430-W355")
    with pytest.raises(UnknownModel, match="no model has the number 9999"):
        model(9999)


def test_the_stand_in_of_a_series_reads_all_but_currents() -> None:
    registers = generic(Series.X).registers
    assert registers["present_position"] == XM430["present_position"]
    assert registers["present_input_voltage"] == XM430["present_input_voltage"]
    assert (registers["present_current"].unit, registers["present_current"].scale) == ("", 1.0)
    assert generic(Series.XL320).registers["present_load"] == XL320["present_load"]
    with pytest.raises(UnknownModel):
        generic(Series.P)


def test_fast_sync_read_is_known_from_the_firmware_that_the_manual_names() -> None:
    firmware = {name: model(name).fast_sync_read_firmware for name in models()}
    assert firmware["XM430-W350"] == 45
    assert firmware["XL330-M288"] == 46
    assert firmware["PH54-200-S500"] == 12
    assert firmware["XM335-T323"] is None
    assert firmware["2XL430-W250"] is firmware["MX-28"] is firmware["XL-320"] is None


def test_baud_rates_go_both_ways() -> None:
    assert [baud_rate(raw) for raw in (1, 3, 7)] == [57_600, 1_000_000, 4_500_000]
    assert [baud_rate(raw) for raw in (8, 9)] == [6_000_000, 10_500_000]
    assert [baud_rate_register(baud_rate(raw)) for raw in range(10)] == list(range(10))
    with pytest.raises(ValueError, match="register is 10"):
        baud_rate(10)
    with pytest.raises(ValueError, match="123 bit/s"):
        baud_rate_register(123)


def test_errors_are_told_in_words() -> None:
    assert describe_error(0) == []
    assert describe_error(0x80) == ["alert: Hardware Error Status is set"]
    assert describe_error(0x84)[1].startswith("data range error")
    assert describe_error(0x7F) == ["unknown error number 127"]


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (1, "result fail"),
        (2, "instruction"),
        (3, "CRC"),
        (4, "data range"),
        (5, "data length"),
        (6, "data limit"),
        (7, "access"),
    ],
)
def test_error_numbers_are_those_of_the_thesis_table_1_5(number: int, name: str) -> None:
    (words,) = describe_error(number)
    assert words.startswith(name)


def test_hardware_errors_are_those_of_the_thesis_table_1_4() -> None:
    names = ["input voltage", "overheating", "motor encoder", "electrical shock", "overload"]
    assert hardware_errors(0b0011_1101) == names
    assert hardware_errors(0b1100_0010) == ["unknown bit 1", "unknown bit 6", "unknown bit 7"]


def test_hardware_errors_are_named_by_series() -> None:
    assert hardware_errors(0) == []
    assert hardware_errors(0b100101) == ["input voltage", "overheating", "overload"]
    assert hardware_errors(0b10) == ["unknown bit 1"]
    assert hardware_errors(0b10, Series.P) == ["motor Hall sensor"]
    assert hardware_errors(0b101, Series.XL320) == ["overload", "input voltage"]


def test_a_configured_model_may_be_a_series_and_must_be_known() -> None:
    assert configured("x330").name == "generic X330"
    assert configured("xm430-w210-t").name == "XM430-W210"
    for nobodys in ("XM999", "P", ""):
        with pytest.raises(UnknownModel):
            configured(nobodys)
