"""Mode proxy with the vendor's library as the user's control software."""

import json
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import dynamixel_sdk as sdk
import msgspec
import pytest

from tests.conftest import wait_until
from tests.gateway.conftest import IDS, Bus, Gateway, StartGateway
from wackel_node.config import BusConfig
from wackel_node.precedence import may_come_first
from wackel_schemas import keys
from wackel_schemas.bus import BusRequest

pytestmark = [pytest.mark.process, pytest.mark.alone]

PRESENT_POSITION = (132, 4)
LED = 65


class Control:
    """The user's software: the vendor's library on one port."""

    def __init__(self, path: str) -> None:
        self.port = sdk.PortHandler(path)
        self.packets = sdk.PacketHandler(2.0)
        assert self.port.openPort()
        assert self.port.setBaudRate(1_000_000)

    def __enter__(self) -> "Control":
        return self

    def __exit__(self, *_: object) -> None:
        self.port.closePort()

    def ping(self, servo_id: int = 1) -> bool:
        return bool(self.packets.ping(self.port, servo_id)[1] == sdk.COMM_SUCCESS)

    def answered(self) -> bool:
        """Whether a ping is: one of three, since the library gives up after 34 ms, in which a busy
        machine may run neither the servo nor the proxy.
        """
        return any(self.ping() for _ in range(3))

    def goes_on(self, pings: int = 20) -> bool:
        """Whether pings are answered; few may be late, since the test shares the machine."""
        return sum(self.ping() for _ in range(pings)) >= 0.8 * pings

    def positions(self, *, fast: bool = False) -> dict[int, int]:
        group = sdk.GroupSyncRead(self.port, self.packets, *PRESENT_POSITION)
        for servo_id in IDS:
            group.addParam(servo_id)
        assert (group.fastSyncRead if fast else group.txRxPacket)() == sdk.COMM_SUCCESS
        return {servo_id: group.getData(servo_id, *PRESENT_POSITION) for servo_id in IDS}

    def everything(self) -> list[object]:
        """One of each kind of exchange, as the caller sees it."""
        packets, port = self.packets, self.port
        return [
            packets.ping(port, 1),
            packets.ping(port, 77),
            packets.broadcastPing(port),
            packets.read2ByteTxRx(port, 2, 0),
            packets.write1ByteTxRx(port, 2, LED, 1),
            packets.read1ByteTxRx(port, 2, LED),
            packets.write1ByteTxRx(port, 2, LED, 77),
            packets.readTxRx(port, 2, 60_000, 4),
            sorted(self.positions()),
            sorted(self.positions(fast=True)),
            packets.reboot(port, 6),
        ]


@pytest.fixture
def proxied(bus_config: BusConfig) -> BusConfig:
    return msgspec.structs.replace(bus_config, mode="proxy")


def connected(gateway: Gateway, config: BusConfig) -> Callable[[], bool]:
    return lambda: (
        Path(config.proxy_port).is_symlink() and any(told.connected for told in gateway.statistics)
    )


def test_the_vendors_library_sees_no_difference_to_the_bare_port(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    with Control(bus.config.port) as control:
        bare = control.everything()
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))
    with Control(proxied.proxy_port) as control:
        wait_until(lambda: control.ping(6))  # it was rebooted
        assert control.everything() == bare
    gateway.wait_until(lambda: any(t.instruction[7:8] == b"\x08" for t in gateway.transactions))
    kinds = {t.instruction[7] for t in gateway.transactions if t.instruction}
    assert kinds == {0x01, 0x02, 0x03, 0x82, 0x8A, 0x08}
    assert {t.purpose for t in gateway.transactions} == {"observed"}
    reads = [t for t in gateway.transactions if t.instruction[7:8] == b"\x82"]
    assert [answer.id for answer in reads[-1].response_times] == list(IDS)
    everyone = list(IDS)
    gateway.wait_until(
        lambda: any([servo.id for servo in state.servos] == everyone for state in gateway.states)
    )


def test_the_baud_rate_that_the_client_sets_is_set_on_the_real_port(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))
    with Control(proxied.proxy_port) as control:
        assert control.answered()
        control.port.setBaudRate(57_600)
        assert not control.ping()  # no servo hears this rate
        gateway.wait_until(lambda: gateway.statistics[-1].baud_rate == 57_600)
        control.port.setBaudRate(1_000_000)
        assert control.answered()


def test_control_goes_on_while_the_gateway_is_stopped_killed_and_started_again(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))
    with Control(proxied.proxy_port) as control:
        assert control.answered()
        os.kill(gateway.process.pid, signal.SIGSTOP)
        assert control.goes_on()
        os.kill(gateway.process.pid, signal.SIGKILL)
        gateway.process.wait(5)
        assert control.goes_on()
        second = start_gateway(proxied)
        second.wait_until(connected(second, proxied))
        assert control.positions().keys() == set(IDS)
        second.wait_until(lambda: any(len(t.expected) == len(IDS) for t in second.transactions))
        assert second.stop() == 0
    wait_until(lambda: not Path(proxied.proxy_port).is_symlink())


def forwarder(config: BusConfig) -> int:
    """Its process id."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended meanwhile
            told = path.read_text(errors="replace")
            if "wackel_gateway.forward" in told and json.dumps(config.proxy_port) in told:
                return int(path.parent.name)
    raise AssertionError("no forwarder runs")


def test_forwarding_takes_precedence_where_the_system_allows_it(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))
    policy = os.sched_getscheduler(forwarder(proxied))
    assert policy == (os.SCHED_FIFO if may_come_first() else os.SCHED_OTHER)
    # The user's software is the master: it does not wait for what only records.
    assert os.sched_getscheduler(gateway.process.pid) == os.SCHED_OTHER


def test_a_client_outlives_the_adapter_and_goes_on_when_it_is_back(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))
    with Control(proxied.proxy_port) as control:
        assert control.answered()
        bus.inject("unplugged")
        gateway.wait_until(lambda: any(f.status == "active" for f in gateway.faults))
        assert not control.ping()
        bus.heal()
        wait_until(control.ping)
        gateway.wait_until(lambda: gateway.faults[-1].status == "healed")


def test_a_port_that_takes_no_bytes_is_told_once(
    wire: int, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))

    client = os.open(proxied.proxy_port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)

    def told_again() -> bool:
        with suppress(BlockingIOError):  # the forwarder is waiting for the port
            os.write(client, bytes(1024))
        return sum(fault.repeated for fault in gateway.faults) >= 2

    gateway.wait_until(told_again)
    os.close(client)
    (fault,) = [fault for fault in gateway.faults if not fault.repeated]
    assert (fault.status, "takes no bytes" in fault.message) == ("active", True)


def test_commands_and_requests_are_refused_because_the_bus_belongs_to_another(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))
    request = BusRequest(operation="ping", id=1)
    reply = gateway.link.ask(keys.BUS_REQUEST, request, bus="main")
    assert (reply.ok, reply.transaction) == (False, None)
    gateway.wait_until(lambda: gateway.statistics[-1].rejected == {"not the master": 1})


def test_a_path_that_is_taken_is_a_configuration_error(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    Path(proxied.proxy_port).write_text("somebody's file")
    gateway = start_gateway(proxied)
    assert gateway.process.wait(10) != 0
    assert Path(proxied.proxy_port).read_text() == "somebody's file"


def test_a_stopped_gateway_loses_records_and_says_how_many(
    bus: Bus, proxied: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(proxied)
    gateway.wait_until(connected(gateway, proxied))
    lost = [0]
    gateway.link.subscribe(keys.ALIVE, lambda _, beat: lost.append(beat.lost), service="gateway")
    with Control(proxied.proxy_port) as control:
        os.kill(gateway.process.pid, signal.SIGSTOP)
        # The socket between the two holds some hundred records, then forwarding goes on without.
        assert control.goes_on(pings=1000)
        os.kill(gateway.process.pid, signal.SIGCONT)
        assert control.answered()
        gateway.wait_until(lambda: lost[-1] > 0)
