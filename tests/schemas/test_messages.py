"""The wire as any other language sees it: plain MessagePack maps with names."""

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_schemas import keys, wire
from wackel_schemas.bus import BusState, Chunk, ResponseTime, ServoState, Transaction
from wackel_schemas.fault import Evidence, FaultReport


def a_transaction() -> Transaction:
    return Transaction(
        stamp=1_700_000_000_000_000_000,
        boot=7,
        seq=3,
        purpose="cycle",
        instruction=b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e",
        sent_ns=100_000,
        chunks=[Chunk(at_ns=700_000, data=b"\xff\xff"), Chunk(at_ns=800_000, data=b"\xfd")],
        expected=[1],
        expected_bytes=14,
        deadline_ns=3_000_000,
        ended_ns=800_000,
        baud_rate=1_000_000,
        response_times=[ResponseTime(id=1, ns=700_000)],
    )


def test_an_independent_reader_sees_maps_with_names() -> None:
    plain = msgpack.unpackb(wire.encode(a_transaction()))
    assert plain["instruction"] == b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e"
    assert plain["chunks"][1] == {"at_ns": 800_000, "data": b"\xfd"}
    assert plain["stamp"] == 1_700_000_000_000_000_000
    assert plain["boot"] == 7
    assert plain["seq"] == 3


def test_what_an_independent_writer_sends_is_read() -> None:
    plain = {"stamp": 5, "servos": [{"id": 3, "position": 1.5}]}
    state = wire.decode(msgpack.packb(plain), BusState)
    assert state == BusState(stamp=5, servos=[ServoState(id=3, position=1.5)])


def test_a_value_that_was_not_received_is_absent_on_the_wire() -> None:
    plain = msgpack.unpackb(wire.encode(BusState(stamp=1, servos=[ServoState(id=1, voltage=12.0)])))
    assert plain["servos"] == [{"id": 1, "voltage": 12.0}]


def test_evidence_carries_the_raw_transaction() -> None:
    report = FaultReport(
        stamp=1,
        code="cable_break",
        component="bus/main/cable/1-2",
        status="active",
        confidence=0.9,
        message="m",
        remedy="r",
        evidence=Evidence(summary="s", values={"missing": 3}, transaction=a_transaction()),
        since=1,
    )
    assert wire.decode(wire.encode(report), FaultReport) == report


def test_an_unknown_field_of_a_newer_version_is_ignored() -> None:
    data = msgpack.packb({"stamp": 1, "servos": [], "invented_later": 1})
    assert wire.decode(data, BusState) == BusState(stamp=1, servos=[])


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_rejected_with_a_reason(data: bytes) -> None:
    for topic in keys.TOPICS:
        try:
            wire.decode(data, topic.message)
        except wire.Rejected as error:
            assert str(error).startswith(f"no {topic.message.__name__}: ")


@given(st.data())
def test_a_damaged_message_is_a_message_or_rejected(data: st.DataObject) -> None:
    intact = wire.encode(a_transaction())
    at = data.draw(st.integers(0, len(intact) - 1))
    byte = data.draw(st.integers(0, 255))
    damaged = intact[:at] + bytes([byte]) + intact[at + 1 :]
    try:
        wire.decode(damaged, Transaction)
    except wire.Rejected:
        return


def test_every_key_leads_back_to_its_topic() -> None:
    for topic in keys.TOPICS:
        names = [p[1:-1] for p in topic.pattern.split("/") if p.startswith("{")]
        key = topic.key(**dict.fromkeys(names, "x"))
        assert keys.topic_of(key) is topic
        for name in names:
            assert keys.chunk_of(topic, key, name) == "x"


def test_a_foreign_key_has_no_topic() -> None:
    assert keys.topic_of("bus/main") is None
    assert keys.topic_of("bus/main/state/more") is None


def test_a_key_without_the_chunk_is_refused() -> None:
    with pytest.raises(ValueError, match="has no chunk bus"):
        keys.chunk_of(keys.HEALTH, "health", "bus")


def test_records_that_are_encoded_once_make_the_same_bytes() -> None:
    encoded = wire.EncodedOnce[ServoState]()
    servos = [ServoState(id=1, voltage=12.0), ServoState(id=2)]
    for _ in range(2):
        state = BusState(stamp=1, servos=encoded(servos))
        assert wire.encode(state) == wire.encode(BusState(stamp=1, servos=servos))
        servos = [ServoState(id=3), servos[1], servos[1]]


def test_nothing_is_remembered_of_records_that_are_no_longer_asked_for() -> None:
    encoded = wire.EncodedOnce[ServoState]()
    first, second = encoded([ServoState(id=1)]), encoded([ServoState(id=2)])
    assert wire.encode(BusState(stamp=1, servos=first)) != wire.encode(
        BusState(stamp=1, servos=second)
    )
