"""Two answers on one line at once."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.virtual.material import ask, bus, ids, raw, statuses
from wackel_protocols.dynamixel2 import packet
from wackel_schemas.virtual import Injection
from wackel_virtual.collision import BITS, superposed

PRESENT = (126, 10)  # current, velocity, position of the X series

data = st.binary(max_size=24)
offset = st.floats(0, 60)


@given(data)
def test_one_sender_is_read_as_it_is(sent: bytes) -> None:
    assert superposed(sent, b"", 0.0) == sent
    assert superposed(b"", sent, 3.3) == sent


@given(data, st.floats(0, 0.45))
def test_the_same_bits_at_the_same_time_do_not_show(sent: bytes, later: float) -> None:
    assert superposed(sent, sent, later) == sent


@given(st.lists(st.tuples(st.integers(0, 255), st.integers(0, 255)), max_size=20))
def test_aligned_bytes_have_the_bits_that_both_have(pairs: list[tuple[int, int]]) -> None:
    first, second = bytes(a for a, _ in pairs), bytes(b for _, b in pairs)
    assert superposed(first, second, 0.0) == bytes(a & b for a, b in pairs)


@given(data, data, st.floats(0.5, 5))
def test_one_after_the_other_are_both_read(first: bytes, second: bytes, pause: float) -> None:
    assert superposed(first, second, len(first) * BITS + pause) == first + second


@given(data, data, offset)
def test_no_more_bytes_come_than_fit_on_the_line(first: bytes, second: bytes, later: float) -> None:
    bits = max(len(first) * BITS, later + len(second) * BITS)
    assert len(superposed(first, second, later)) <= bits / (BITS - 0.5) + 1


@pytest.mark.parametrize("baud_rate", [57_600, 1_000_000, 4_000_000])
def test_two_servos_with_one_id_spoil_its_reads_and_no_others(baud_rate: int) -> None:
    on = bus(4, baud_rate=baud_rate)
    on.inject(Injection(kind="duplicate_id", servo=2))
    for _ in range(30):
        answer = raw(ask(on, packet.read(2, *PRESENT)))
        assert answer
        assert statuses([(0, answer)]) == []
        assert ids(ask(on, packet.sync_read([1, 3, 4], *PRESENT))) == [1, 3, 4]
        assert 2 not in ids(ask(on, packet.sync_read([1, 2, 3, 4], *PRESENT)))
    on.heal()
    assert ids(ask(on, packet.sync_read([1, 2, 3, 4], *PRESENT))) == [1, 2, 3, 4]


def test_where_a_bit_is_longer_than_the_servos_jitter_pings_of_both_are_one() -> None:
    on = bus(4, baud_rate=57_600)
    on.inject(Injection(kind="duplicate_id", servo=2))
    assert ids(ask(on, packet.ping(2))) == [2]
