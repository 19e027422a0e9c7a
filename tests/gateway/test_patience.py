"""How long is waited: no longer than the bus at hand needs."""

from wackel_gateway.patience import Patience
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.expectation import expect

PING = expect(packet.ping(1))
CYCLE = expect(packet.sync_read(range(1, 21), 126, 10))
FAST = expect(packet.fast_sync_read(range(1, 21), 126, 10))
ALL = expect(packet.ping(packet.BROADCAST_ID))
MS = 1_000_000


def learned() -> Patience:
    patience = Patience(1_000_000, latency_timer_ms=1)
    for _ in range(100):
        patience.completed(PING, 200_000 + patience.wire_ns(PING.total_bytes))
        patience.completed(CYCLE, 300_000 + patience.wire_ns(CYCLE.total_bytes))
    return patience


def test_at_first_the_slowest_that_is_possible_is_waited_for() -> None:
    patience = Patience(1_000_000)
    assert patience.limit_ns(PING) >= 16 * MS + 508_000
    assert patience.limit_ns(CYCLE) >= patience.wire_ns(CYCLE.total_bytes) + 20 * 508_000


def test_once_learned_a_silent_servo_costs_a_few_milliseconds_instead_of_34() -> None:
    patience = learned()
    assert patience.limit_ns(PING) < 4 * MS
    assert patience.limit_ns(CYCLE) < patience.wire_ns(CYCLE.total_bytes) + 5 * MS


def test_plain_and_fast_answers_are_learned_apart() -> None:
    patience = learned()
    assert patience.limit_ns(FAST) > patience.wire_ns(FAST.total_bytes) + 9 * MS


def test_late_answers_make_it_more_patient_within_a_limit_and_for_a_while() -> None:
    patience = learned()
    before = patience.limit_ns(PING)
    for _ in range(50):
        patience.came_late()
    assert before + 15 * MS < patience.limit_ns(PING) < before + 20 * MS
    for _ in range(5000):
        patience.completed(PING, 340_000)
    assert patience.limit_ns(PING) <= before + 1 * MS


def test_it_is_told_by_how_much_answers_are_later_than_usual() -> None:
    took_ns = 300_000 + learned().wire_ns(CYCLE.total_bytes)
    assert Patience(1_000_000).late_ns(CYCLE, took_ns + 40 * MS) == 0  # nothing is usual yet
    patience = learned()
    assert patience.late_ns(CYCLE, took_ns) == 0
    assert patience.late_ns(CYCLE, took_ns - 1 * MS) == 0
    assert 7 * MS < patience.late_ns(CYCLE, took_ns + 8 * MS) <= 8 * MS
    for _ in range(20):
        patience.completed(CYCLE, took_ns + 8 * MS)
    assert patience.late_ns(CYCLE, took_ns + 8 * MS) == 0  # it is usual now


def test_a_broadcast_ping_waits_for_all_slots_as_the_vendor_does() -> None:
    # Thesis, 2.5: 789 ms at 2 Mbit/s.
    assert abs(Patience(2_000_000).limit_ns(ALL) - 789.6 * MS) < 1 * MS


def test_nothing_is_waited_for_where_nothing_answers() -> None:
    assert Patience(1_000_000).limit_ns(expect(packet.sync_write(65, 1, {1: b"\1"}))) == 0


def test_the_pause_finds_the_time_at_which_all_is_there() -> None:
    patience = learned()
    needed = patience.wire_ns(CYCLE.total_bytes) + 250_000
    early = 0
    for _ in range(2000):
        complete = patience.pause_ns(CYCLE) >= needed
        early += not complete
        patience.woke(CYCLE, complete=complete)
    assert abs(patience.pause_ns(CYCLE) - needed) < 20_000
    assert 0.2 < early / 2000 < 0.3
