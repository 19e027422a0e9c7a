"""Lost or late: when a master listens on."""

from hypothesis import given
from hypothesis import strategies as st

from tests.classifier.rig import Rig, chain
from wackel_gateway.lateness import Lateness, is_beginning
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import AnswerReader, reader
from wackel_protocols.dynamixel2.packet import StatusPacket
from wackel_virtual.bus import VirtualBus

MS = 1_000_000
SECOND_NS = 1_000_000_000
IDS = (1, 2, 3)
PLAIN = packet.sync_read(IDS, 126, 10)
FAST = packet.fast_sync_read(IDS, 126, 10)


def answer(instruction: bytes) -> bytes:
    bus = VirtualBus(chain(len(IDS)))
    return b"".join(data for _, data in bus.exchange(0, instruction, 50 * MS))


def test_every_part_of_an_answer_is_its_beginning_and_the_whole_is_not() -> None:
    for instruction in (PLAIN, FAST, packet.read(1, 9, 1)):
        whole, read = answer(instruction), reader(instruction)
        assert len(whole) == read.expectation.total_bytes
        assert all(is_beginning(read, whole[:end]) for end in range(len(whole)))
        assert not is_beginning(read, whole)


def test_where_a_later_answer_has_come_the_one_before_is_lost() -> None:
    first, second = (StatusPacket(i, 0, bytes(10)).encode() for i in IDS[:2])
    assert is_beginning(reader(PLAIN), first)
    assert not is_beginning(reader(PLAIN), second)
    fast = answer(FAST)
    block = 14  # error, id, 10 bytes, CRC
    assert not is_beginning(reader(FAST), fast[: 8 + block] + fast[8 + 2 * block :])


def test_zeros_and_foreign_bytes_are_no_beginning() -> None:
    for data in (b"\0", b"\0\0\0", b"\x37\xff\xff", answer(PLAIN)[:21] + b"\0"):
        assert not is_beginning(reader(PLAIN), data)


@given(st.binary(max_size=60), st.sampled_from([PLAIN, FAST, b"", packet.ping(254)]))
def test_any_bytes_are_judged(data: bytes, instruction: bytes) -> None:
    read: AnswerReader = reader(instruction)
    assert is_beginning(read, data) in (True, False)
    assert Lateness().extra_ns(read, data, 0) >= 0


def test_a_silent_servo_costs_a_small_share_of_the_time() -> None:
    lateness, now, spent = Lateness(), 0, 0
    while now < 60 * SECOND_NS:
        extra = lateness.extra_ns(reader(PLAIN), b"", now)
        spent += extra
        now += extra + 4 * MS
    assert 0 < spent < 0.025 * now


def test_an_adapter_that_holds_answers_back_is_always_waited_for() -> None:
    lateness = Lateness()
    for now in range(0, SECOND_NS, 20 * MS):
        assert lateness.extra_ns(reader(PLAIN), b"", now) >= 16 * MS
        lateness.was_right()


def test_a_latency_timer_costs_the_master_no_answer() -> None:
    rig = Rig(chain(8, rate=100.0), 1)
    list(rig.traffic(2.0))
    rig.inject("latency_timer", None, 16)
    transactions = list(rig.traffic(3.0))
    assert not [t for t in transactions if len(t.response_times) < len(t.expected)]
    assert not [t for t in transactions if t.purpose == "observed"]
    late = [t for t in transactions if t.ended_ns > t.deadline_ns]
    assert 0 < len(late) < 5  # then it waits for so long by itself


def test_a_silent_servo_is_listened_for_once_and_not_at_each_ping() -> None:
    rig = Rig(chain(8, rate=100.0), 1)
    list(rig.traffic(2.0))
    rig.inject("silent", 8)
    missed = [t for t in rig.traffic(3.0) if len(t.response_times) < len(t.expected)]
    longer = [t for t in missed if t.ended_ns > t.deadline_ns + 10 * MS]
    assert len(longer) == 1
    assert not [t for t in longer if t.purpose == "ping"]
