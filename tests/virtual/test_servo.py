"""What one servo does with the instructions of Protocol 2.0, as the e-manual says."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.virtual.material import MS, ask, ask_one, bus, chain, ids, statuses
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.control_table import model, models
from wackel_protocols.dynamixel2.packet import FactoryReset, InstructionPacket
from wackel_virtual import VirtualBus
from wackel_virtual.servo import BOOT_NS
from wackel_virtual.table import (
    ACCESS,
    CRC_ERROR,
    DATA_LENGTH,
    DATA_LIMIT,
    DATA_RANGE,
    INSTRUCTION_ERROR,
    RESULT_FAIL,
)

X = model("XM430-W210").registers


def write(on, name, raw, servo=1):
    return ask_one(on, packet.write(servo, X[name].address, X[name].encode(raw))).error


def read(on, name, servo=1):
    status = ask_one(on, packet.read(servo, X[name].address, X[name].length))
    return X[name].decode(status.parameters)


def wait(on, seconds):
    on.advance(on.now_ns + round(seconds * 1e9))


@pytest.mark.parametrize("name", models())
def test_every_model_of_the_control_tables_answers_a_ping_with_its_number(name):
    on = bus(1, model=name)
    status = ask_one(on, packet.ping(1))
    assert int.from_bytes(status.parameters[:2], "little") == model(name).number
    assert status.error == 0


def test_a_series_in_place_of_a_model_gives_its_stand_in():
    on = bus(1, model="X")
    assert ask_one(on, packet.ping(1)).error == 0


@pytest.mark.parametrize(
    ("name", "raw", "error"),
    [
        ("torque_enable", 2, DATA_RANGE),
        ("return_delay_time", 255, DATA_RANGE),
        ("operating_mode", 2, DATA_RANGE),
        ("goal_position", 4096, DATA_LIMIT),
        ("goal_velocity", 331, DATA_LIMIT),
        ("goal_current", -1194, DATA_LIMIT),
        ("present_position", 0, ACCESS),
        ("goal_position", 4095, 0),
    ],
)
def test_a_write_is_answered_with_the_error_of_the_manual(name, raw, error):
    assert write(bus(1), name, raw) == error


def test_a_write_of_too_few_bytes_is_a_length_error_and_changes_nothing():
    on = bus(1)
    before = read(on, "goal_position")
    assert ask_one(on, packet.write(1, X["goal_position"].address, b"\1\2")).error == DATA_LENGTH
    assert read(on, "goal_position") == before


def test_where_one_of_several_registers_is_refused_none_is_written():
    on = bus(1)
    data = b"\1" + b"\7"  # torque on, LED on; then a bad torque value
    assert ask_one(on, packet.write(1, X["torque_enable"].address, data)).error == 0
    assert ask_one(on, packet.write(1, X["torque_enable"].address, b"\0\0\0")).error == ACCESS
    assert read(on, "torque_enable") == 1


def test_a_read_beyond_the_control_table_is_an_access_error_without_data():
    status = ask_one(bus(1), packet.read(1, 2000, 4))
    assert (status.error, status.parameters) == (ACCESS, b"")


def test_eeprom_is_locked_while_torque_is_on():
    on = bus(1)
    assert write(on, "return_delay_time", 10) == 0
    assert write(on, "torque_enable", 1) == 0
    assert write(on, "return_delay_time", 20) == ACCESS
    assert read(on, "return_delay_time") == 10


def test_reboot_keeps_eeprom_resets_ram_and_takes_a_while():
    on = bus(1)
    write(on, "return_delay_time", 10)
    write(on, "torque_enable", 1)
    write(on, "led", 1)
    assert ask_one(on, packet.reboot(1)).error == 0
    assert ask(on, packet.ping(1)) == []
    on.advance(on.now_ns + BOOT_NS)
    assert read(on, "return_delay_time") == 10
    assert read(on, "torque_enable") == read(on, "led") == 0


@pytest.mark.parametrize(
    ("option", "servo_id", "baud_rate"),
    [
        (FactoryReset.ALL, 1, 57_600),
        (FactoryReset.EXCEPT_ID, 7, 57_600),
        (FactoryReset.EXCEPT_ID_AND_BAUD_RATE, 7, 1_000_000),
    ],
)
def test_factory_reset_spares_what_its_option_says(option, servo_id, baud_rate):
    on = bus(1)
    assert write(on, "id", 7) == 0
    assert ask_one(on, packet.factory_reset(7, option)).id == 7
    on.advance(on.now_ns + BOOT_NS)
    chunks = on.exchange(on.now_ns + MS, packet.ping(servo_id), 20 * MS, baud_rate)
    assert ids(chunks) == [servo_id]


def test_factory_reset_of_everything_for_all_servos_is_not_obeyed():
    on = bus(2)
    ask(on, packet.factory_reset(packet.BROADCAST_ID, FactoryReset.ALL))
    assert ask_one(on, packet.ping(2)).id == 2


def test_a_registered_write_waits_for_action():
    on = bus(1)
    goal = X["goal_position"]
    assert ask_one(on, packet.reg_write(1, goal.address, goal.encode(1234))).error == 0
    assert read(on, "registered_instruction") == 1
    assert read(on, "goal_position") != 1234
    assert ask_one(on, packet.action(1)).error == 0
    assert read(on, "goal_position") == 1234
    assert read(on, "registered_instruction") == 0


def test_action_without_registered_write_is_an_instruction_error():
    assert ask_one(bus(1), packet.action(1)).error == INSTRUCTION_ERROR


def test_an_unknown_instruction_is_an_instruction_error():
    assert ask_one(bus(1), InstructionPacket(1, 0x77).encode()).error == INSTRUCTION_ERROR


def test_an_instruction_with_a_wrong_crc_is_answered_by_the_servo_it_names():
    damaged = bytearray(packet.write(2, 64, b"\1"))
    damaged[-1] ^= 1
    on = bus(3)
    status = ask_one(on, bytes(damaged))
    assert (status.id, status.error) == (2, CRC_ERROR)
    assert read(on, "torque_enable", servo=2) == 0


@pytest.mark.parametrize(("level", "answered"), [(0, "p"), (1, "pr"), (2, "prw")])
def test_status_return_level_says_what_is_answered(level, answered):
    on = bus(1)
    ask(on, packet.write(1, X["status_return_level"].address, bytes((level,))))
    assert bool(ids(ask(on, packet.ping(1)))) == ("p" in answered)
    assert bool(ids(ask(on, packet.read(1, 132, 4)))) == ("r" in answered)
    assert bool(ids(ask(on, packet.sync_read([1], 132, 4)))) == ("r" in answered)
    assert bool(ids(ask(on, packet.write(1, 65, b"\1")))) == ("w" in answered)


def test_a_new_id_is_answered_under_the_old_one():
    on = bus(1)
    assert ask_one(on, packet.write(1, X["id"].address, b"\x09")).id == 1
    assert ask_one(on, packet.ping(9)).id == 9
    assert ask(on, packet.ping(1)) == []


def test_a_servo_hears_only_its_own_baud_rate():
    on = bus(2)
    assert write(on, "baud_rate", 3) == 0
    assert write(on, "baud_rate", 4, servo=2) == 0
    assert ids(ask(on, packet.ping(2))) == []
    assert ids(on.exchange(on.now_ns + MS, packet.ping(2), 5 * MS, 2_000_000)) == [2]


def test_the_shaft_goes_to_its_goal_at_limited_velocity():
    on = bus(1)
    write(on, "torque_enable", 1)
    start = read(on, "present_position")
    write(on, "profile_velocity", 100)
    write(on, "goal_position", 4000)
    wait(on, 0.5)
    halfway = read(on, "present_position")
    # 100 · 0.229 rev/min for half a second is 782 pulses.
    assert 700 < halfway - start < 830
    assert read(on, "present_velocity") == 100
    assert read(on, "moving") == 1
    wait(on, 4.0)
    assert read(on, "present_position") == 4000
    assert read(on, "moving") == 0


def test_in_velocity_mode_the_shaft_turns_and_clear_forgets_whole_revolutions():
    on = bus(1)
    write(on, "operating_mode", 1)
    write(on, "torque_enable", 1)
    write(on, "goal_velocity", 200)
    wait(on, 5.0)
    assert read(on, "present_position") > 3 * 4096
    assert ask_one(on, packet.clear(1)).error == RESULT_FAIL  # not while it turns
    write(on, "goal_velocity", 0)
    wait(on, 1.0)
    assert ask_one(on, packet.clear(1)).error == 0
    assert 0 <= read(on, "present_position") < 4096


def test_without_torque_the_shaft_stays_where_it_is():
    on = bus(1)
    before = read(on, "present_position")
    write(on, "goal_position", 4000)
    wait(on, 1.0)
    assert read(on, "present_position") == before


def test_the_bus_watchdog_stops_a_servo_that_hears_nothing():
    on = bus(1)
    write(on, "operating_mode", 1)
    write(on, "torque_enable", 1)
    write(on, "bus_watchdog", 5)  # 100 ms
    write(on, "goal_velocity", 200)
    wait(on, 2.0)
    assert read(on, "bus_watchdog") == -1
    stopped = read(on, "present_position")
    assert write(on, "goal_velocity", 100) == DATA_RANGE
    wait(on, 1.0)
    assert abs(read(on, "present_position") - stopped) < 3
    assert write(on, "bus_watchdog", 0) == 0
    assert write(on, "goal_velocity", 100) == 0


def test_indirect_data_reads_and_writes_what_its_addresses_point_at():
    on = bus(1)
    pointers = [132, 133, 134, 135, 65]
    data = b"".join(address.to_bytes(2, "little") for address in pointers)
    assert ask_one(on, packet.write(1, 168, data)).error == 0
    position = X["present_position"].encode(read(on, "present_position"))
    assert ask_one(on, packet.write(1, 228, b"\1")).error == 0
    assert read(on, "led") == 1
    assert ask_one(on, packet.read(1, 224, 5)).parameters == position + b"\1"


def test_a_backup_brings_back_the_control_table():
    on = bus(1)
    write(on, "homing_offset", 55)
    assert ask_one(on, packet.control_table_backup(1)).error == 0
    write(on, "homing_offset", 0)
    assert ask_one(on, packet.control_table_backup(1, packet.Backup.RESTORE)).error == 0
    on.advance(on.now_ns + BOOT_NS)
    assert read(on, "homing_offset") == 55


def test_measured_values_are_plausible():
    on = VirtualBus(chain(12), 3)
    for servo in (1, 12):
        assert 115 <= read(on, "present_input_voltage", servo) <= 120
        assert 25 <= read(on, "present_temperature", servo) <= 40
        assert abs(read(on, "present_current", servo)) < 10
    assert read(on, "present_input_voltage", 12) <= read(on, "present_input_voltage", 1)


@given(
    st.integers(0, 0xFF).filter(lambda i: i != 0x55),
    st.binary(max_size=24),
    st.sampled_from([1, packet.BROADCAST_ID]),
)
def test_any_instruction_with_any_parameters_leaves_a_servo_that_answers(number, data, target):
    on = bus(2)
    ask(on, InstructionPacket(target, number, data).encode())
    on.advance(on.now_ns + BOOT_NS)
    found = {
        status.id
        for rate in (57_600, 1_000_000)
        for status in statuses(
            on.exchange(on.now_ns + MS, packet.ping(packet.BROADCAST_ID), 900 * MS, rate)
        )
    }
    changed = number in (0x03, 0x04, 0x83, 0x93, 0x06)  # may have changed ids and baud rates
    assert found == {1, 2} or changed
