"""The random processes behind disturbances have the rates that they are given."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_virtual.disturbance import BitErrors, Contact, JammerStream, jammed_share


@pytest.mark.parametrize("rate", [1e-4, 1e-2, 0.3])
def test_noise_has_its_bit_error_rate(rate):
    noise = BitErrors(Random(1))
    noise.set_rate(rate)
    chunks, size = 400, 250
    wrong = sum(
        int.from_bytes(noise.apply(bytes(size)), "little").bit_count() for _ in range(chunks)
    )
    bits = chunks * size * 8
    assert wrong == pytest.approx(rate * bits, abs=5 * (rate * bits) ** 0.5)


@given(st.lists(st.binary(max_size=40)))
def test_without_noise_data_stay_as_they_are(chunks):
    noise = BitErrors(Random(1))
    noise.set_rate(0.1)
    noise.apply(bytes(100))
    noise.set_rate(0.0)
    assert [noise.apply(chunk) for chunk in chunks] == chunks


@pytest.mark.parametrize(("bursts", "longest_s"), [(False, Contact.OPEN_MAX_S), (True, 1.0)])
def test_a_contact_is_lost_as_often_as_told_and_not_for_long(bursts, longest_s):
    contact = Contact(Random(1), 5.0, bursts=bursts)
    now, losses, longest = 0, 0, 0
    while now < 2000e9:
        then = contact.next_toggle_ns(now)
        if contact.open:
            longest = max(longest, then - now)
        else:
            losses += 1
        contact.open, now = not contact.open, then
    # While it is open it cannot be lost again.
    assert losses / 2000 == pytest.approx(5.0, rel=0.15)
    assert longest / 1e9 <= longest_s


def test_sparks_are_seldom_however_fast_a_contact_rattles():
    contact = Contact(Random(1), 5.0, bursts=False)
    sparks = [contact.spark(now) for now in range(0, 100_000_000_000, 1_000_000)]
    assert 60 < sum(map(bool, sparks)) < 120
    assert max(map(len, sparks)) <= Contact.SPARK_MAX_BYTES


@given(st.lists(st.integers(0, 4096), max_size=30))
def test_a_jammer_goes_on_where_it_was_read_to(counts):
    pieces, whole = JammerStream(Random(3)), JammerStream(Random(3))
    joined = b"".join(pieces.take(count) for count in counts)
    again = b""
    while len(again) < len(joined):
        again += whole.take(min(100, len(joined) - len(again)))
    assert joined == again


def test_a_permanent_jammer_destroys_what_the_thesis_counted():
    assert jammed_share(550_000) == pytest.approx(0.048, abs=0.002)
    assert jammed_share(10_000_000) == pytest.approx(0.55, abs=0.001)
