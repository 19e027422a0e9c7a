import re

import pytest
from dynamixel_sdk import PacketHandler
from hypothesis import example, given
from hypothesis import strategies as st

from tests.protocols.material import (
    Wire,
    bitwise_crc,
    ids,
    instruction_packets,
    nasty_bytes,
    packets,
    status_packets,
    vectors,
)
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.packet import (
    CrcError,
    HeaderError,
    IdError,
    InstructionError,
    InstructionPacket,
    LengthError,
    Packet,
    PacketError,
    StatusPacket,
    decode,
)
from wackel_protocols.dynamixel2.stuffing import stuff, unstuff

PING = bytes.fromhex("fffffd0001030001194e")


vendor = PacketHandler(2.0)


def vendor_encodes(instruction: InstructionPacket) -> bytes:
    body = [instruction.instruction, *instruction.parameters]
    length = len(body) + 2
    wire = Wire()
    vendor.txPacket(wire, [0, 0, 0, 0, instruction.id, length & 0xFF, length >> 8, *body, 0, 0])
    return wire.written


def test_every_published_packet_is_decoded_as_published_and_encodes_to_the_same_bytes() -> None:
    for vector in vectors():
        data = bytes.fromhex(vector["bytes_hex"])
        parameters = bytes.fromhex(vector["params_hex"])
        expected: Packet
        if vector["kind"] == "status":
            expected = StatusPacket(vector["id"], vector["error"], parameters)
        else:
            expected = InstructionPacket(vector["id"], vector["instruction"], parameters)
        assert decode(data) == expected, vector["source"]
        assert expected.encode() == data, vector["source"]


@pytest.mark.parametrize(
    ("built", "on_the_wire"),
    [
        (packet.ping(1), "fffffd0001030001194e"),
        (packet.ping(254), "fffffd00fe0300013142"),
        (packet.read(1, 132, 4), "fffffd0001070002840004001d15"),
        (packet.write(1, 116, (512).to_bytes(4, "little")), "fffffd0001090003740000020000ca89"),
        (packet.reg_write(1, 104, (200).to_bytes(4, "little")), "fffffd00010900046800c8000000ae8e"),
        (packet.action(1), "fffffd000103000502ce"),
        (packet.factory_reset(1, packet.FactoryReset.EXCEPT_ID), "fffffd000104000601a1e6"),
        (packet.reboot(1), "fffffd00010300082f4e"),
        (packet.clear(1), "fffffd00010800100144584c22b1dc"),
        (packet.control_table_backup(1), "fffffd0001080020014354524c16f5"),
        (
            packet.control_table_backup(1, packet.Backup.RESTORE),
            "fffffd0001080020024354524c",
        ),
        (packet.sync_read([1, 2], 132, 4), "fffffd00fe090082840004000102cefa"),
        (packet.fast_sync_read([3, 7, 4], 132, 4), "fffffd00fe0a008a8400040003070420f2"),
        (
            packet.sync_write(
                116, 4, {1: (150).to_bytes(4, "little"), 2: (170).to_bytes(4, "little")}
            ),
            "fffffd00fe11008374000400019600000002aa0000008287",
        ),
        (
            packet.bulk_read([(1, 144, 2), (2, 146, 1)]),
            "fffffd00fe0d0092019000020002920001001a05",
        ),
        (
            packet.fast_bulk_read([(3, 132, 4), (7, 124, 2), (4, 146, 1)]),
            "fffffd00fe12009a0384000400077c0002000492000100",
        ),
        (
            packet.bulk_write([(1, 32, b"\xa0\x00"), (2, 31, b"\x50")]),
            "fffffd00fe1000930120000200a000021f00010050b768",
        ),
    ],
)
def test_the_builders_make_the_examples_of_the_manual(built: bytes, on_the_wire: str) -> None:
    # Two examples of the manual (restore, fast bulk read) have a misprinted CRC; of those the bytes
    # before it are compared.
    expected = bytes.fromhex(on_the_wire)
    assert built[: len(expected)] == expected
    assert len(built) - len(expected) in (0, 2)
    assert bitwise_crc(built[:-2]) == int.from_bytes(built[-2:], "little")


def test_the_answer_to_a_ping_is_that_of_the_thesis_table_1_3() -> None:
    data = bytes.fromhex("fffffd000107005500060426655d")
    assert decode(data) == StatusPacket(1, 0, b"\x06\x04\x26")
    assert StatusPacket(1, 0, b"\x06\x04\x26").encode() == data


@given(packets)
def test_what_is_encoded_decodes_to_the_same(original: Packet) -> None:
    assert decode(original.encode()) == original


def test_a_run_that_begins_in_the_error_byte_is_stuffed_like_any_other() -> None:
    status = StatusPacket(1, 0xFF, b"\xff\xfd\x07")
    assert status.encode()[8:-2] == b"\xff\xff\xfd\xfd\x07"
    assert decode(status.encode()) == status


@given(st.binary(max_size=300))
def test_the_crc_is_the_manual_s(data: bytes) -> None:
    assert packet.crc(data) == bitwise_crc(data)


@given(nasty_bytes)
@example(b"\xff\xff\xff\xff\xfd\xfd")
def test_stuffing_leaves_no_run_that_could_be_a_header_and_is_undone_exactly(body: bytes) -> None:
    stuffed = stuff(body)
    assert unstuff(stuffed) == body
    assert not re.search(rb"\xff\xff\xfd(?!\xfd)", stuffed)


@pytest.mark.parametrize(
    ("meant", "stuffed"),
    [
        ("fffffd", "fffffdfd"),
        ("fffffffd", "fffffffdfd"),
        ("fffffdfd", "fffffdfdfd"),
        ("fffffdfffffd", "fffffdfdfffffdfd"),
        ("fffffd00fffffd", "fffffdfd00fffffdfd"),
        ("ffff", "ffff"),
    ],
)
def test_stuffing_follows_each_run_by_one_fd(meant: str, stuffed: str) -> None:
    assert stuff(bytes.fromhex(meant)).hex() == stuffed
    assert unstuff(bytes.fromhex(stuffed)).hex() == meant


def test_a_run_without_its_fd_is_kept_as_it_stands() -> None:
    assert unstuff(b"\x01\xff\xff\xfd\x02") == b"\x01\xff\xff\xfd\x02"


@given(instruction_packets)
def test_the_vendor_s_library_sends_what_we_send_and_unstuffed_runs_are_understood(
    instruction: InstructionPacket,
) -> None:
    theirs = vendor_encodes(instruction)
    body = bytes([instruction.instruction]) + instruction.parameters
    if b"\xff\xff\xfd" not in body:
        assert theirs == instruction.encode()
    elif b"\xff\xff\xfd\xfd" not in body:
        # Its txPacket drops the result of its own stuffing.
        assert decode(theirs) == instruction


def runs(status: StatusPacket) -> int:
    return (bytes([status.error]) + status.parameters).count(b"\xff\xff\xfd")


@given(status_packets.filter(lambda status: runs(status) < 2))
def test_the_vendor_s_library_reads_what_we_encode(status: StatusPacket) -> None:
    # With two runs in one packet its unstuffing loses a byte.
    received, result = vendor.rxPacket(Wire(status.encode()), False)
    assert result == 0
    assert received[4] == status.id
    assert received[8] == status.error
    assert bytes(received[9 : 9 + len(status.parameters)]) == status.parameters


@given(ids, st.integers(0, 255))
def test_the_error_byte_is_alert_and_number(servo_id: int, error: int) -> None:
    status = StatusPacket(servo_id, error)
    assert status.alert == (error >= 0x80)
    assert status.error_number == error % 0x80


@pytest.mark.parametrize(
    ("data", "error", "actual", "expected"),
    [
        (b"\xff\xff\xfe" + PING[3:], HeaderError, b"\xff\xff\xfe\x00", packet.HEADER),
        (b"", HeaderError, b"", packet.HEADER),
        (PING[:9], LengthError, 9, "at least 10 bytes"),
        (PING + b"\x00", LengthError, 11, 10),
        (PING[:4] + b"\xfd" + PING[5:], IdError, 0xFD, "0 … 252 or 254"),
        (PING[:5] + b"\x02" + PING[6:], LengthError, 2, "at least 3"),
        (PING[:7] + b"\x55" + PING[8:], LengthError, 3, "at least 4"),
        (PING[:-1] + b"\x4f", CrcError, 0x4F19, 0x4E19),
    ],
)
def test_a_refused_packet_says_what_was_found_and_what_was_expected(
    data: bytes, error: type[PacketError], actual: object, expected: object
) -> None:
    with pytest.raises(error) as refused:
        decode(data)
    assert (refused.value.actual, refused.value.expected) == (actual, expected)


@given(st.binary(max_size=30) | nasty_bytes.map(lambda tail: packet.HEADER + tail))
def test_any_bytes_are_either_a_packet_or_refused(data: bytes) -> None:
    try:
        decode(data)
    except PacketError as refused:
        assert str(refused)


def test_values_that_fit_into_no_packet_are_refused() -> None:
    with pytest.raises(IdError):
        packet.ping(253)
    with pytest.raises(IdError):
        packet.sync_read([1, 254], 132, 4)
    with pytest.raises(IdError):
        packet.bulk_read([(1, 132, 4), (1, 144, 2)])
    with pytest.raises(LengthError):
        packet.sync_write(116, 4, {1: b"\x00"})
    with pytest.raises(LengthError):
        packet.read(1, 70000, 4)
    with pytest.raises(LengthError):
        packet.write(1, 0, bytes(70000))
    with pytest.raises(InstructionError):
        InstructionPacket(1, 0x55).encode()
    with pytest.raises(InstructionError):
        InstructionPacket(1, 256).encode()
