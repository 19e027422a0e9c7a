"""How long a thread waited for a processor, as the kernel tells it, and which answers are late."""

import time
from multiprocessing import Process
from os import cpu_count
from pathlib import Path

import pytest

from tests.conftest import wait_until
from wackel_gateway.outcome import Outcome
from wackel_gateway.processor_wait import ProcessorWait
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import reader
from wackel_protocols.dynamixel2.packet import StatusPacket

MS = 1_000_000


@pytest.mark.parametrize("text", ["", "0\n", "nonsense", "0 x 1\n"])
def test_a_kernel_that_tells_nothing_or_something_else_makes_nobody_wait(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "schedstat"
    assert ProcessorWait(path).total_ns() == 0
    path.write_text(text)
    assert ProcessorWait(path).total_ns() == 0
    path.write_text("67090 1230 1\n")
    assert ProcessorWait(path).total_ns() == 1230


def _spin() -> None:
    while True:
        pass


@pytest.mark.process
def test_a_thread_that_shares_its_processor_waits_for_it() -> None:
    wait = ProcessorWait()
    if not wait.total_ns():
        pytest.skip("this kernel does not tell")
    spinning = [Process(target=_spin, daemon=True) for _ in range(2 * (cpu_count() or 1) + 1)]
    for process in spinning:
        process.start()
    try:
        before_ns = wait.total_ns()

        def has_waited() -> bool:
            until_ns = time.monotonic_ns() + 20 * MS
            while time.monotonic_ns() < until_ns:
                pass
            return wait.total_ns() - before_ns >= 5 * MS

        wait_until(has_waited, 20.0)
    finally:
        for process in spinning:
            process.kill()
            process.join()


def outcome(instruction: bytes, answers: bytes, took_ns: int) -> Outcome:
    read = reader(instruction)
    chunks = [(took_ns, answers)] if answers else []
    taken = read.read(answers)
    return Outcome(
        "background",
        instruction,
        read.expectation,
        0,
        0,
        chunks,
        taken,
        took_ns,
        took_ns,
        0,
        1_000_000,
    )


def test_an_answer_is_late_that_needs_longer_than_any_servo() -> None:
    ping, status = packet.ping(3), StatusPacket(3, 0, bytes(3)).encode()
    wire_ns = len(status) * 10_000
    assert not outcome(ping, status, wire_ns + 1_200_000).late
    assert outcome(ping, status, wire_ns + 1_300_000).late
    assert not outcome(ping, b"", 5 * MS).late
    both = b"".join(StatusPacket(each, 0, bytes(4)).encode() for each in (1, 2))
    # Those of many wait for each other, and for the one read that fetches them all.
    assert not outcome(packet.sync_read((1, 2), 132, 4), both, 5 * MS).late
