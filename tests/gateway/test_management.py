"""Requests over the vendor's library: its defects made good, nonsense refused before it is sent."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.gateway.conftest import IDS
from wackel_gateway.commands import Refused
from wackel_gateway.exchange import Exchange
from wackel_gateway.management import Management
from wackel_gateway.outcome import Outcome
from wackel_gateway.patience import Patience
from wackel_gateway.port import Port
from wackel_gateway.roster import Roster
from wackel_node.config import BusConfig
from wackel_schemas.bus import BusReply, BusRequest, Transaction
from wackel_schemas.virtual import Injection
from wackel_virtual.bus import VirtualBus
from wackel_virtual.port import Ports

RUN_TWICE = b"\xff\xff\xfd\xff\xff\xfd"


class Desk:
    """Management of a virtual bus, and what it published."""

    def __init__(self, ports: Ports, port: Port, config: BusConfig) -> None:
        self._ports = ports
        self.published: list[Transaction] = []
        exchange = Exchange(port, Patience(config.baud_rate), lambda: False)
        self._management = Management(exchange, Roster(config.servos), self._publish)

    def ask(self, request: BusRequest) -> BusReply:
        return self._management.carry_out(request, stamp=5)

    def inject(self, kind: str, servo: int) -> None:
        injection = Injection(kind=kind, servo=servo)
        self._ports.call(lambda buses: buses["main"].inject(injection))

    def _publish(self, outcome: Outcome) -> Transaction:
        self.published.append(outcome.message(0))
        return self.published[-1]


@pytest.fixture
def desk(bus_config: BusConfig) -> Iterator[Desk]:
    with (
        Ports({"main": (VirtualBus(bus_config, seed=1), Path(bus_config.port))}) as ports,
        Port(bus_config.port, bus_config.baud_rate) as port,
    ):
        yield Desk(ports, port, bus_config)


def test_bytes_that_look_like_a_header_go_out_and_come_back_unharmed(desk: Desk) -> None:
    address = 578  # XM430: indirect data 1, which takes any byte
    write = BusRequest(
        operation="raw",
        id=1,
        instruction=3,
        parameters=address.to_bytes(2, "little") + RUN_TWICE,
    )
    assert desk.ask(write).ok
    assert RUN_TWICE not in desk.published[-1].instruction
    assert b"\xff\xff\xfd\xfd\xff\xff\xfd\xfd" in desk.published[-1].instruction
    value = int.from_bytes(b"\xff\xff\xfd\x00", "little")
    vendor = desk.ask(BusRequest(operation="write", id=1, address=address, length=4, value=value))
    assert (vendor.ok, vendor.stamp) == (True, 5)
    assert b"\xff\xff\xfd\xfd\x00" in desk.published[-1].instruction


def test_every_exchange_is_published_as_a_request(desk: Desk) -> None:
    reply = desk.ask(BusRequest(operation="ping", id=1))
    assert [t.purpose for t in desk.published] == ["request"]
    assert reply.transaction is desk.published[0]
    assert reply.ids == [1]


def test_the_servos_refusal_is_told_in_words(desk: Desk) -> None:
    reply = desk.ask(BusRequest(operation="read", id=1, address=60_000, length=4))
    assert (reply.ok, reply.value) == (False, None)
    assert reply.text.startswith("access error: ")


def test_an_alert_is_told_beside_what_was_done(desk: Desk) -> None:
    desk.inject("overload", 1)
    reply = desk.ask(BusRequest(operation="ping", id=1))
    assert reply.ok
    assert reply.text == "model number 1030; alert: Hardware Error Status is set"


def test_no_answer_is_told_apart_from_a_damaged_one(desk: Desk) -> None:
    silent = desk.ask(BusRequest(operation="ping", id=77))
    desk.inject("duplicate_id", 1)
    damaged = desk.ask(BusRequest(operation="ping", id=1))
    assert [(reply.ok, reply.text) for reply in (silent, damaged)] == [
        (False, "no answer"),
        (False, "its answer came damaged"),
    ]


def test_a_scan_finds_all_and_a_factory_reset_keeps_id_and_baud_rate(desk: Desk) -> None:
    assert desk.ask(BusRequest(operation="scan")).ids == list(IDS)
    assert desk.ask(BusRequest(operation="factory_reset", id=2)).ok


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        (BusRequest(operation="ping", id=253), "unknown servo"),
        (BusRequest(operation="ping", id=-1), "unknown servo"),
        (BusRequest(operation="reboot"), "unknown servo"),
        (BusRequest(operation="read", id=1), "incomplete request"),
        (BusRequest(operation="read", id=1, register="wheel"), "no such register"),
        (BusRequest(operation="read", id=99, register="led"), "unknown servo"),
        (BusRequest(operation="read", id=1, address=1, length=0), "out of range"),
        (BusRequest(operation="read", id=1, address=-1, length=1), "out of range"),
        (BusRequest(operation="write", id=1, register="led"), "incomplete request"),
        (BusRequest(operation="write", id=1, register="moving", value=1), "read only"),
        (BusRequest(operation="write", id=1, register="id", value=253), "out of range"),
        (BusRequest(operation="write", id=1, address=65, length=3, value=1), "out of range"),
        (BusRequest(operation="write", id=1, address=65, length=1, value=256), "out of range"),
        (BusRequest(operation="raw", id=1), "incomplete request"),
        (BusRequest(operation="raw", id=1, instruction=0x55), "no packet"),
        (BusRequest(operation="raw", id=1, instruction=300), "no packet"),
        (BusRequest(operation="raw", id=1, instruction=1, parameters=bytes(70_000)), "no packet"),
        (BusRequest(operation="raw", id=1, instruction=99, answers=[1, 1]), "unknown servo"),
        (BusRequest(operation="raw", id=1, instruction=99, answers=[300]), "unknown servo"),
    ],
)
def test_nonsense_is_refused_with_a_reason_and_nothing_is_sent(
    desk: Desk, request_: BusRequest, reason: str
) -> None:
    with pytest.raises(Refused) as refusal:
        desk.ask(request_)
    assert refusal.value.reason == reason
    assert desk.published == []


def test_who_answers_an_unknown_instruction_is_said_by_the_request(desk: Desk) -> None:
    reply = desk.ask(BusRequest(operation="raw", id=1, instruction=0x77, answers=[1]))
    assert reply.ids == [1]  # with an instruction error, but it answers
    assert not desk.ask(BusRequest(operation="raw", id=77, instruction=0x77, answers=[77])).ok
