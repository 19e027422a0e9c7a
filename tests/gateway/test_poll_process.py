"""Mode poll on a real pseudo-terminal, with servos that go silent and adapters that come out."""

import os
import signal
from itertools import groupby
from pathlib import Path

import msgspec
import pytest

from tests.conftest import wait_until
from tests.gateway.conftest import IDS, Bus, StartGateway, stuff
from wackel_node.config import BusConfig
from wackel_schemas import keys
from wackel_schemas.bus import BusCommand, BusReply, BusRequest, BusState, ServoGoal, Transaction

pytestmark = [pytest.mark.process, pytest.mark.alone]


def test_all_servos_are_read_at_the_configured_rate(bus: Bus, start_gateway: StartGateway) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    gateway.wait_until(lambda: len(gateway.statistics) >= 3)
    last = gateway.statistics[-1]
    # Slots have fixed times, so a late cycle is followed by one in time.
    assert last.cycle_rate == pytest.approx(bus.config.rate, rel=0.1)
    assert last.bytes_received == (
        last.packet_bytes + last.bad_bytes + last.zero_bytes + last.stray_bytes
    )
    assert last.connected
    assert [servo.id for servo in last.servos] == list(IDS)
    whole = next(state for state in reversed(gateway.states) if len(state.servos) == len(IDS))
    assert all(servo.position is not None for servo in whole.servos)


def test_a_state_that_came_late_says_so(bus: Bus, start_gateway: StartGateway) -> None:
    gateway = start_gateway(msgspec.structs.replace(bus.config, rate=50.0))
    gateway.wait_until(gateway.answering(IDS))
    gateway.states.clear()
    gateway.wait_until(lambda: len(gateway.states) >= 100)
    late = [state for state in gateway.states if state.late_s > 0.001]
    assert len(late) < 10  # beside other load
    gateway.states.clear()

    def came_late() -> bool:
        bus.stall(0.012)
        gateway.link.pump(0.1)
        return any(state.late_s > 0.004 for state in gateway.states)

    gateway.wait_until(came_late)
    assert all(state.late_s < 1.0 for state in gateway.states)


def test_slow_registers_come_between_the_cycles(bus: Bus, start_gateway: StartGateway) -> None:
    gateway = start_gateway(bus.config)

    def told() -> bool:
        servos = [servo for state in gateway.states for servo in state.servos]
        return (
            {s.id for s in servos if s.voltage is not None}
            == set(IDS)
            == {s.id for s in servos if s.torque_enabled is not None}
        )

    gateway.wait_until(told)


@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_whatever_travels_with_what_is_told_in_the_order_of_the_bus(
    bus: Bus, start_gateway: StartGateway, rate: float
) -> None:
    gateway = start_gateway(msgspec.structs.replace(bus.config, rate=rate))
    gateway.wait_until(gateway.answering(IDS))
    # Alone, with a silent servo's pings between, and through a request.
    gateway.wait_until(lambda: sum(t.purpose == "background" for t in gateway.transactions) > 20)
    bus.inject("silent", servo=3)
    gateway.wait_until(lambda: sum(t.purpose == "ping" for t in gateway.transactions) > len(IDS))
    reply = gateway.link.ask(
        keys.BUS_REQUEST, BusRequest(operation="ping", id=1), timeout_s=5.0, bus="main"
    )
    assert reply.ok, reply.text
    gateway.wait_until(lambda: gateway.transactions[-1].purpose == "background")
    stamps = [t.stamp for t in gateway.transactions]
    assert stamps == sorted(stamps)
    numbers = [t.seq for t in gateway.transactions]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_transactions_without_news_travel_together_states_and_trouble_do_not_wait(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(msgspec.structs.replace(bus.config, rate=200.0))
    gateway.wait_until(gateway.answering(IDS))
    told: list[BusState | Transaction] = []
    gateway.link.subscribe(keys.STATE, lambda _, state: told.append(state))
    gateway.link.subscribe(keys.TRANSACTION, lambda _, transaction: told.append(transaction))

    def together() -> bool:
        kinds = [isinstance(message, BusState) for message in told]
        runs = [len(list(run)) for is_state, run in groupby(kinds) if is_state]
        return max(runs, default=0) > 2

    gateway.wait_until(together)
    bus.inject("silent", servo=3)

    def missed() -> list[Transaction]:
        cycles = [t for t in told if isinstance(t, Transaction) and 3 in t.expected]
        return [t for t in cycles if 3 not in {answer.id for answer in t.response_times}]

    gateway.wait_until(lambda: bool(missed()))
    first = missed()[0]
    before = [each for each in told[: told.index(first)] if isinstance(each, BusState)]
    assert all(state.stamp < first.stamp for state in before)


def test_a_silent_servo_costs_the_others_at_most_one_cycle(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    gateway.transactions.clear()
    bus.inject("silent", servo=3)
    rest = tuple(servo_id for servo_id in IDS if servo_id != 3)
    gateway.wait_until(gateway.answering(rest))
    # One cycle at most: a fast read, and at once a plain one that tells who is silent.
    cycles = [t for t in gateway.transactions if t.purpose == "cycle" and 3 in t.expected]
    missed = [t for t in cycles if 3 not in {answer.id for answer in t.response_times}]
    assert len(missed) <= 2
    gateway.wait_until(
        lambda: any(t.purpose == "ping" and t.expected == [3] for t in gateway.transactions)
    )
    bus.heal()
    gateway.wait_until(gateway.answering(IDS))


def test_what_is_asked_again_says_so(bus: Bus, start_gateway: StartGateway) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    bus.inject("silent", servo=3)
    gateway.wait_until(lambda: any(state.asked_again for state in gateway.states))
    again = [state for state in gateway.states if state.asked_again]
    # Those behind it, in the cycle in which it fell silent; from then on cycles are without it.
    assert [[servo.id for servo in state.servos] for state in again] == [[4, 5, 6]]
    gateway.wait_until(lambda: gateway.states[-1].stamp > again[0].stamp + 200_000_000)
    assert again == [state for state in gateway.states if state.asked_again]


def test_behind_a_broken_cable_every_servo_is_pinged_and_comes_back(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    bus.inject("break", servo=4)
    gateway.wait_until(gateway.answering((1, 2, 3)))
    del gateway.transactions[:]
    gateway.wait_until(
        lambda: {t.expected[0] for t in gateway.transactions if t.purpose == "ping"} == {4, 5, 6}
    )
    bus.heal()
    gateway.wait_until(gateway.answering(IDS))


def test_an_adapter_that_is_unplugged_is_a_fault_at_once_and_heals(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    bus.inject("unplugged")
    gateway.wait_until(lambda: any(f.status == "active" for f in gateway.faults))
    fault = gateway.faults[0]
    assert (fault.code, fault.component) == ("adapter_unplugged", "bus/main/adapter")
    gateway.wait_until(lambda: any(f.repeated for f in gateway.faults))
    bus.heal()
    gateway.wait_until(lambda: gateway.faults[-1].status == "healed")
    del gateway.transactions[:]
    gateway.wait_until(gateway.answering(IDS))
    gateway.wait_until(lambda: gateway.statistics[-1].reconnects == 1)
    assert gateway.statistics[-1].servos[0].received > 10  # counters were kept


def test_a_port_that_takes_no_bytes_is_told_once_and_heals(
    wire: int, bus_config: BusConfig, start_gateway: StartGateway
) -> None:
    held = stuff(Path(bus_config.port))
    gateway = start_gateway(bus_config)
    gateway.wait_until(lambda: any(fault.repeated for fault in gateway.faults))
    (fault,) = [fault for fault in gateway.faults if not fault.repeated]
    assert (fault.status, "takes no bytes" in fault.message) == ("active", True)
    while held > 0:
        held -= len(os.read(wire, held))
    gateway.wait_until(lambda: gateway.faults[-1].status == "healed")


def test_without_an_adapter_it_waits_says_so_and_stops_at_once(
    bus_config: BusConfig, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus_config)
    gateway.wait_until(lambda: bool(gateway.faults))
    assert "there is no such port" in gateway.faults[0].message
    goals = [ServoGoal(id=1, torque_enabled=True)]
    gateway.link.publisher(keys.COMMAND, bus="main").put(BusCommand(stamp=0, goals=goals))
    ping = BusRequest(operation="ping", id=1)
    reply = gateway.link.ask(keys.BUS_REQUEST, ping, bus="main", timeout_s=5)
    assert (reply.ok, reply.text) == (False, f"port not open: {bus_config.port}")
    gateway.wait_until(
        lambda: any(told.rejected == {"port not open": 2} for told in gateway.statistics)
    )
    assert gateway.stop(signal.SIGINT) == 0


def test_commands_move_servos_and_impossible_ones_are_refused_whole(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    command = gateway.link.publisher(keys.COMMAND, bus="main")
    nan = [ServoGoal(id=1, torque_enabled=True), ServoGoal(id=2, velocity=float("nan"))]
    for goals in (
        [ServoGoal(id=servo_id, torque_enabled=True, position=0.5) for servo_id in IDS],
        [ServoGoal(id=99, position=0.0)],
        nan,
    ):
        command.put(BusCommand(stamp=0, goals=goals))
    gateway.wait_until(
        lambda: any(
            abs((servo.position or 0.0) - 0.5) < 0.02
            for state in gateway.states[-5:]
            for servo in state.servos
        )
    )
    gateway.wait_until(lambda: any(len(told.rejected) == 2 for told in gateway.statistics))
    last = gateway.statistics[-1]
    assert (last.commands, last.rejected) == (1, {"unknown servo": 1, "not a number": 1})


def test_a_motor_stops_when_what_commands_it_is_silent(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    mode = BusRequest(operation="write", id=2, register="operating_mode", value=1)
    assert gateway.link.ask(keys.BUS_REQUEST, mode, bus="main", timeout_s=5).ok
    goal = ServoGoal(id=2, torque_enabled=True, velocity=1.0)

    def velocity() -> float:
        for state in reversed(gateway.states):
            for servo in state.servos:
                if servo.id == 2 and servo.velocity is not None:
                    return servo.velocity
        return 0.0

    command = gateway.link.publisher(keys.COMMAND, bus="main")
    command.put(BusCommand(stamp=0, goals=[goal], timeout_s=float("inf")))
    command.put(BusCommand(stamp=0, goals=[goal], timeout_s=1.0))
    gateway.wait_until(lambda: velocity() > 0.9)
    gateway.wait_until(lambda: abs(velocity()) < 0.1)
    gateway.wait_until(lambda: any(told.timed_out == 1 for told in gateway.statistics))
    assert gateway.statistics[-1].rejected == {"no timeout": 1}


def test_motors_that_were_commanded_for_a_time_stop_when_the_gateway_does(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))
    for servo_id in (2, 3):
        mode = BusRequest(operation="write", id=servo_id, register="operating_mode", value=1)
        assert gateway.link.ask(keys.BUS_REQUEST, mode, bus="main", timeout_s=5).ok
    command = gateway.link.publisher(keys.COMMAND, bus="main")
    for servo_id, timeout_s in ((2, 60.0), (3, None)):
        goal = ServoGoal(id=servo_id, torque_enabled=True, velocity=1.0)
        command.put(BusCommand(stamp=0, goals=[goal], timeout_s=timeout_s))
    gateway.wait_until(lambda: any(told.commands == 2 for told in gateway.statistics))
    assert gateway.stop() == 0
    again = start_gateway(bus.config)
    again.wait_until(again.answering(IDS))

    def goal_velocity(servo_id: int) -> int | None:
        read = BusRequest(operation="read", id=servo_id, register="goal_velocity")
        return again.link.ask(keys.BUS_REQUEST, read, bus="main", timeout_s=5).value

    assert goal_velocity(2) == 0
    assert goal_velocity(3) == 42  # of 0.229 rev/min: 1 rad/s, as it was told


def test_requests_run_between_cycles_and_are_answered_in_words(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(gateway.answering(IDS))

    def ask(request: BusRequest) -> BusReply:
        return gateway.link.ask(keys.BUS_REQUEST, request, bus="main", timeout_s=5)

    assert ask(BusRequest(operation="ping", id=2)).value == 1030
    read = ask(BusRequest(operation="read", id=2, register="return_delay_time"))
    assert (read.ok, read.value) == (True, 0)
    assert read.transaction is not None
    assert read.transaction.purpose == "request"
    assert ask(BusRequest(operation="write", id=2, register="led", value=1)).ok
    assert ask(BusRequest(operation="read", id=2, register="led")).value == 1
    assert ask(BusRequest(operation="ping", id=77)).text == "no answer"
    refused = ask(BusRequest(operation="write", id=2, register="present_position", value=1))
    assert (refused.ok, refused.transaction) == (False, None)
    assert ask(BusRequest(operation="scan")).ids == list(IDS)
    assert ask(BusRequest(operation="reboot", id=6)).ok
    gateway.wait_until(gateway.answering(IDS))
    gateway.wait_until(lambda: any(told.rejected for told in gateway.statistics))
    assert gateway.statistics[-1].rejected == {"read only": 1}


def test_fast_sync_read_is_used_where_the_firmware_knows_it(
    bus: Bus, start_gateway: StartGateway
) -> None:
    gateway = start_gateway(bus.config)
    gateway.wait_until(lambda: bool(gateway.statistics) and gateway.statistics[-1].fast_sync_read)
    gateway.stop()
    plain = start_gateway(msgspec.structs.replace(bus.config, fast_sync_read=False))
    plain.wait_until(plain.answering(IDS))
    assert {t.instruction[7] for t in plain.transactions if t.purpose == "cycle"} == {0x82}


def test_a_gateway_that_is_killed_leaves_the_port_to_the_next(
    bus: Bus, start_gateway: StartGateway
) -> None:
    first = start_gateway(bus.config)
    first.wait_until(first.answering(IDS))
    first.stop(signal.SIGKILL)
    second = start_gateway(bus.config)
    second.wait_until(second.answering(IDS))
    assert second.stop() == 0
    wait_until(lambda: Path(bus.config.port).exists())
