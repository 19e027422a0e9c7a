"""The byte sequences of the thesis (chapter 2.5) and what each shows."""

import pytest

from wackel_classifier.symptoms import Outcome, Sign, Symptoms, examine
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import AnswerReader
from wackel_protocols.dynamixel2.expectation import Expectation, expect
from wackel_protocols.dynamixel2.fast import encode_fast
from wackel_protocols.dynamixel2.packet import StatusPacket

ID_1 = bytes([255, 255, 253, 0, 1, 7, 0, 85, 0, 55, 1, 42, 154, 192])
ID_5 = bytes([255, 255, 253, 0, 5, 7, 0, 85, 0, 55, 1, 42, 130, 128])
ID_107 = bytes([255, 255, 253, 0, 107, 7, 0, 85, 0, 65, 1, 44, 93, 231])
WINDOW = 3528
"""252 answers of 14 bytes: what fits into a broadcast ping (thesis, 2.5.5)."""

ANSWERED, SILENT, LOST, DAMAGED, UNTESTED = Outcome


def broadcast(data: bytes, *ids: int) -> Symptoms:
    expectation = Expectation(ids, (14,) * len(ids), broadcast_ping=True)
    return examine(expectation, AnswerReader(expectation).read(data), data, WINDOW)


def group(data: bytes, *ids: int, capacity: int = 400) -> Symptoms:
    """The answer to a sync read of the three bytes that a ping's answer holds, too."""
    expectation = expect(packet.sync_read(ids, 0, 3))
    return examine(expectation, AnswerReader(expectation).read(data), data, capacity)


@pytest.mark.parametrize("zeros", [1, 2, 7])
def test_only_zeros_are_a_lost_signal(zeros: int) -> None:
    assert broadcast(bytes(zeros), 1, 5).sign is Sign.NO_SIGNAL


def test_silence_is_a_lost_signal() -> None:
    assert broadcast(b"", 1, 5).sign is Sign.NO_SIGNAL


def test_packets_of_some_servos_are_an_incomplete_bus() -> None:
    symptoms = broadcast(ID_107, 107, 5)
    assert symptoms.sign is Sign.INCOMPLETE
    assert symptoms.outcomes == [ANSWERED, SILENT]


def test_packets_of_all_servos_and_nothing_else_are_health() -> None:
    assert broadcast(ID_1 + ID_5, 1, 5).sign is Sign.HEALTHY


def test_bytes_of_nobody_beside_a_packet_are_stray() -> None:
    data = bytes([0, 0, 0, 0, 0, 0, 0, 12, 0, 222, 0]) + ID_1 + b"\0"
    symptoms = broadcast(data, 1)
    assert symptoms.sign is Sign.STRAY
    assert symptoms.packets == 1
    assert symptoms.zeros + symptoms.stray == 12


def test_a_zero_before_and_after_every_packet_is_a_rhythmic_jammer() -> None:
    assert broadcast(b"\0" + ID_1 + b"\0" + ID_5 + b"\0", 1, 5).sign is Sign.RHYTHMIC


def test_two_zeros_between_packets_are_no_rhythm() -> None:
    assert broadcast(b"\0" + ID_1 + b"\0\0" + ID_5 + b"\0", 1, 5).sign is not Sign.RHYTHMIC


def test_a_window_full_of_bytes_is_a_permanent_jammer() -> None:
    chunk = bytes([12, 6, 0, 12, 2, 4, 198, 0, 0])
    data = chunk * 40 + ID_1 + bytes([0, 0, 0, 0, 0, 96]) + chunk * 400
    symptoms = broadcast(data[:WINDOW], 1, 5)
    assert symptoms.sign is Sign.SATURATED
    assert symptoms.filled > 0.9


def test_a_silent_servo_leaves_those_behind_it_in_the_request_untested() -> None:
    assert group(ID_1, 1, 5, 107).outcomes == [ANSWERED, SILENT, UNTESTED]


def test_a_servo_missed_before_one_that_answers_was_lost_on_the_way() -> None:
    assert group(ID_1 + ID_107, 1, 5, 107).outcomes == [ANSWERED, LOST, ANSWERED]


def test_altered_bytes_in_an_answers_own_place_are_damage_and_not_stray() -> None:
    noisy = bytearray(ID_5)
    noisy[0] ^= 4  # even the header
    symptoms = group(ID_1 + bytes(noisy) + ID_107, 1, 5, 107)
    assert symptoms.outcomes == [ANSWERED, DAMAGED, ANSWERED]
    assert symptoms.sign is Sign.INCOMPLETE


def test_half_a_packet_and_then_silence_is_torn() -> None:
    symptoms = group(ID_1 + ID_5[:9], 1, 5, 107)
    assert symptoms.outcomes == [ANSWERED, DAMAGED, UNTESTED]
    assert symptoms.broken == 9


def test_a_spark_in_the_silence_is_stray() -> None:
    symptoms = group(ID_1 + b"\xff\x00\xff\x7f", 1, 5, 107)
    assert symptoms.outcomes == [ANSWERED, SILENT, UNTESTED]
    assert symptoms.stray > 0


IDS = (1, 5, 107)
FAST = expect(packet.fast_sync_read(IDS, 132, 4))
VALUES = [(0, bytes([1, 2, 3, 4]))] * 3


def fast(data: bytes) -> Symptoms:
    return examine(FAST, AnswerReader(FAST).read(data), data, 400)


def test_a_fast_answer_that_ends_early_shows_whose_turn_it_was() -> None:
    symptoms = fast(encode_fast(FAST, VALUES[:1]))
    assert symptoms.outcomes == [ANSWERED, SILENT, UNTESTED]
    assert symptoms.sign is Sign.INCOMPLETE


def test_damage_in_one_block_of_a_fast_answer_is_that_servos() -> None:
    data = bytearray(encode_fast(FAST, VALUES))
    data[8 + 8 + 3] ^= 1
    assert fast(bytes(data)).outcomes == [ANSWERED, DAMAGED, ANSWERED]


def test_a_block_missing_from_a_fast_answer_was_lost() -> None:
    data = encode_fast(FAST, VALUES)
    assert fast(data[:16] + data[24:]).outcomes == [ANSWERED, LOST, UNTESTED]


def test_zeros_after_each_block_of_a_fast_answer_are_rhythmic() -> None:
    data = encode_fast(FAST, VALUES)
    beaten = b"\0" + data[:16] + b"\0" + data[16:24] + b"\0" + data[24:] + b"\0"
    symptoms = fast(beaten)
    assert symptoms.sign is Sign.RHYTHMIC
    assert symptoms.outcomes == [ANSWERED] * 3


def test_a_clean_answer_shows_nothing() -> None:
    data = b"".join(StatusPacket(i, 0, b"\x37\x01\x2a").encode() for i in IDS)
    symptoms = group(data, *IDS)
    assert symptoms.sign is Sign.HEALTHY
    assert symptoms.outcomes == [ANSWERED] * 3


def test_one_zero_before_a_whole_fast_answer_is_no_rhythm() -> None:
    symptoms = fast(bytes(1) + encode_fast(FAST, VALUES))
    assert symptoms.outcomes == [ANSWERED] * len(IDS)
    assert symptoms.sign is not Sign.RHYTHMIC
