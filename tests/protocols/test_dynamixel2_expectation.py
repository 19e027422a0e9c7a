import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocols.material import instruction_packets, packets
from wackel_protocols.dynamixel2 import Expectation, InstructionPacket, StatusPacket, expect
from wackel_protocols.dynamixel2 import packet as dxl
from wackel_protocols.dynamixel2.packet import Packet

NOTHING = Expectation()


@pytest.mark.parametrize(
    ("instruction", "expected", "total_bytes"),
    [
        (dxl.ping(7), Expectation((7,), (14,)), 14),
        (dxl.read(7, 132, 4), Expectation((7,), (15,)), 15),
        (dxl.write(7, 116, bytes(4)), Expectation((7,), (11,)), 11),
        (dxl.reboot(7), Expectation((7,), (11,)), 11),
        (dxl.sync_read([3, 1, 2], 132, 4), Expectation((3, 1, 2), (15, 15, 15)), 45),
        (dxl.bulk_read([(3, 132, 4), (1, 146, 1)]), Expectation((3, 1), (15, 12)), 27),
        (dxl.fast_sync_read([3, 1], 132, 4), Expectation((3, 1), (8, 8), fast=True), 24),
        (
            dxl.fast_bulk_read([(3, 132, 4), (1, 146, 1)]),
            Expectation((3, 1), (8, 5), fast=True),
            21,
        ),
        (dxl.ping(254), Expectation(broadcast_ping=True), 0),
    ],
)
def test_an_instruction_tells_which_servos_answer_and_how_long(
    instruction: bytes, expected: Expectation, total_bytes: int
) -> None:
    assert expect(instruction) == expected
    assert expect(instruction).total_bytes == total_bytes


def test_data_lengths_are_those_that_were_asked_for() -> None:
    assert expect(dxl.bulk_read([(3, 132, 4), (1, 146, 1)])).data_lengths == (4, 1)
    assert expect(dxl.fast_bulk_read([(3, 132, 4), (1, 146, 1)])).data_lengths == (4, 1)


@pytest.mark.parametrize(
    "instruction",
    [
        dxl.write(254, 116, bytes(4)),
        dxl.read(254, 132, 4),
        dxl.reboot(254),
        dxl.sync_write(116, 4, {1: bytes(4)}),
        dxl.bulk_write([(1, 116, bytes(4))]),
    ],
)
def test_a_broadcast_that_is_neither_ping_nor_a_read_of_several_is_not_answered(
    instruction: bytes,
) -> None:
    assert expect(instruction) == NOTHING


@pytest.mark.parametrize(
    "instruction",
    [
        b"",
        dxl.ping(7)[:-1],
        dxl.ping(7)[:-1] + b"\x00",
        StatusPacket(7).encode(),
        InstructionPacket(7, dxl.Instruction.READ, b"\x84\x00").encode(),
        InstructionPacket(7, dxl.Instruction.READ, b"\x84\x00\xff\xff").encode(),
        InstructionPacket(254, dxl.Instruction.SYNC_READ, b"\x84\x00\x04\x00").encode(),
        InstructionPacket(254, dxl.Instruction.SYNC_READ, b"\x84\x00\x04\x00\x01\x01").encode(),
        InstructionPacket(254, dxl.Instruction.SYNC_READ, b"\x84\x00\x04\x00\xfe").encode(),
        InstructionPacket(254, dxl.Instruction.BULK_READ, b"\x01\x84\x00\x04").encode(),
        InstructionPacket(254, dxl.Instruction.BULK_READ).encode(),
        InstructionPacket(
            254, dxl.Instruction.FAST_SYNC_READ, b"\x00\x00\xff\x7f" + bytes(range(3))
        ).encode(),
        InstructionPacket(7, dxl.Instruction.SYNC_READ, b"\x84\x00\x04\x00\x01").encode(),
    ],
)
def test_nothing_is_expected_of_malformed_instructions(instruction: bytes) -> None:
    assert expect(instruction) == NOTHING


def test_the_status_return_level_silences_what_it_says() -> None:
    answered = {
        level: [
            bool(expect(instruction, level).ids)
            for instruction in (
                dxl.ping(1),
                dxl.read(1, 132, 4),
                dxl.sync_read([1], 132, 4),
                dxl.write(1, 64, b"\x01"),
            )
        ]
        for level in (0, 1, 2)
    }
    assert answered == {
        0: [True, False, False, False],
        1: [True, True, True, False],
        2: [True, True, True, True],
    }


@given(packets | instruction_packets, st.integers(0, 2))
def test_any_packet_whatever_has_an_expectation(packet: Packet, level: int) -> None:
    expectation = expect(packet.encode(), level)
    assert len(expectation.ids) == len(expectation.lengths)
    assert expectation.total_bytes >= 11 * len(expectation.ids) or expectation.fast
