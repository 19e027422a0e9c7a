"""What follows from transactions as any gateway may publish them, without a virtual bus."""

from collections.abc import Callable

import pytest

from tests.classifier.rig import chain
from wackel_classifier.core import BusClassifier
from wackel_node.config import ClassifierConfig
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.packet import StatusPacket
from wackel_schemas.bus import Chunk, ResponseTime, Transaction
from wackel_virtual.bus import VirtualBus

START = 1_700_000_000_000_000_000
PERIOD = 10_000_000


class Bus:
    """Transactions one period apart, and a classifier that takes them."""

    def __init__(self, servos: int, **settings: object) -> None:
        self.ids = list(range(1, servos + 1))
        self.classifier = BusClassifier("main", chain(servos, **settings), ClassifierConfig())
        self.stamp = START

    def take(
        self, instruction: bytes, expected: list[int], data: bytes, **values: object
    ) -> list[tuple[str, str]]:
        """What is active after a transaction."""
        self.stamp += PERIOD
        settings = {
            "stamp": self.stamp,
            "purpose": "cycle",
            "instruction": instruction,
            "sent_ns": 100_000,
            "chunks": [Chunk(at_ns=1_500_000, data=data)] if data else [],
            "expected": expected,
            "expected_bytes": 15 * len(expected),
            "deadline_ns": 5_000_000,
            "ended_ns": 1_500_000 if data else 5_000_000,
            "baud_rate": 1_000_000,
        }
        self.classifier.step(Transaction(**(settings | values)))  # type: ignore[arg-type]
        return [(report.code, report.component) for report in self.classifier.active()]

    def read_all(self, data: bytes | None = None, **values: object) -> list[tuple[str, str]]:
        """A sync read of all servos; answered by all unless other bytes are given."""
        if data is None:
            data = b"".join(map(answer, self.ids))
        return self.take(packet.sync_read(self.ids, 132, 4), self.ids, data, **values)


def answer(servo_id: int, error: int = 0, data: bytes = b"\1\2\3\4") -> bytes:
    return StatusPacket(servo_id, error, data).encode()


def repeat(times: int, action: Callable[[], list[tuple[str, str]]]) -> list[tuple[str, str]]:
    for _ in range(times - 1):
        action()
    return action()


def stall(bus: Bus, times: int) -> None:
    """The adapter holds so many reads back, and passes on all that it held."""
    late = Chunk(at_ns=25_000_000, data=b"".join(map(answer, bus.ids)))
    for _ in range(times):
        bus.read_all(late_ns=23_000_000, chunks=[late])
        repeat(30, bus.read_all)


def told_of_silences(bus: Bus, times: int, between: int) -> set[str]:
    """Codes, where so often nobody answers two reads, and so many are answered before the next."""
    codes: set[str] = set()
    for _ in range(times):
        repeat(2, lambda: bus.read_all(b""))
        for _ in range(between):
            codes.update(code for code, _ in bus.read_all())
    return codes


def test_without_follow_up_pings_a_silent_tail_is_a_break_or_its_first_servo() -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    active = repeat(100, lambda: bus.read_all(answer(1) + answer(2)))
    assert active == [("cable_break", "bus/main/cable/2-3")]
    [report] = bus.classifier.active()
    assert report.suspects == ["bus/main/servo/3"]
    assert report.confidence < 0.7


def test_a_single_lost_packet_is_no_fault() -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    bus.read_all(answer(1) + answer(2))
    assert repeat(200, bus.read_all) == []


def test_an_id_that_is_not_configured_is_unexpected() -> None:
    bus = Bus(3)
    repeat(5, bus.read_all)
    data = b"".join(map(answer, bus.ids)) + answer(99)
    assert ("unexpected_servo", "bus/main/servo/99") in repeat(5, lambda: bus.read_all(data))


def test_a_fast_answer_that_comes_late_is_no_servo_with_the_broadcast_id() -> None:
    bus = Bus(3)
    instruction = packet.fast_sync_read(bus.ids, 132, 4)
    late = b"".join(data for _, data in VirtualBus(chain(3)).exchange(0, instruction, 9_000_000))
    assert late[4] == packet.BROADCAST_ID
    for _ in range(10):
        bus.read_all()
        assert bus.take(b"", [], late) == []


def test_two_answers_of_one_id_to_one_request_are_a_doubled_id() -> None:
    bus = Bus(3)
    repeat(5, bus.read_all)
    data = answer(1) + answer(2) + answer(2) + answer(3)
    assert ("duplicate_id", "bus/main/servo/2") in repeat(5, lambda: bus.read_all(data))


def test_instructions_of_another_master_fit_no_known_fault() -> None:
    bus = Bus(3)
    repeat(5, bus.read_all)
    data = b"".join(map(answer, bus.ids)) + packet.ping(7)
    assert repeat(5, lambda: bus.read_all(data)) == [("unclassified", "bus/main")]
    [report] = bus.classifier.active()
    assert report.evidence.transaction is not None
    assert "instruction packets" in report.evidence.summary


def test_packets_that_always_break_off_fit_no_known_fault() -> None:
    bus = Bus(3)
    repeat(5, bus.read_all)
    torn = answer(1) + answer(2) + answer(3)[:9]
    assert repeat(40, lambda: bus.read_all(torn)) == [("unclassified", "bus/main")]


def test_a_refused_instruction_is_told_with_its_reason() -> None:
    bus = Bus(3)
    refusal = StatusPacket(2, 7).encode()
    active = bus.take(packet.write(2, 11, b"\1"), [2], refusal)
    assert active == [("instruction_error", "bus/main/servo/2")]
    [report] = bus.classifier.active()
    assert "access error" in report.message
    assert repeat(600, bus.read_all) == []


def test_an_alert_whose_reason_cannot_be_read_is_told_as_such() -> None:
    bus = Bus(3)
    data = answer(1) + answer(2, 0x80) + answer(3)
    assert repeat(10, lambda: bus.read_all(data)) == []
    assert repeat(200, lambda: bus.read_all(data)) == [("alert", "bus/main/servo/2")]


def test_the_host_is_blamed_for_its_own_lag() -> None:
    bus = Bus(3)
    assert bus.read_all(host_lag_ns=8_000_000) == []
    assert bus.read_all(host_lag_ns=8_000_000) == []
    assert bus.read_all(host_lag_ns=8_000_000) == [("host_lag", "bus/main")]
    assert repeat(1200, bus.read_all) == []


def test_a_late_answer_is_a_slow_servo_and_not_a_silent_one() -> None:
    bus = Bus(3)
    repeat(5, bus.read_all)

    def late() -> list[tuple[str, str]]:
        bus.take(packet.ping(2), [2], b"")
        bus.take(b"", [], StatusPacket(2, 0, b"\6\4\46").encode(), purpose="observed")
        return repeat(10, bus.read_all)

    assert repeat(10, late) == [("slow_servo", "bus/main/servo/2")]


@pytest.mark.parametrize(
    ("registers", "configured", "wrong"),
    [([250, 250, 10, 250], None, 3), ([250, 250, 10, 250], 20, None), ([0, 0, 0, 5], 0, 4)],
)
def test_return_delay_registers_are_held_against_the_configuration_or_the_majority(
    registers: list[int], configured: int | None, wrong: int | None
) -> None:
    bus = Bus(4, return_delay_us=configured)
    active: list[tuple[str, str]] = []
    for servo_id, value in zip(bus.ids, registers, strict=True):
        data = StatusPacket(servo_id, 0, bytes([value])).encode()
        active = bus.take(packet.read(servo_id, 9, 1), [servo_id], data)
    active = repeat(10, bus.read_all)
    if wrong is None:  # all but one differ from what is configured
        assert len(active) == 3
    else:
        assert active == [("return_delay", f"bus/main/servo/{wrong}")]


def test_a_wrong_register_is_told_with_the_value_that_it_should_hold() -> None:
    bus = Bus(4, return_delay_us=0)
    bus.take(packet.read(4, 9, 1), [4], StatusPacket(4, 0, bytes([5])).encode())
    assert [report.message for report in bus.classifier.active()] == [
        "The Return Delay Time register of servo 4 on bus main holds 5; it should hold 0."
    ]


@pytest.mark.parametrize("goals", [0, 3])
def test_a_slow_servo_among_quick_peers_is_told_by_requests_to_it_alone(goals: int) -> None:
    bus = Bus(4)
    write = packet.sync_write(116, 4, dict.fromkeys(bus.ids, b"\1\2\3\4"))

    def round_of_pings() -> list[tuple[str, str]]:
        active: list[tuple[str, str]] = []
        for servo_id in bus.ids:
            took = (
                1_600_000 if servo_id == 3 and bus.stamp > START + (1 + goals) * 10**9 else 690_000
            )
            data = StatusPacket(servo_id, 0, b"\6\4\46").encode()
            times = [ResponseTime(id=servo_id, ns=took + servo_id * 1000)]
            active = bus.take(packet.ping(servo_id), [servo_id], data, response_times=times)
            for _ in range(goals):
                active = bus.take(write, [], b"")
        return active

    assert repeat(25, round_of_pings) == []
    assert repeat(8, round_of_pings) == [("slow_servo", "bus/main/servo/3")]
    [report] = bus.classifier.active()
    assert report.evidence.transaction is not None
    assert report.evidence.transaction.expected  # not one that nobody answers


def test_stray_bytes_are_told_once_nothing_has_explained_them_for_a_while() -> None:
    bus = Bus(3)
    repeat(5, bus.read_all)
    sparks = answer(1) + answer(2) + answer(3) + b"\xff\x00\xff\x12"
    bus.read_all(sparks)
    bus.read_all(sparks)
    seconds = 1_000_000_000 // PERIOD
    assert repeat(2 * seconds, bus.read_all) == []
    assert repeat(2 * seconds, bus.read_all) == [("stray_data", "bus/main")]
    assert repeat(2 * seconds, bus.read_all) == []


def jam(bus: Bus) -> None:
    """A rhythmic jammer, for long enough to be told."""
    data = b"\0" + b"\0".join(map(answer, bus.ids)) + b"\0"
    active = repeat(2, lambda: bus.read_all(data))
    assert ("rhythmic_jammer", "bus/main") in active


def answer_late(bus: Bus) -> None:
    """An answer that the host no longer waits for."""
    bus.take(b"", [], answer(4), purpose="observed")


@pytest.mark.parametrize(
    ("cause", "codes"),
    [(None, {"loose_contact"}), (jam, {"rhythmic_jammer"}), (answer_late, set())],
)
def test_a_wreck_that_is_explained_makes_no_cable_loose_that_was_unplugged(
    cause: Callable[[Bus], None] | None, codes: set[str]
) -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    active = repeat(100, lambda: bus.read_all(answer(1) + answer(2)))
    assert active == [("cable_break", "bus/main/cable/2-3")]
    assert repeat(50, bus.read_all) == []
    if cause is not None:
        cause(bus)
    bus.take(packet.ping(2), [2], b"\xff\xff\x5a\x89\xa9\xfa\x93\x83\xf2\x5c")
    bus.take(packet.ping(2), [2], StatusPacket(2, 0, b"\6\4\46").encode())
    active = [each for _ in range(60) for each in bus.read_all()]
    assert {code for code, _ in active} == codes


@pytest.mark.parametrize("late", [True, False])
def test_an_adapter_that_passes_answers_on_late_has_no_loose_contact(late: bool) -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    active: set[tuple[str, str]] = set()
    for _ in range(4):
        for _ in range(4):
            bus.read_all(b"")
        bus.take(packet.ping(1), [1], b"", purpose="ping")
        answers = b"".join(map(answer, bus.ids))
        ping = StatusPacket(1, 0, b"\6\4\46").encode()
        bus.take(packet.ping(1), [1], answers + ping if late else ping, purpose="ping")
        active.update(repeat(50, bus.read_all))
    codes = {code for code, _ in active}
    assert codes == ({"adapter_lag"} if late else {"loose_contact"})


@pytest.mark.parametrize("first", [1, 2, 3])
@pytest.mark.parametrize(("late_ns", "code"), [(2_000_000, "adapter_lag"), (0, "loose_contact")])
def test_who_answers_late_after_silence_had_been_held_back(
    late_ns: int, code: str, first: int
) -> None:
    """Also where what was held back first has been lost, and with it some of the answers."""
    bus = Bus(5)
    repeat(20, bus.read_all)
    active: set[tuple[str, str]] = set()
    answers = b"".join(map(answer, bus.ids[first - 1 :]))
    chunk = Chunk(at_ns=100_000 + 1_400_000 + late_ns, data=answers)
    for _ in range(12):
        repeat(2, lambda: bus.read_all(b""))
        bus.read_all(late_ns=late_ns, chunks=[chunk])
        active.update(repeat(20, bus.read_all))
    assert {each for each, _ in active} == {code}


@pytest.mark.parametrize(("late_ns", "first_ns"), [(7_000_000, 8_000_000), (7_000_000, 1_000_000)])
def test_an_adapter_that_stalls_is_told_unless_a_servo_is_slow(late_ns: int, first_ns: int) -> None:
    bus = Bus(3)
    data = [answer(servo_id) for servo_id in bus.ids]
    chunks = [
        Chunk(at_ns=100_000 + first_ns, data=data[0]),
        Chunk(at_ns=8_500_000, data=b"".join(data[1:])),
    ]
    for _ in range(3):
        bus.read_all(late_ns=late_ns, chunks=chunks)
        told = repeat(30, bus.read_all)
    assert told == ([("adapter_lag", "bus/main/adapter")] if first_ns > 5_000_000 else [])
    assert repeat(1200, bus.read_all) == []


def test_an_adapter_that_stalls_and_loses_some_of_what_it_held_back_has_no_loose_contact() -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    active: set[tuple[str, str]] = set()
    for _ in range(6):
        chunk = Chunk(at_ns=25_000_000, data=answer(1) + answer(2))
        bus.read_all(late_ns=23_000_000, chunks=[chunk])
        active.update(repeat(30, bus.read_all))
    assert active == {("adapter_lag", "bus/main/adapter")}


@pytest.mark.parametrize(("shown", "codes"), [(3, {"adapter_lag"}), (0, {"loose_contact"})])
def test_an_adapter_that_stalls_may_lose_all_that_it_held_back(shown: int, codes: set[str]) -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    stall(bus, shown)
    assert told_of_silences(bus, 6, 20) == codes


@pytest.mark.parametrize(("late_ns", "code"), [(23_000_000, "adapter_lag"), (0, "stray_data")])
def test_what_collides_when_a_stalled_adapter_goes_on_is_explained(late_ns: int, code: str) -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    whole = b"".join(map(answer, bus.ids))
    told: set[str] = set()
    for _ in range(6):
        bus.read_all(late_ns=late_ns, chunks=[Chunk(at_ns=1_500_000 + late_ns, data=whole)])
        bus.read_all(whole + b"\x31\x2b\xe1\xf6\x5a")
        for _ in range(70):
            told.update(code for code, _ in bus.read_all())
    assert told == {code}


@pytest.mark.parametrize("stalls", [0, 3])
def test_a_cable_that_cuts_off_the_same_servos_is_loose_though_the_adapter_stalls(
    stalls: int,
) -> None:
    bus = Bus(5)
    repeat(20, bus.read_all)
    stall(bus, stalls)
    active: set[tuple[str, str]] = set()
    for _ in range(5):
        bus.read_all(answer(1) + answer(2))
        active.update(repeat(60, bus.read_all))
    assert ("loose_contact", "bus/main/cable/2-3") in active


@pytest.mark.parametrize("heard", [True, False])
def test_silence_before_a_servo_has_come_up_is_no_failure(heard: bool) -> None:
    bus = Bus(5)
    if heard:
        repeat(2, bus.read_all)
    assert told_of_silences(bus, 4, 10) == ({"loose_contact"} if heard else set())


def test_a_bus_that_becomes_slower_does_not_stall() -> None:
    bus = Bus(3)
    chunk = Chunk(at_ns=16_000_000, data=b"".join(map(answer, bus.ids)))
    repeat(30, bus.read_all)
    assert repeat(40, lambda: bus.read_all(late_ns=14_000_000, chunks=[chunk])) == []


@pytest.mark.parametrize("known", [True, False])
def test_silence_of_who_is_gone_is_no_stall_even_if_the_next_answers_are_late(known: bool) -> None:
    """Which they are now and then on a computer that does much else."""
    bus = Bus(4)
    repeat(20, bus.read_all)
    there = b"".join(map(answer, [1, 2]))
    repeat(100, lambda: bus.read_all(there))  # the other two are gone from now on
    absent = 4 if known else 9
    chunk = Chunk(at_ns=3_500_000, data=there)
    for _ in range(12):
        bus.take(packet.ping(absent), [absent], b"", purpose="ping")
        active = bus.take(
            packet.sync_read([1, 2], 132, 4), [1, 2], there, late_ns=2_000_000, chunks=[chunk]
        )
        repeat(25, lambda: bus.take(packet.sync_read([1, 2], 132, 4), [1, 2], there))
    assert active == [("cable_break", "bus/main/cable/2-3")]
