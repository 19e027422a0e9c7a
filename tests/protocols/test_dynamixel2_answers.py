import pytest
from dynamixel_sdk import GroupSyncRead, PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from tests.protocols.material import Wire, assert_tiles, nasty_bytes
from wackel_protocols.dynamixel2 import (
    AnswerReader,
    Answers,
    Expectation,
    Kind,
    StatusPacket,
    expect,
    reader,
)
from wackel_protocols.dynamixel2 import packet as dxl
from wackel_protocols.dynamixel2.fast import encode_fast, parse_fast

IDS = [3, 7, 4]
SYNC = dxl.sync_read(IDS, 132, 4)
FAST = dxl.fast_sync_read(IDS, 132, 4)
VALUES = [(0, b"\xa6\x00\x00\x00"), (0, b"\x1f\x08\x00\x00"), (0, b"\xff\x03\x00\x00")]
HEALTHY = b"".join(
    StatusPacket(i, error, data).encode() for i, (error, data) in zip(IDS, VALUES, strict=True)
)
FAST_HEALTHY = bytes.fromhex(  # the manual's example
    "fffffd00fe1900550003a600000084080007 1f08000016ca0004ff030000d19e"
)


def summary(answers: Answers) -> list[tuple[int, int, bytes]]:
    return [(status.id, status.error, status.parameters) for status in answers.statuses]


def expected_summary() -> list[tuple[int, int, bytes]]:
    return [(i, error, data) for i, (error, data) in zip(IDS, VALUES, strict=True)]


@pytest.mark.parametrize(
    ("instruction", "data", "ends"),
    [(SYNC, HEALTHY, [15, 30, 45]), (FAST, FAST_HEALTHY, [16, 24, 32])],
)
def test_a_healthy_answer_is_clean_and_complete(
    instruction: bytes, data: bytes, ends: list[int]
) -> None:
    answers = reader(instruction).read(data)
    assert answers.clean
    assert answers.segments is None
    assert (answers.missing, answers.unexpected) == ((), ())
    assert summary(answers) == expected_summary()
    assert [status.end for status in answers.statuses] == ends


def test_a_single_answer_is_read_like_any_other() -> None:
    answers = reader(dxl.ping(1)).read(StatusPacket(1, 0, b"\x06\x04\x26").encode())
    assert answers.clean
    assert summary(answers) == [(1, 0, b"\x06\x04\x26")]


def test_alert_and_error_number_are_content_not_damage() -> None:
    data = b"".join(StatusPacket(i, 0x84, bytes(4)).encode() for i in IDS)
    answers = reader(SYNC).read(data)
    assert answers.clean
    assert [status.error for status in answers.statuses] == [0x84] * 3


def test_stuffed_answers_are_as_clean_as_others() -> None:
    values = [b"\xff\xff\xfd\x00", b"\xff\xff\xfd\xfd", b"\x00\xff\xff\xfd"]
    data = b"".join(StatusPacket(i, 0, v).encode() for i, v in zip(IDS, values, strict=True))
    answers = reader(SYNC).read(data)
    assert answers.clean
    assert [status.parameters for status in answers.statuses] == values
    assert answers.statuses[-1].end == len(data)


def test_an_answer_of_the_right_length_with_too_few_unstuffed_parameters_is_not_clean() -> None:
    # FF FF FD FD on the wire is three bytes of data, one less than asked for.
    answers = reader(dxl.read(3, 132, 4)).read(StatusPacket(3, 0, b"\xff\xff\xfd").encode())
    assert not answers.clean
    assert summary(answers) == [(3, 0, b"\xff\xff\xfd")]


def test_a_stray_zero_costs_no_answer_but_is_accounted_for() -> None:
    answers = reader(SYNC).read(b"\x00" + HEALTHY)
    assert not answers.clean
    assert answers.segments is not None
    assert [segment.kind for segment in answers.segments] == [Kind.ZEROS] + [Kind.PACKET] * 3
    assert answers.missing == ()
    assert summary(answers) == expected_summary()


def test_silence_leaves_all_missing_in_the_order_of_the_request() -> None:
    answers = reader(SYNC).read(b"")
    assert answers.missing == (3, 7, 4)
    assert answers.segments == []
    assert not answers.clean


def test_a_damaged_answer_is_missing_and_the_others_stay() -> None:
    damaged = HEALTHY[:24] + b"\x99" + HEALTHY[25:]
    answers = reader(SYNC).read(damaged)
    assert answers.missing == (7,)
    assert [status.id for status in answers.statuses] == [3, 4]


def test_a_stranger_and_a_second_answer_are_unexpected() -> None:
    stranger = StatusPacket(9, 0, bytes(4)).encode()
    answers = reader(SYNC).read(HEALTHY + stranger + HEALTHY[:15])
    assert summary(answers) == expected_summary()
    assert [status.id for status in answers.unexpected] == [9, 3]


def test_answers_in_another_order_are_answers_but_not_clean() -> None:
    answers = reader(SYNC).read(HEALTHY[15:] + HEALTHY[:15])
    assert not answers.clean
    assert answers.missing == ()
    assert [status.id for status in answers.statuses] == [7, 4, 3]


def test_an_error_without_data_is_an_answer_but_not_clean() -> None:
    refusal = StatusPacket(3, 7).encode()
    answers = reader(dxl.read(3, 132, 4)).read(refusal)
    assert not answers.clean
    assert answers.missing == ()
    assert summary(answers) == [(3, 7, b"")]


def test_where_nothing_is_expected_silence_is_clean_and_bytes_are_not() -> None:
    write = dxl.sync_write(116, 4, {1: bytes(4)})
    assert reader(write).read(b"").clean
    assert not reader(write).read(b"\x00").clean
    assert [s.id for s in reader(write).read(HEALTHY[:15]).unexpected] == [3]


def test_a_broadcast_ping_is_clean_if_servos_answer_in_ascending_order_and_nothing_else() -> None:
    ping = reader(dxl.ping(254))
    one, two = (StatusPacket(i, 0, b"\x06\x04\x26").encode() for i in (1, 2))
    answers = ping.read(one + two)
    assert answers.clean
    assert [status.id for status in answers.statuses] == [1, 2]
    assert not ping.read(two + one).clean
    assert not ping.read(one + b"\x00" + two).clean
    assert not ping.read(b"").clean
    assert ping.read(b"").missing == ()


def test_the_vendor_s_group_sync_read_finds_the_same_data() -> None:
    wire = Wire(HEALTHY)
    group = GroupSyncRead(wire, PacketHandler(2.0), 132, 4)
    for servo_id in IDS:
        group.addParam(servo_id)
    assert group.rxPacket() == 0
    theirs = [int(group.getData(servo_id, 132, 4)) for servo_id in IDS]
    ours = reader(SYNC).read(HEALTHY).statuses
    assert [int.from_bytes(status.parameters, "little") for status in ours] == theirs


def test_the_chained_crcs_of_the_manual_s_examples_are_right() -> None:
    sync = parse_fast(FAST_HEALTHY, expect(FAST))
    assert sync.ok
    assert [entry.parameters for entry in sync.entries] == [data for _, data in VALUES]
    bulk = parse_fast(
        bytes.fromhex("fffffd00fe1400550003a600000067a40007a501247400041fd9c1"),
        expect(dxl.fast_bulk_read([(3, 132, 4), (7, 124, 2), (4, 146, 1)])),
    )
    assert bulk.ok
    assert [entry.parameters for entry in bulk.entries] == [
        b"\xa6\x00\x00\x00",
        b"\xa5\x01",
        b"\x1f",
    ]
    assert encode_fast(expect(FAST), VALUES) == FAST_HEALTHY


@pytest.mark.parametrize("length", range(8, 32))
def test_a_fast_answer_that_breaks_off_keeps_the_servos_before_the_break(length: int) -> None:
    answers = reader(FAST).read(FAST_HEALTHY[:length])
    whole_blocks = (length - 8) // 8
    assert [status.id for status in answers.statuses] == IDS[:whole_blocks]
    assert answers.missing == tuple(IDS[whole_blocks:])
    assert not answers.clean


def test_damage_within_a_fast_answer_costs_only_the_servos_whose_crc_it_breaks() -> None:
    data_hit = bytearray(FAST_HEALTHY)
    data_hit[18] ^= 1  # data of the second servo
    assert reader(FAST).read(bytes(data_hit)).missing == (7,)
    crc_hit = bytearray(FAST_HEALTHY)
    crc_hit[14] ^= 1  # CRC of the first, from which the second's is continued
    assert reader(FAST).read(bytes(crc_hit)).missing == (3, 7)
    id_hit = encode_fast(Expectation((3, 9, 4), (8, 8, 8), fast=True), VALUES)
    assert reader(FAST).read(id_hit).missing == (7,)


def test_fast_answers_are_not_stuffed() -> None:
    values = [(0, b"\xff\xff\xfd\x00"), (0x80, b"\xff\xff\xfd\xfd"), (0, b"\xff\xff\xff\xfd")]
    answers = reader(FAST).read(encode_fast(expect(FAST), values))
    assert answers.clean
    assert [(status.error, status.parameters) for status in answers.statuses] == values


def test_a_servo_that_does_not_know_fast_sync_read_is_an_answer_with_an_error() -> None:
    answers = reader(FAST).read(StatusPacket(3, 2).encode())
    assert summary(answers) == [(3, 2, b"")]
    assert answers.missing == (7, 4)


data_of_four = st.binary(min_size=4, max_size=4) | st.lists(
    st.sampled_from([0xFF, 0xFD, 0x00]), min_size=4, max_size=4
).map(bytes)


def assert_same_both_ways(answer_reader: AnswerReader, data: bytes) -> Answers:
    scanner_only = AnswerReader(answer_reader.expectation)
    scanner_only._each.clear()
    quick, slow = answer_reader.read(data), scanner_only._account(data)
    assert quick.clean == slow.clean
    assert quick.statuses == slow.statuses
    assert quick.has_errors == slow.has_errors == any(s.error for s in slow.statuses)
    if quick.reader is not None:
        width = quick.reader.expectation.data_lengths[:1] or (0,)
        values = quick.reader.unpacker(f"{width[0]}s")(quick.healthy)
        assert list(values) == [status.parameters for status in slow.statuses]
    assert (quick.missing, quick.unexpected) == (slow.missing, slow.unexpected)
    assert quick.segments == slow.segments
    if quick.segments is not None:
        assert_tiles(quick.segments, data, runs=False)
    return quick


@given(
    st.lists(st.tuples(st.integers(0, 255), data_of_four), min_size=3, max_size=3), st.booleans()
)
def test_the_short_way_and_the_scanner_agree_on_healthy_answers(
    values: list[tuple[int, bytes]], fast: bool
) -> None:
    if fast:
        data = encode_fast(expect(FAST), values)
    else:
        data = b"".join(
            StatusPacket(i, error, parameters).encode()
            for i, (error, parameters) in zip(IDS, values, strict=True)
        )
    answers = assert_same_both_ways(reader(FAST if fast else SYNC), data)
    assert answers.clean
    assert [(s.error, s.parameters) for s in answers.statuses] == values


@given(
    st.lists(
        st.tuples(st.integers(0, 2), st.sampled_from([*IDS, 9]), st.integers(0, 255), data_of_four),
        max_size=6,
    ),
    st.lists(st.tuples(st.integers(0, 99), st.integers(0, 4), nasty_bytes), max_size=2),
    st.integers(0, 99),
)
def test_the_short_way_and_the_scanner_agree_where_servos_are_silent_or_zeros_are_sent(
    answers: list[tuple[int, int, int, bytes]], edits: list[tuple[int, int, bytes]], end: int
) -> None:
    data = b"".join(
        bytes(zeros) + StatusPacket(servo_id, error, parameters).encode()
        for zeros, servo_id, error, parameters in answers
    )
    for at, removed, inserted in edits:
        data = data[:at] + inserted + data[at + removed :]
    assert_same_both_ways(reader(SYNC), data)
    assert_same_both_ways(reader(SYNC), data[:end])


@given(
    st.sampled_from([HEALTHY, FAST_HEALTHY]),
    st.sampled_from([SYNC, FAST, dxl.ping(254), dxl.ping(3), dxl.write(254, 0, b"")]),
    st.lists(st.tuples(st.integers(0, 50), st.integers(0, 4), nasty_bytes), max_size=3),
)
def test_the_short_way_and_the_scanner_agree_on_any_bytes(
    data: bytes, instruction: bytes, edits: list[tuple[int, int, bytes]]
) -> None:
    for at, removed, inserted in edits:
        data = data[:at] + inserted + data[at + removed :]
    answers = assert_same_both_ways(reader(instruction), data)
    expected = reader(instruction).expectation.ids
    found = {status.id for status in answers.statuses}
    assert answers.missing == tuple(servo_id for servo_id in expected if servo_id not in found)
