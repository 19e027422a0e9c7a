"""Bytes of a buffer to samples: whatever is read, in whatever pieces."""

import math
import struct

from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from tests.imu.tree import SCAN
from wackel_imu.core import MOST_OFF_NS, Decoder, Now, Scale
from wackel_imu.scan import Layout, element
from wackel_schemas import wire
from wackel_schemas.drive import ImuSample

UTC = 1_700_000_000_000_000_000
NAMES = ("in_anglvel_x", "in_anglvel_y", "in_anglvel_z")
AXES = [element(name, str(i), "le:s16/16>>0") for i, name in enumerate(NAMES)]
STAMPED = Layout([*AXES, element("in_timestamp", "3", "le:s64/64>>0")])
SCALES = dict.fromkeys(NAMES, Scale(0.001, 10.0))


def test_raw_values_are_shifted_and_scaled_and_stamps_are_brought_to_utc() -> None:
    decoder = Decoder(STAMPED, SCALES, 100.0)
    data = SCAN.pack(0, -10, 990, 5_000_000) + SCAN.pack(1, 2, 3, 15_000_000)
    first, second = decoder.samples(data, Now(UTC, 17_000_000))
    assert first.stamp == UTC - 12_000_000
    assert second.stamp == UTC - 2_000_000
    assert first.angular_velocity == approx((0.01, 0.0, 1.0))


def test_a_device_that_does_not_stamp_is_taken_to_keep_its_rate() -> None:
    decoder = Decoder(Layout(AXES), SCALES, 200.0)
    stamps = [s.stamp for s in decoder.samples(struct.pack("<9h", *range(9)), Now(UTC, 0))]
    assert stamps == [UTC - 10_000_000, UTC - 5_000_000, UTC]


def test_an_axis_that_is_not_there_shows_nothing() -> None:
    layout = Layout([element("in_anglvel_z", "2", "be:s16/16>>0")])
    decoder = Decoder(layout, {"in_anglvel_z": Scale(0.5)}, 100.0)
    (sample,) = decoder.samples(b"\x00\x04", Now(UTC, 0))
    assert sample.angular_velocity == (0.0, 0.0, 2.0)


@given(st.binary(max_size=200), st.lists(st.integers(0, 40), max_size=20))
def test_pieces_give_the_same_as_the_whole(data: bytes, cuts: list[int]) -> None:
    now = Now(UTC, 0)
    whole = Decoder(STAMPED, SCALES, 100.0).samples(data, now)
    decoder, pieces, rest = Decoder(STAMPED, SCALES, 100.0), [], data
    for cut in cuts:
        pieces += decoder.samples(rest[:cut], now)
        rest = rest[cut:]
    pieces += decoder.samples(rest, now)
    assert pieces == whole
    assert len(whole) == len(data) // 16


@given(st.binary(min_size=16, max_size=64), st.integers(0, 1 << 63))
def test_any_bytes_are_numbers_that_travel(data: bytes, device_ns: int) -> None:
    unsigned = Layout([*AXES, element("in_timestamp", "3", "be:u64/64>>0")])
    for layout in (STAMPED, unsigned):
        for sample in Decoder(layout, SCALES, 100.0).samples(data, Now(UTC, device_ns)):
            assert all(map(math.isfinite, sample.angular_velocity))
            assert abs(sample.stamp - UTC) <= MOST_OFF_NS
            assert wire.decode(wire.encode(sample), ImuSample) == sample
