"""What the bytes of a scan mean."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_imu.scan import BadLayout, Element, Layout, element


@pytest.mark.parametrize(
    ("described", "data", "value"),
    [
        ("le:s16/16>>0", b"\xfe\xff", -2),
        ("be:s16/16>>0", b"\xff\xfe", -2),
        ("le:u16/16>>0", b"\xfe\xff", 65534),
        ("le:s12/16>>4", b"\xf0\x7f", 0x7FF),
        ("be:s12/16>>4", b"\x80\x0f", -2048),
        ("le:u10/16>>2", b"\xff\xff", 1023),
        ("be:s24/32>>8", b"\xff\xff\xff\x55", -1),
        ("le:s64/64>>0", struct.pack("<q", -5), -5),
        ("be:s8/8>>0", b"\x80", -128),
        ("le:s16/16X4>>0", b"\x01\x00" + bytes(6), 1),
        ("le:s16/16>>0\n", b"\x01\x00", 1),
    ],
)
def test_a_type_says_how_bits_are_read(described: str, data: bytes, value: int) -> None:
    layout = Layout([element("in_anglvel_x", "0\n", described)])
    assert layout.size == len(data)
    assert layout.value("in_anglvel_x", data) == value


@pytest.mark.parametrize(
    "described",
    [
        "",
        "s16/16>>0",
        "le:s16/16",
        "le:s17/16>>0",
        "le:s16/16>>1",
        "le:s16/20>>0",
        "le:s0/16>>0",
        "le:f32/32>>0",
        "le:s16/16X0>>0",
        "le:s16/16>>0 x",
        "le:s999999/16>>0",
        "le:s٣/16>>0",
    ],
)
def test_what_no_driver_says_is_refused(described: str) -> None:
    with pytest.raises(BadLayout):
        element("in_anglvel_x", "0", described)


@pytest.mark.parametrize("index", ["", "-1", "x", "1.5", "99999", "٣"])
def test_an_index_is_a_number(index: str) -> None:
    with pytest.raises(BadLayout):
        element("in_anglvel_x", index, "le:s16/16>>0")


@given(st.text(max_size=30), st.text(max_size=6))
def test_any_description_is_a_channel_or_refused(described: str, index: str) -> None:
    try:
        found = element("a", index, described)
    except BadLayout:
        return
    assert 0 < found.bits + found.shift <= 8 * found.storage
    assert found.length > 0


def test_three_axes_and_a_timestamp_are_aligned_as_the_kernel_does() -> None:
    axes = [element(f"in_anglvel_{a}", str(i), "le:s16/16>>0") for i, a in enumerate("xyz")]
    layout = Layout([element("in_timestamp", "3", "le:s64/64>>0"), *reversed(axes)])
    assert layout.size == 16
    scan = struct.pack("<hhh2xq", 1, -2, 3, 1 << 40)
    names = ("in_anglvel_x", "in_anglvel_y", "in_anglvel_z", "in_timestamp")
    assert [layout.value(name, scan) for name in names] == [1, -2, 3, 1 << 40]


def test_a_scan_ends_at_the_alignment_of_its_longest_channel() -> None:
    layout = Layout(
        [element("in_timestamp", "0", "le:s64/64>>0"), element("z", "1", "le:s16/16>>0")]
    )
    assert layout.size == 16


def test_two_channels_at_one_place_and_none_at_all_are_refused() -> None:
    one, other = (element(name, "1", "le:s16/16>>0") for name in "ab")
    with pytest.raises(BadLayout, match="same index"):
        Layout([one, other])
    with pytest.raises(BadLayout, match="same name"):
        Layout([one, element("a", "2", "le:s16/16>>0")])
    with pytest.raises(BadLayout, match="no channel"):
        Layout([])


@st.composite
def channels(draw: st.DrawFn) -> list[Element]:
    """Any channels with a name and an index of their own."""
    made = []
    indices = draw(st.lists(st.integers(0, 99), min_size=1, max_size=6, unique=True))
    for index in indices:
        storage = draw(st.sampled_from((1, 2, 4, 8)))
        bits = draw(st.integers(1, 8 * storage))
        made.append(
            Element(
                name=f"c{index}",
                index=index,
                big_endian=draw(st.booleans()),
                signed=draw(st.booleans()),
                bits=bits,
                storage=storage,
                shift=draw(st.integers(0, 8 * storage - bits)),
            )
        )
    return made


@given(channels(), st.data())
def test_what_was_written_by_the_rules_is_read_again(
    made: list[Element], data: st.DataObject
) -> None:
    layout = Layout(made)
    scan = bytearray(data.draw(st.binary(min_size=layout.size, max_size=layout.size)))
    written: dict[str, int] = {}
    end = 0
    for each in sorted(made, key=lambda one: one.index):
        start = -(-end // each.storage) * each.storage
        end = start + each.storage
        low, high = (-(1 << (each.bits - 1)), (1 << (each.bits - 1)) - 1)
        if not each.signed:
            low, high = 0, (1 << each.bits) - 1
        value = data.draw(st.integers(low, high))
        order = "big" if each.big_endian else "little"
        mask = ((1 << each.bits) - 1) << each.shift
        stored = int.from_bytes(scan[start:end], order) & ~mask  # what else stands there is noise
        stored |= (value << each.shift) & mask
        scan[start:end] = stored.to_bytes(each.storage, order)
        written[each.name] = value
    assert {name: layout.value(name, bytes(scan)) for name in written} == written
    assert end <= layout.size < end + 8
