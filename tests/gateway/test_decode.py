"""Answers to SI units, whoever asked."""

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_gateway.decode import Decoder, blocks_read
from wackel_gateway.roster import Block, Roster
from wackel_node.config import ServoConfig
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import AnswerReader, Answers, Status, reader
from wackel_protocols.dynamixel2.expectation import Expectation, expect
from wackel_protocols.dynamixel2.fast import encode_fast

XM, XL320, XL430, PH = 1, 2, 3, 4
MODELS = {XM: "XM430-W210", XL320: "XL-320", XL430: "XL430-W250", PH: "PH54-200-S500"}


@pytest.fixture
def roster() -> Roster:
    return Roster([ServoConfig(id=servo_id, model=model) for servo_id, model in MODELS.items()])


def number(value: int, length: int) -> bytes:
    return value.to_bytes(length, "little", signed=True)


def said(*statuses: Status) -> Answers:
    return Answers(list(statuses))


def test_a_cycle_read_gives_position_velocity_and_current(roster: Roster) -> None:
    data = number(-10, 2) + number(100, 4) + number(3072, 4)
    (state,) = Decoder(roster).states(
        packet.sync_read([XM], 126, 10), said(Status(XM, 0, data, 21))
    )
    assert state.position == pytest.approx(pi / 2)
    assert state.velocity == pytest.approx(100 * 0.229 * 2 * pi / 60, rel=1e-3)
    assert state.current == pytest.approx(-10 * 2.69e-3)
    assert state.voltage is None
    assert (state.alert, state.error) == (False, 0)


def test_what_was_not_read_is_absent_and_what_was_is_in_si(roster: Roster) -> None:
    (state,) = Decoder(roster).states(
        packet.read(XM, 144, 3), said(Status(XM, 0x80, number(118, 2) + b"\x2a", 14))
    )
    assert state.voltage == pytest.approx(11.8)
    assert state.temperature == 42
    assert state.position is None
    assert state.alert


def test_torque_and_hardware_error_are_flags(roster: Roster) -> None:
    data = b"\x01\x00\x00\x00\x02\x00\x20"
    (state,) = Decoder(roster).states(packet.read(XM, 64, 7), said(Status(XM, 0, data, 18)))
    assert state.torque_enabled is True
    assert state.hardware_error == 0x20


def test_models_that_measure_load_report_load_not_current(roster: Roster) -> None:
    data = number(-500, 2) + number(0, 4) + number(2048, 4)
    (state,) = Decoder(roster).states(packet.read(XL430, 126, 10), said(Status(XL430, 0, data, 21)))
    assert state.current is None
    assert state.load == pytest.approx(-0.5)
    assert state.position == 0.0


def test_the_xl320_has_its_own_table_and_its_own_signs(roster: Roster) -> None:
    data = number(512, 2) + (1024 + 100).to_bytes(2, "little") + number(50, 2)
    (state,) = Decoder(roster).states(packet.read(XL320, 37, 6), said(Status(XL320, 0, data, 17)))
    assert state.position == 0.0
    assert state.velocity is not None
    assert state.velocity < 0
    assert state.load == pytest.approx(0.05)


def test_a_servo_that_refuses_is_reported_with_its_error_and_no_values(roster: Roster) -> None:
    for instruction in (packet.read(XM, 126, 10), packet.read(XM, 144, 3)):
        (state,) = Decoder(roster).states(instruction, said(Status(XM, 0x87, b"", 11)))
        assert (state.error, state.alert) == (7, True)
        assert state.position is None
        assert state.voltage is None


def test_half_of_a_register_is_not_decoded(roster: Roster) -> None:
    (state,) = Decoder(roster).states(packet.read(XM, 134, 2), said(Status(XM, 0, b"\0\0", 13)))
    assert state.position is None


def test_answers_to_writes_and_of_unknown_servos_give_no_state(roster: Roster) -> None:
    decoder = Decoder(roster)
    assert decoder.states(packet.write(XM, 64, b"\1"), said(Status(XM, 0, b"", 11))) == []
    assert decoder.states(packet.read(99, 132, 4), said(Status(99, 0, b"\0\0\0\0", 15))) == []


def test_every_reading_instruction_names_its_blocks() -> None:
    assert blocks_read(packet.read(7, 132, 4)) == [(7, 132, 4)]
    assert blocks_read(packet.fast_sync_read([7, 8], 132, 4)) == [(7, 132, 4), (8, 132, 4)]
    assert blocks_read(packet.bulk_read([(7, 132, 4), (8, 9, 1)])) == [(7, 132, 4), (8, 9, 1)]
    assert blocks_read(packet.ping(7)) == []


@given(st.binary(max_size=64), st.binary(max_size=12))
def test_no_instruction_and_no_answer_makes_it_stumble(parameters: bytes, data: bytes) -> None:
    decoder = Decoder(Roster([ServoConfig(id=XM)]))
    for kind in (0x02, 0x82, 0x8A, 0x92, 0x9A, 0x03):
        instruction = packet.InstructionPacket(XM, kind, parameters).encode()
        decoder.states(instruction, said(Status(XM, 0, data, 11 + len(data))))
        decoder.states(parameters, said(Status(XM, 0, data, 11 + len(data))))


def test_a_block_spans_the_registers_that_a_model_has(roster: Roster) -> None:
    table = roster.model(PH)
    assert table is not None
    assert Block.of(table, "present_current", "present_load", "present_position") == Block(574, 10)
    assert Block.of(table, "no_such_register") is None


def test_a_servo_is_what_it_says_and_an_unknown_number_changes_nothing() -> None:
    roster = Roster([ServoConfig(id=1, model="XM430-W210")])
    member = roster.members[1]
    member.identify(1020, 45)
    assert (member.model.name, member.knows_fast_sync_read) == ("XM430-W350", True)
    member.identify(54321, 1)
    assert (member.model.name, member.model_number) == ("XM430-W350", 54321)


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize(("error", "cut"), [(0, 10), (0x80, 10), (0, 9), (7, 0)])
def test_decoding_all_servos_together_gives_the_same_as_one_by_one(
    fast: bool, error: int, cut: int
) -> None:
    ids = (1, 2, 3)
    decoder = Decoder(Roster([ServoConfig(id=servo_id) for servo_id in ids]))
    data = [number(i, 2) + number(-i, 4) + number(1000 * i, 4) for i in ids]
    values = [(0, data[0]), (error, data[1][:cut]), (0, data[2])]
    instruction = (packet.fast_sync_read if fast else packet.sync_read)(ids, 126, 10)
    if fast:
        answer = encode_fast(expect(instruction), values)
    else:
        packets = zip(ids, values, strict=True)
        answer = b"".join(packet.StatusPacket(i, *value).encode() for i, value in packets)
    answers = reader(instruction).read(answer)
    assert (answers.reader is not None) == (cut == 10)
    together = decoder.states(instruction, answers)
    alone = [
        decoder.states(packet.read(status.id, 126, 10), said(status))[0]
        for status in answers.statuses
    ]
    assert together == alone
    assert fast or len(together) == 3


def test_answers_of_another_layout_are_not_taken_for_what_the_instruction_reads() -> None:
    ids = (1, 2)
    decoder = Decoder(Roster([ServoConfig(id=servo_id) for servo_id in ids]))
    refusals = b"".join(packet.StatusPacket(servo_id, 7).encode() for servo_id in ids)
    answers = AnswerReader(Expectation(ids, (packet.STATUS_BYTES,) * 2)).read(refusals)
    states = decoder.states(packet.sync_read(ids, 126, 10), answers)
    assert [(state.id, state.error, state.position) for state in states] == [
        (1, 7, None),
        (2, 7, None),
    ]
