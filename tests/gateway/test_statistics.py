"""Counters of a bus: every byte in one of them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_gateway.outcome import Outcome, unsolicited
from wackel_gateway.statistics import Counters
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import reader
from wackel_protocols.dynamixel2.packet import StatusPacket
from wackel_schemas.bus import BusStatistics

S = 1_000_000_000
IDS = (1, 2)
READ = packet.sync_read(IDS, 132, 4)


def answer(servo_id: int, error: int = 0) -> bytes:
    return StatusPacket(servo_id, error, bytes(4)).encode()


def counters() -> Counters:
    totals = BusStatistics(stamp=0, mode="poll", port="p", connected=True, baud_rate=1_000_000)
    return Counters(totals, IDS, now_ns=0)


def outcome(data: bytes, instruction: bytes = READ) -> Outcome:
    read = reader(instruction)
    chunks = [(1, data)] if data else []
    return Outcome(
        "cycle", instruction, read.expectation, 0, 0, chunks, read.read(data), 2, 2, 0, 1_000_000
    )


def test_healthy_answers_count_for_every_servo() -> None:
    counts = counters()
    for _ in range(3):
        counts.count(outcome(answer(1) + answer(2)))
    totals = counts.period(0, S)
    assert (totals.transactions, totals.incomplete) == (3, 0)
    assert totals.bytes_received == totals.packet_bytes == 90
    assert [(s.expected, s.received) for s in totals.servos] == [(3, 3), (3, 3)]


def test_missing_damaged_and_alerting_servos_are_told_apart() -> None:
    counts = counters()
    damaged = answer(2)[:-1] + b"\x55"
    counts.count(outcome(answer(1, 0x80) + damaged))
    counts.count(outcome(answer(1, 0x04)))
    first, second = counts.period(0, S).servos
    assert (first.received, first.alerts, first.errors) == (2, 1, 1)
    assert (second.expected, second.received, second.bad_crc) == (2, 0, 1)
    assert counts.totals.incomplete == 2


def test_rates_are_of_the_last_period() -> None:
    counts = counters()
    for _ in range(100):
        counts.count(outcome(answer(1) + answer(2)))
        counts.cycle(2_000_000)
    totals = counts.period(0, S)
    assert totals.cycle_rate == pytest.approx(100)
    assert totals.cycle_time == pytest.approx(0.002)
    assert totals.bus_load == pytest.approx(100 * (len(READ) + 30) * 10 / 1e6)
    assert counts.period(0, 2 * S).cycle_rate == 0
    assert totals.transactions == 100


def test_response_times_are_of_servos_that_are_asked_alone() -> None:
    counts = counters()
    for took_us in [500] * 95 + [900] * 5:
        alone = outcome(answer(2), packet.read(2, 132, 4))
        alone.chunks = [((took_us + 150) * 1000, answer(2))]  # 15 bytes at 1 Mbit/s
        counts.count(alone)
        counts.count(outcome(answer(1) + answer(2)))
    first, second = counts.period(0, S).servos
    assert (first.response_p50, first.response_p95, first.response_outliers) == (None, None, 0)
    assert second.response_p50 == pytest.approx(500e-6)
    assert second.response_p95 == pytest.approx(500e-6)
    assert second.response_p99 == pytest.approx(900e-6)
    assert second.response_outliers == 5


def test_refusals_are_counted_by_reason() -> None:
    counts = counters()
    for reason in ("a", "b", "a"):
        counts.refused(reason)
    assert counts.totals.rejected == {"a": 2, "b": 1}


@given(
    st.lists(st.one_of(st.binary(max_size=40), st.just(answer(1)), st.just(b"\0\0")), max_size=8)
)
def test_all_bytes_are_accounted_for(parts: list[bytes]) -> None:
    counts = counters()
    counts.count(outcome(b"".join(parts)))
    for part in parts:
        counts.count(unsolicited(0, part, 1_000_000))
    totals = counts.period(0, S)
    assert totals.bytes_received == 2 * len(b"".join(parts))
    assert totals.bytes_received == (
        totals.packet_bytes + totals.bad_bytes + totals.zero_bytes + totals.stray_bytes
    )
