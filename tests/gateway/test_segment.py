"""Somebody else's traffic, cut into transactions."""

from collections.abc import Iterable

from hypothesis import given, settings
from hypothesis import strategies as st

from wackel_gateway.outcome import Outcome
from wackel_gateway.patience import Patience
from wackel_gateway.segment import Segmenter
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.packet import StatusPacket

MS = 1_000_000
PING = packet.ping(1)
ANSWER = StatusPacket(1, 0, b"\x06\x04\x32").encode()
READ = packet.sync_read([1, 2], 132, 4)
ANSWERS = StatusPacket(1, 0, bytes(4)).encode() + StatusPacket(2, 0, bytes(4)).encode()


def segmenter() -> Segmenter:
    return Segmenter(Patience(1_000_000, 0), 1_000_000)


def raw(outcome: Outcome) -> bytes:
    return b"".join(data for _, data in outcome.chunks)


def test_an_exchange_is_given_as_soon_as_it_is_complete() -> None:
    traffic = segmenter()
    assert traffic.host(0, PING) == []
    assert traffic.bus(MS, ANSWER[:5]) == []
    (outcome,) = traffic.bus(2 * MS, ANSWER[5:])
    assert outcome.instruction == PING
    assert [data for _, data in outcome.chunks] == [ANSWER[:5], ANSWER[5:]]
    assert [s.id for s in outcome.answers.statuses] == [1]
    assert (outcome.begin_ns, outcome.sent_ns, outcome.ended_ns) == (0, 100_000, 2 * MS)
    assert outcome.message(10).response_times[0].ns == 2 * MS - 100_000


def test_an_instruction_that_comes_in_pieces_begins_with_the_first() -> None:
    traffic = segmenter()
    assert traffic.host(0, PING[:3]) == []
    assert traffic.host(MS, PING[3:]) == []
    (outcome,) = traffic.bus(2 * MS, ANSWER)
    assert (outcome.begin_ns, outcome.instruction) == (0, PING)


def test_what_is_not_answered_ends_at_its_deadline() -> None:
    traffic = segmenter()
    traffic.host(0, READ)
    traffic.bus(MS, ANSWERS[:15])
    due_ns = traffic.due_ns
    assert due_ns is not None
    assert traffic.idle(due_ns - 1) == []
    (outcome,) = traffic.idle(due_ns)
    assert outcome.answers.missing == (2,)
    assert traffic.due_ns is None


def test_the_next_instruction_ends_the_one_before() -> None:
    traffic = segmenter()
    traffic.host(0, READ)
    (cut,) = traffic.host(MS, PING)
    assert (cut.instruction, cut.ended_ns) == (READ, MS)
    assert cut.ended_ns < cut.deadline_ns


def test_a_write_to_all_has_no_answer_to_wait_for() -> None:
    write = packet.sync_write(65, 1, {1: b"\1"})
    first, second = segmenter().host(0, write + write)
    assert first.instruction == second.instruction == write
    assert first.expectation.ids == ()


def test_late_and_uncalled_bytes_are_unsolicited() -> None:
    traffic = segmenter()
    (stray,) = traffic.bus(0, b"\0")
    assert (stray.instruction, raw(stray), stray.purpose) == (b"", b"\0", "observed")


def test_what_the_master_sends_is_kept_even_if_it_is_no_packet() -> None:
    traffic = segmenter()
    traffic.host(0, PING[:-1] + b"\x55")
    due_ns = traffic.due_ns
    assert due_ns is not None
    outcomes = traffic.idle(due_ns) + traffic.idle(due_ns + 100 * MS)
    assert b"".join(outcome.instruction for outcome in outcomes) == PING[:-1] + b"\x55"


def test_a_tap_tells_instructions_and_answers_apart_in_one_stream() -> None:
    traffic = segmenter()
    (first,) = traffic.both(MS, PING + ANSWER)
    assert (first.instruction, raw(first)) == (PING, ANSWER)
    # The instruction ended when the answer's 14 bytes had yet to come.
    assert first.sent_ns == MS - 140_000
    assert first.begin_ns == MS - 240_000
    done = traffic.both(10 * MS, READ + ANSWERS[:20])
    done += traffic.both(11 * MS, ANSWERS[20:] + b"\0\0" + PING)
    done += traffic.both(12 * MS, ANSWER)
    assert [outcome.instruction for outcome in done] == [READ, b"", PING]
    assert raw(done[0]) == ANSWERS
    assert raw(done[1]) == b"\0\0"


def test_a_servo_that_never_answers_writes_but_reads_is_not_expected_to() -> None:
    traffic = segmenter()
    write, read = packet.write(1, 65, b"\1"), packet.read(1, 132, 4)
    outcomes: list[Outcome] = []
    for turn in range(6):
        now = turn * 100 * MS
        outcomes += traffic.host(now, write)
        outcomes += traffic.host(now + 50 * MS, read)
        outcomes += traffic.bus(now + 51 * MS, StatusPacket(1, 0, bytes(4)).encode())
    expected = [len(o.expectation.ids) for o in outcomes if o.instruction == write]
    assert expected == [1, 1, 1, 0, 0, 0]


def test_a_servo_that_answers_nothing_is_still_expected_to_answer_writes() -> None:
    traffic = segmenter()
    outcomes: list[Outcome] = []
    for turn in range(6):
        outcomes += traffic.host(turn * 100 * MS, packet.write(1, 65, b"\1"))
        outcomes += traffic.host(turn * 100 * MS + 50 * MS, packet.read(1, 132, 4))
    assert all(outcome.expectation.ids == (1,) for outcome in outcomes[-3:])


Event = tuple[str, bytes]
pieces = st.one_of(
    st.binary(max_size=12),
    st.sampled_from([PING, ANSWER, READ, ANSWERS, PING[:4], ANSWER[3:], b"\0", b"\xff\xff\xfd"]),
)


@settings(max_examples=150)
@given(st.lists(st.tuples(st.sampled_from(["host", "bus"]), pieces), max_size=30))
def test_no_byte_is_lost_or_told_twice_whatever_comes(events: Iterable[Event]) -> None:
    traffic = segmenter()
    outcomes: list[Outcome] = []
    sent = {"host": b"", "bus": b""}
    now = 0
    for side, data in events:
        now += MS
        if data:
            sent[side] += data
            outcomes += (traffic.host if side == "host" else traffic.bus)(now, data)
        outcomes += traffic.idle(now)
    for _ in range(3):
        now += 1000 * MS
        outcomes += traffic.idle(now)
    assert b"".join(outcome.instruction for outcome in outcomes) == sent["host"]
    assert b"".join(raw(outcome) for outcome in outcomes) == sent["bus"]
    assert traffic.due_ns is None


@settings(max_examples=150)
@given(st.lists(pieces, max_size=30))
def test_a_tap_tells_every_byte_once_and_in_order(chunks: list[bytes]) -> None:
    traffic = segmenter()
    outcomes: list[Outcome] = []
    now = 0
    for data in chunks:
        now += MS
        outcomes += traffic.both(now, data) if data else []
        outcomes += traffic.idle(now)
    for _ in range(3):
        now += 1000 * MS
        outcomes += traffic.idle(now)
    told = b"".join(outcome.instruction + raw(outcome) for outcome in outcomes)
    assert told == b"".join(chunks)
