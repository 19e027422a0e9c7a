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
    generic,
    models,
)
from wackel_protocols.dynamixel2.errors import describe_error, hardware_errors

VENDOR = Path(dynamixel_easy_sdk.__file__).parent / "control_table"
XM430 = model("XM430-W350").registers
XL320 = model("XL-320").registers
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
    assert set(models()) == set(with_vendor_file)


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


@given(st.sampled_from(list(XM430.values()) + list(XL320.values())), st.data())
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
    assert firmware["2XL430-W250"] is firmware["MX-28"] is firmware["XL-320"] is None


def test_baud_rates_go_both_ways() -> None:
    assert [baud_rate(raw) for raw in (1, 3, 7)] == [57_600, 1_000_000, 4_500_000]
    assert [baud_rate_register(baud_rate(raw)) for raw in range(8)] == list(range(8))
    with pytest.raises(ValueError, match="register is 8"):
        baud_rate(8)
    with pytest.raises(ValueError, match="123 bit/s"):
        baud_rate_register(123)


def test_errors_are_told_in_words() -> None:
    assert describe_error(0) == []
    assert describe_error(0x80) == ["alert: Hardware Error Status is set"]
    assert describe_error(0x84)[1].startswith("data range error")
    assert describe_error(0x7F) == ["unknown error number 127"]


def test_hardware_errors_are_named_by_series() -> None:
    assert hardware_errors(0) == []
    assert hardware_errors(0b100101) == ["input voltage", "overheating", "overload"]
    assert hardware_errors(0b10) == ["unknown bit 1"]
    assert hardware_errors(0b10, Series.P) == ["motor Hall sensor"]
    assert hardware_errors(0b101, Series.XL320) == ["overload", "input voltage"]
