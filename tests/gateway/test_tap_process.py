"""Mode tap: a second adapter that hears both directions of somebody else's traffic."""

import os
import signal

import msgspec
import pytest

from tests.gateway.conftest import StartGateway
from wackel_node.config import BusConfig
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.packet import StatusPacket
from wackel_schemas import keys
from wackel_schemas.bus import BusRequest

pytestmark = [pytest.mark.process, pytest.mark.alone]


def test_a_tap_publishes_what_it_hears_and_writes_nothing(
    wire: int, bus_config: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(msgspec.structs.replace(bus_config, mode="tap"))
    gateway.wait_until(lambda: any(told.connected for told in gateway.statistics))
    read = packet.sync_read([1, 2], 132, 4)
    answers = [StatusPacket(i, 0, (2048).to_bytes(4, "little")).encode() for i in (1, 2)]
    os.write(wire, read)
    os.write(wire, answers[0])
    os.write(wire, answers[1])
    gateway.wait_until(lambda: bool(gateway.states))
    (transaction,) = gateway.transactions
    assert (transaction.purpose, transaction.instruction) == ("observed", read)
    assert transaction.received() == b"".join(answers)
    assert [(servo.id, servo.position) for servo in gateway.states[0].servos] == [(1, 0), (2, 0)]

    os.write(wire, read + answers[0])
    gateway.wait_until(lambda: len(gateway.transactions) == 2)
    assert [answer.id for answer in gateway.transactions[1].response_times] == [1]

    reply = gateway.link.ask(keys.BUS_REQUEST, BusRequest(operation="ping", id=1), bus="main")
    assert not reply.ok
    os.set_blocking(wire, False)
    with pytest.raises(BlockingIOError):
        os.read(wire, 1)
    assert gateway.stop(signal.SIGINT) == 0


def test_a_bus_on_which_nobody_asks_is_told_and_healed_by_the_first_who_does(
    wire: int, bus_config: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(msgspec.structs.replace(bus_config, mode="tap"))
    gateway.wait_until(lambda: bool(gateway.faults))
    quiet = gateway.faults[0]
    assert (quiet.code, quiet.component, quiet.status) == ("bus_quiet", "bus/main", "active")
    os.write(wire, packet.ping(1))
    gateway.wait_until(lambda: gateway.faults[-1].status == "healed")
