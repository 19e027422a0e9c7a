from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocols.material import assert_tiles, judge, nasty_bytes, packets, vectors
from wackel_protocols.dynamixel2 import Kind, Scanner, StatusPacket, decode, scan
from wackel_protocols.dynamixel2.packet import HEADER, Packet, ping
from wackel_protocols.dynamixel2.scanner import Segment

ID_107 = bytes([255, 255, 253, 0, 107, 7, 0, 85, 0, 65, 1, 44, 93, 231])
ID_1 = bytes([255, 255, 253, 0, 1, 7, 0, 85, 0, 55, 1, 42, 154, 192])
ID_5 = bytes([255, 255, 253, 0, 5, 7, 0, 85, 0, 55, 1, 42, 130, 128])

packet_bytes = packets.map(lambda packet: packet.encode())
broken_packet = st.builds(
    lambda data, at, value: data[: at % len(data)] + bytes([value]) + data[at % len(data) + 1 :],
    packet_bytes,
    st.integers(0, 1000),
    st.integers(0, 255),
)
cut_packet = st.builds(lambda data, at: data[: at % len(data)], packet_bytes, st.integers(0, 1000))
bogus_claim = st.builds(
    lambda servo_id, length, tail: HEADER + bytes([servo_id, *length.to_bytes(2, "little")]) + tail,
    st.integers(0, 255),
    st.integers(0, 65535),
    nasty_bytes,
)
streams = st.lists(
    packet_bytes | broken_packet | cut_packet | bogus_claim | nasty_bytes, max_size=8
).map(b"".join)


def kinds(data: bytes) -> list[tuple[str, int]]:
    return [(segment.kind.name, segment.end - segment.start) for segment in scan(data)]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (bytes(1), [("ZEROS", 1)]),
        (bytes(7), [("ZEROS", 7)]),
        (ID_107, [("PACKET", 14)]),
        (
            bytes([0, 0, 0, 0, 0, 0, 0, 12, 0, 222, 0]) + ID_1 + bytes(1),
            [
                ("ZEROS", 7),
                ("STRAY", 1),
                ("ZEROS", 1),
                ("STRAY", 1),
                ("ZEROS", 1),
                ("PACKET", 14),
                ("ZEROS", 1),
            ],
        ),
        (ID_1 + ID_5, [("PACKET", 14), ("PACKET", 14)]),
        (
            b"\x00" + ID_1 + b"\x00" + ID_5 + b"\x00",
            [("ZEROS", 1), ("PACKET", 14), ("ZEROS", 1), ("PACKET", 14), ("ZEROS", 1)],
        ),
        (
            bytes([12, 6, 0, 12, 2, 4, 198, 0, 0]) + ID_1 + bytes([0, 0, 0, 0, 0, 96]),
            [
                ("STRAY", 2),
                ("ZEROS", 1),
                ("STRAY", 4),
                ("ZEROS", 2),
                ("PACKET", 14),
                ("ZEROS", 5),
                ("STRAY", 1),
            ],
        ),
    ],
    ids=["no power", "no power, long", "break", "loose", "silent", "rhythmic", "permanent"],
)
def test_the_byte_sequences_of_the_thesis_are_told_apart(
    data: bytes, expected: list[tuple[str, int]]
) -> None:
    assert kinds(data) == expected


def test_the_packets_of_the_thesis_say_what_it_reports() -> None:
    assert [segment.packet for segment in scan(ID_107 + ID_1 + ID_5)] == [
        StatusPacket(107, 0, bytes([65, 1, 44])),
        StatusPacket(1, 0, bytes([55, 1, 42])),
        StatusPacket(5, 0, bytes([55, 1, 42])),
    ]


def test_all_published_packets_in_one_stream_are_found_in_order() -> None:
    published = [bytes.fromhex(vector["bytes_hex"]) for vector in vectors()]
    found = scan(b"\x00".join(published))
    assert [s.packet for s in found if s.kind is Kind.PACKET] == [
        decode(data) for data in published
    ]


@given(streams, st.lists(st.integers(1, 60), max_size=40), st.booleans())
def test_segments_tile_any_stream_and_do_not_depend_on_how_it_is_cut(
    data: bytes, cuts: list[int], runs: bool
) -> None:
    whole = scan(data, runs=runs)
    assert_tiles(whole, data, runs=runs)
    scanner, segments, at = Scanner(runs=runs), [], 0
    for cut in cuts:
        segments += scanner.feed(data[at : at + cut])
        at += cut
    segments += scanner.feed(data[at:])
    assert segments + scanner.finish() == whole


@given(streams)
def test_without_runs_only_neighbours_outside_packets_become_one(data: bytes) -> None:
    merged: list[Segment] = []
    for segment in scan(data):
        outside = segment.kind in (Kind.ZEROS, Kind.STRAY)
        if outside and merged and merged[-1].kind in (Kind.ZEROS, Kind.STRAY):
            merged[-1] = replace(merged[-1], kind=Kind.STRAY, end=segment.end)
        else:
            merged.append(segment)
    assert scan(data, runs=False) == merged


@given(streams)
def test_the_packets_found_are_those_of_a_plain_judge(data: bytes) -> None:
    found = [(s.start, s.end, s.packet) for s in scan(data) if s.kind is Kind.PACKET]
    assert found == judge(data)


headerless = st.lists(st.integers(0, 254), max_size=30).map(bytes)
endless_claim = st.integers(0, 252).map(lambda i: HEADER + bytes([i, 0xFF, 0xFF]))


@given(st.lists(st.tuples(headerless | endless_claim, packets), max_size=8))
def test_every_packet_after_garbage_is_found_also_inside_a_claim_of_65535_bytes(
    parts: list[tuple[bytes, Packet]],
) -> None:
    # Garbage without FF begins no header of its own, and a claim of 65535 bytes never completes
    # here, so each packet is exactly what must be found.
    data = b"".join(garbage + packet.encode() for garbage, packet in parts)
    assert [s.packet for s in scan(data) if s.kind is Kind.PACKET] == [p for _, p in parts]


@given(packets, st.integers(0, 10_000), st.integers(1, 0xFFFF))
def test_a_burst_of_up_to_16_wrong_bits_is_never_taken_for_content(
    packet: Packet, position: int, wrong_bits: int
) -> None:
    data = bytearray(packet.encode())
    at = 7 + position % (len(data) - 8)
    data[at] ^= wrong_bits >> 8
    data[at + 1] ^= wrong_bits & 0xFF
    assert not any(s.kind is Kind.PACKET and s.start == 0 for s in scan(bytes(data)))


def test_a_packet_is_given_as_soon_as_its_last_byte_is_there_even_inside_a_bogus_claim() -> None:
    scanner = Scanner()
    assert scanner.feed(HEADER + b"\x01\xff\xff" + ID_1[:-1]) == []
    segments = scanner.feed(ID_1[-1:])
    assert [segment.kind for segment in segments] == [Kind.TRUNCATED, Kind.PACKET]
    assert segments[0].damage == 7


def test_a_wrong_crc_keeps_the_claimed_extent_and_id() -> None:
    damaged = ID_1[:9] + b"\x00" + ID_1[10:]
    assert kinds(damaged + ID_5) == [("BAD_CRC", 14), ("PACKET", 14)]
    first = scan(damaged + ID_5)[0]
    assert (first.id, first.damage, first.packet) == (1, None, None)


def test_a_packet_cut_by_the_next_one_ends_where_that_begins() -> None:
    for length in range(4, 14):
        first, second = scan(ID_1[:length] + ID_5)
        assert (first.kind, first.end, first.damage) == (Kind.TRUNCATED, length, length)
        assert first.id == (1 if length > 4 else None)
        assert second.packet == decode(ID_5)


def test_a_packet_cut_by_the_end_is_truncated_there() -> None:
    (segment,) = scan(ID_1[:11])
    assert (segment.kind, segment.end, segment.damage) == (Kind.TRUNCATED, 11, 11)


def test_an_impossible_id_or_length_ends_the_packet_at_that_byte() -> None:
    assert kinds(HEADER + b"\xfd\x01\x02") == [("TRUNCATED", 4), ("STRAY", 3)]
    assert kinds(HEADER + b"\x01\x02\x00\x01") == [
        ("TRUNCATED", 5),
        ("STRAY", 1),
        ("ZEROS", 1),
        ("STRAY", 1),
    ]
    assert kinds(HEADER + b"\x01\x03\x00\x55")[0] == ("TRUNCATED", 5)


def test_violated_stuffing_tells_where_a_bad_packet_is_damaged() -> None:
    good = StatusPacket(1, 0, b"\x01\xff\xff\xfd\x02").encode()
    at = good.index(b"\xff\xff\xfd\xfd")
    damaged = good[: at + 3] + b"\x07" + good[at + 4 :]
    (segment,) = scan(damaged)
    assert (segment.kind, segment.damage) == (Kind.BAD_CRC, at + 3)


def test_a_header_that_reaches_into_the_crc_does_not_split_the_packet() -> None:
    # FF FF at the end of the parameters is not stuffed, and the CRC may begin with FD 00.
    spanning = next(
        data
        for first in range(256)
        for second in range(256)
        if (data := StatusPacket(1, 0, bytes([first, second, 0xFF, 0xFF])).encode())[-2:]
        == b"\xfd\x00"
    )
    assert spanning[-4:] == HEADER
    assert kinds(spanning + ID_5) == [("PACKET", 15), ("PACKET", 14)]


def test_instructions_and_answers_are_both_recognised() -> None:
    assert [segment.packet for segment in scan(ping(1) + ID_1)] == [decode(ping(1)), decode(ID_1)]


def test_offsets_go_on_after_finish() -> None:
    scanner = Scanner()
    scanner.feed(ID_1[:9])
    assert [s.kind for s in scanner.finish()] == [Kind.TRUNCATED]
    assert [(s.kind, s.start, s.end) for s in scanner.feed(ID_5)] == [(Kind.PACKET, 9, 23)]
    assert scanner.finish() == []


def test_an_endless_run_needs_no_memory_and_comes_as_one_segment() -> None:
    scanner = Scanner()
    for _ in range(1000):
        assert scanner.feed(bytes(1000)) == []
        assert len(scanner._buffer) < len(HEADER)
    (segment,) = scanner.finish()
    assert (segment.kind, segment.start, segment.end) == (Kind.ZEROS, 0, 1_000_000)


def test_endless_headers_that_claim_everything_are_checked_once_each_and_forgotten() -> None:
    claim = HEADER + b"\x01\xff\xff"
    scanner = Scanner()
    given_back = 0
    for _ in range(100):
        given_back += len(scanner.feed(claim * 300))
        assert len(scanner._buffer) <= 65542 + len(claim) * 300
    given_back += len(scanner.finish())
    assert given_back == 30_000
