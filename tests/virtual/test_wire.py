"""A healthy bus: order and time of answers, what servos hear, what the adapter makes of it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.virtual.material import MS, PRESENT_POSITION, ask, bus, chain, ids, raw, statuses
from wackel_node.config import BusConfig, ServoConfig
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.expectation import expect
from wackel_protocols.dynamixel2.fast import parse_fast
from wackel_protocols.dynamixel2.packet import BROADCAST_ID
from wackel_schemas.virtual import Injection
from wackel_virtual import VirtualBus
from wackel_virtual.framing import GAP_NS
from wackel_virtual.wire import JITTER_NS, PROCESSING_NS, TURN_NS

PING_ALL = packet.ping(BROADCAST_ID)


def test_a_ping_takes_what_the_thesis_measured():
    on = bus(1, baud_rate=2_000_000, return_delay_us=None)
    times = []
    for _ in range(200):
        start = on.now_ns + 5 * MS
        ((at, _),) = on.exchange(start, packet.ping(1), 5 * MS)
        times.append((at - start) / 1000)
    assert sum(times) / len(times) == pytest.approx(672, abs=1)
    assert max(times) - min(times) < 7


@pytest.mark.parametrize("register", [0, 100, 254])
def test_the_return_delay_time_register_delays_the_answer(register):
    on = bus(1, return_delay_us=2 * register)
    start = on.now_ns + MS
    ((at, data),) = on.exchange(start, packet.ping(1), 5 * MS)
    wire_ns = (10 + len(data)) * 10_000
    expected = wire_ns + PROCESSING_NS + register * 2000
    assert at - start == pytest.approx(expected, abs=JITTER_NS)


def test_sync_read_is_answered_in_request_order_at_wire_speed():
    on = bus(20)
    order = [3, 1, 20, *range(4, 20), 2]
    request = packet.sync_read(order, PRESENT_POSITION, 4)
    start = on.now_ns + MS
    chunks = on.exchange(start, request, 10 * MS)
    assert ids(chunks) == order
    bytes_ns = (len(request) + 20 * 15) * 10_000
    gaps = PROCESSING_NS + 19 * TURN_NS
    assert chunks[-1][0] - start == pytest.approx(bytes_ns + gaps, abs=20 * JITTER_NS)


def test_a_servo_that_is_not_there_silences_those_behind_it_in_the_request():
    on = bus(5)
    assert ids(ask(on, packet.sync_read([5, 4, 77, 1, 2], 132, 4))) == [5, 4]


def test_bulk_read_takes_address_and_length_of_each_servo():
    on = bus(3)
    requests = [(2, 0, 2), (1, 132, 4), (3, 146, 1)]
    found = statuses(ask(on, packet.bulk_read(requests)))
    assert [(s.id, len(s.parameters)) for s in found] == [(2, 2), (1, 4), (3, 1)]


@pytest.mark.parametrize(
    "request_",
    [
        packet.fast_sync_read([2, 1, 3], 132, 4),
        packet.fast_bulk_read([(2, 0, 2), (1, 132, 4), (3, 146, 1)]),
    ],
)
def test_a_fast_read_is_one_packet_with_chained_crcs(request_):
    answer = raw(ask(bus(3), request_))
    parsed = parse_fast(answer, expect(request_))
    assert parsed.ok
    assert [entry.id for entry in parsed.entries] == [2, 1, 3]


def test_in_a_fast_read_a_missing_servo_silences_the_later_ones():
    request = packet.fast_sync_read([2, 77, 3], 132, 4)
    parsed = parse_fast(raw(ask(bus(3), request)), expect(request))
    assert [entry.id for entry in parsed.entries] == [2]
    assert ask(bus(3), packet.fast_sync_read([77, 1], 132, 4)) == []


def test_firmware_that_does_not_know_fast_reads_does_not_answer_them():
    on = VirtualBus(bus_config(2), firmware={1: 44, 2: 45})
    assert ask(on, packet.fast_sync_read([1, 2], 132, 4)) == []
    assert raw(ask(on, packet.fast_sync_read([2], 132, 4)))
    assert ids(ask(on, packet.sync_read([1, 2], 132, 4))) == [1, 2]


def bus_config(size):
    return BusConfig(
        port="unused", return_delay_us=0, servos=[ServoConfig(id=i + 1) for i in range(size)]
    )


def test_every_servo_answers_a_broadcast_ping_in_its_slot_within_the_vendors_window():
    wanted = [0, 1, 2, 17, 100, 252]
    config = BusConfig(
        port="unused", baud_rate=2_000_000, servos=[ServoConfig(id=i) for i in wanted[::-1]]
    )
    on = VirtualBus(config)
    start = on.now_ns + MS
    chunks = on.exchange(start, PING_ALL, 790 * MS)  # the thesis: 789.64 ms
    assert ids(chunks) == wanted
    slots = [(at - start) // (3 * MS) for at, _ in chunks]
    assert slots == sorted(set(slots))


@pytest.mark.parametrize(
    "instruction",
    [
        packet.write(BROADCAST_ID, 65, b"\1"),
        packet.read(BROADCAST_ID, 132, 4),
        packet.action(BROADCAST_ID),
        packet.sync_write(65, 1, {1: b"\1", 2: b"\1"}),
        packet.bulk_write([(1, 65, b"\1"), (2, 116, b"\0\1\0\0")]),
    ],
)
def test_no_other_broadcast_is_answered(instruction):
    assert ask(bus(3), instruction) == []


def test_group_writes_reach_each_servo_with_its_own_data():
    on = bus(3)
    ask(on, packet.sync_write(116, 4, {1: b"\1\0\0\0", 3: b"\3\0\0\0"}))
    ask(on, packet.bulk_write([(2, 116, b"\2\0\0\0"), (1, 65, b"\1")]))
    found = statuses(ask(on, packet.sync_read([1, 2, 3], 116, 1)))
    assert [s.parameters for s in found] == [b"\1", b"\2", b"\3"]
    assert statuses(ask(on, packet.read(1, 65, 1)))[0].parameters == b"\1"


def test_an_instruction_may_come_in_pieces_but_not_with_a_long_pause():
    data = packet.ping(1)
    for pause_ns, answered in ((GAP_NS // 2, [1]), (2 * GAP_NS, [])):
        on = bus(1)
        on.transmit(MS, data[:4], 1_000_000)
        on.transmit(MS + 40_000 + pause_ns, data[4:], 1_000_000)
        assert ids(on.deliveries(20 * MS)) == answered


def test_instructions_in_one_write_are_obeyed_one_after_the_other():
    on = bus(2)
    data = packet.sync_write(65, 1, {1: b"\1", 2: b"\1"}) + packet.sync_read([1, 2], 65, 1)
    on.transmit(MS, b"\0garbage" + data, 1_000_000)
    found = statuses(on.deliveries(20 * MS))
    assert [s.parameters for s in found] == [b"\1", b"\1"]


def test_who_talks_into_an_answer_destroys_both():
    on = bus(1)
    read = packet.read(1, 0, 100)
    on.transmit(MS, read, 1_000_000)
    during = MS + len(read) * 10_000 + PROCESSING_NS + 300_000
    on.transmit(during, packet.ping(1), 1_000_000)
    assert ids(on.deliveries(20 * MS)) == []
    assert ids(ask(on, packet.ping(1))) == [1]


def test_a_new_instruction_cancels_answers_that_have_not_begun():
    on = bus(3)
    on.transmit(MS, PING_ALL, 1_000_000)
    on.transmit(2 * MS, packet.ping(3), 1_000_000)
    assert ids(on.deliveries(900 * MS)) == [3]


def test_two_servos_with_the_same_id_garble_each_other():
    on = bus(2)
    ask(on, packet.write(2, 7, b"\1"))
    assert ids(ask(on, packet.ping(1))) == []


@pytest.mark.parametrize(
    ("return_delay_us", "expected_ms"),
    # Thesis, 2.7: one tick up to a delay of about 400 µs, two with 508 µs.
    [(0, 1), (300, 1), (508, 2)],
)
def test_with_a_latency_timer_of_1_ms_answers_take_whole_milliseconds(return_delay_us, expected_ms):
    config = BusConfig(
        port="unused",
        baud_rate=1_000_000,
        return_delay_us=return_delay_us,
        servos=[ServoConfig(id=1)],
    )
    on = VirtualBus(config, latency_ms=1)
    request = packet.read(1, 0, 20)  # 14 + 31 bytes: 450 µs
    end = 0
    for _ in range(10):
        start = end
        chunks = on.exchange(start, request, 5 * MS)
        end = chunks[-1][0]
        assert len(raw(chunks)) == 31
    assert (end - start) / MS == pytest.approx(expected_ms)


def test_a_latency_timer_does_not_hold_back_a_full_usb_packet():
    on = VirtualBus(bus_config(20), latency_ms=16)
    chunks = on.exchange(MS, packet.sync_read(range(1, 21), 132, 4), 40 * MS)
    assert [len(data) for _, data in chunks] == [62, 62, 62, 62, 52]
    assert chunks[3][0] < 5 * MS < 16 * MS == chunks[4][0]


def traffic(on):
    for _ in range(30):
        yield ask(on, packet.sync_read(range(1, 9), 124, 22))
        yield ask(on, packet.ping(3))


def test_the_same_seed_gives_the_same_bytes_at_the_same_times():
    one, same, other = (list(traffic(bus(8, seed=seed))) for seed in (5, 5, 6))
    assert one == same
    assert one != other


def test_what_happens_next_is_known_until_nothing_will():
    on = bus(2)
    assert on.next_ns() is None
    on.transmit(MS, packet.sync_read([1, 2], 132, 4), 1_000_000)
    chunks = []
    while (at := on.next_ns()) is not None:
        chunks += on.deliveries(at)
    assert ids(chunks) == [1, 2]
    assert chunks == sorted(chunks)


def test_ordinary_loss_loses_or_damages_the_given_share():
    on = VirtualBus(bus_config(10), 1, loss=0.05)
    lost = sum(10 - len(ids(ask(on, packet.sync_read(range(1, 11), 132, 4)))) for _ in range(400))
    assert lost / 4000 == pytest.approx(0.05, abs=0.015)


@given(st.lists(st.binary(min_size=1, max_size=60), max_size=8), st.integers(0, 3 * MS))
def test_any_bytes_from_the_host_leave_a_bus_that_still_answers(pieces, pause_ns):
    on = bus(3)
    for piece in pieces:
        on.transmit(on.now_ns + pause_ns, piece, 1_000_000)
    on.deliveries(on.now_ns + 1000 * MS)
    assert ids(ask(on, packet.ping(3))) == [3]


def test_a_tap_hears_both_directions_in_order_with_the_time_of_the_last_byte():
    on = VirtualBus(chain(3), 1, tapped=True)
    request = packet.sync_read([1, 2, 3], PRESENT_POSITION, 4)
    answers = on.exchange(MS, request, 10 * MS)
    sent_ns = MS + len(request) * 10_000
    assert on.overheard(on.now_ns) == [(sent_ns, request), *answers]
    assert on.overheard(on.now_ns) == []


def test_a_tap_changes_nothing_for_the_master():
    request = packet.sync_read([1, 2, 3], PRESENT_POSITION, 4)
    plain, tapped = bus(3), VirtualBus(chain(3), 1, tapped=True)
    for on in (plain, tapped):
        on.inject(Injection(kind="noise", value=1e-3))
    for _ in range(50):
        start = plain.now_ns + MS
        assert plain.exchange(start, request, 9 * MS) == tapped.exchange(start, request, 9 * MS)
    assert plain.overheard(plain.now_ns) == []


def test_a_tap_goes_on_hearing_when_the_masters_adapter_is_unplugged():
    on = VirtualBus(chain(3), 1, tapped=True)
    on.inject(Injection(kind="unplugged"))
    on.transmit(MS, packet.ping(1), 1_000_000)
    assert on.overheard(9 * MS) == []  # nobody sends
    on.heal()
    on.transmit(10 * MS, packet.ping(1), 1_000_000)
    on.inject(Injection(kind="unplugged"))
    assert on.deliveries(20 * MS) == []
    instruction, answer = on.overheard(20 * MS)
    assert instruction[1] == packet.ping(1)
    assert ids([answer]) == [1]
