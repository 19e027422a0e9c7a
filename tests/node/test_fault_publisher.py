"""What a service takes in is told with what it concludes from it."""

import pytest

from tests.conftest import Rendezvous, wait_until
from wackel_node.fault_publisher import FaultPublisher
from wackel_node.link import Link
from wackel_node.node import Node
from wackel_schemas import keys
from wackel_schemas.bus import BusCommand
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.inputs import Inputs
from wackel_schemas.message import Message

pytestmark = pytest.mark.process


def report(seq: int) -> FaultReport:
    return FaultReport(
        stamp=seq,
        code="noise",
        component="bus/main",
        status="active",
        confidence=0.5,
        message="It hums.",
        remedy="",
        evidence=Evidence(summary="50 Hz"),
        since=seq,
    )


def test_a_fault_comes_with_the_inputs_that_led_to_it_and_again_later(
    rendezvous: Rendezvous,
) -> None:
    heard: list[Message] = []
    with Link(rendezvous.config) as other, Node("sample", "main", rendezvous.config) as node:
        commands = other.publisher(keys.COMMAND, bus="main")
        other.subscribe(keys.INPUTS, lambda _, message: heard.append(message))
        other.subscribe(keys.FAULT, lambda _, message: heard.append(message))
        node.keep_journal()
        active: list[FaultReport] = []
        faults = FaultPublisher(node, "sample", lambda: active)

        def conclude(_: str, command: BusCommand) -> None:
            active[:] = [report(command.seq)]
            faults.put(active[0])

        node.subscribe(keys.COMMAND, conclude)

        def turn() -> None:
            node.pump(0.02)
            other.pump(0.02)

        wait_until(lambda: commands.has_reader, meanwhile=turn)
        commands.put(BusCommand(stamp=1, goals=[]))
        wait_until(lambda: any(isinstance(m, FaultReport) and m.repeated for m in heard), 10, turn)
    fault, inputs = heard[:2]
    assert isinstance(inputs, Inputs)
    assert inputs.seq == 0
    assert [(s.key, s.boot, s.seq) for s in inputs.streams] == [("bus/main/command", other.boot, 0)]
    assert inputs.order == [0]
    assert isinstance(fault, FaultReport)
    assert not fault.repeated


def test_words_that_nobody_hears_wait_for_a_reader(rendezvous: Rendezvous) -> None:
    heard: list[Inputs] = []
    with Link(rendezvous.config) as other, Node("sample", "main", rendezvous.config) as node:
        commands = other.publisher(keys.COMMAND, bus="main")
        node.keep_journal()
        taken: list[int] = []
        node.subscribe(keys.COMMAND, lambda _, command: taken.append(command.seq))
        wait_until(lambda: commands.has_reader, meanwhile=lambda: node.pump(0.02))
        for _ in range(3):
            commands.put(BusCommand(stamp=1, goals=[]))
        wait_until(lambda: len(taken) == 3, meanwhile=lambda: node.pump(0.02))
        node.tell_inputs()
        other.subscribe(keys.INPUTS, lambda _, message: heard.append(message))

        def turn() -> None:
            node.pump(0.02)
            other.pump(0.02)

        wait_until(lambda: bool(heard), 10, turn)
    assert (heard[0].seq, heard[0].order) == (0, [0, 0, 0])
