"""How busy the computer is, as the kernel tells it, and which answers come late."""

import time
from multiprocessing import Process
from os import cpu_count
from pathlib import Path

import pytest

from tests.conftest import wait_until
from wackel_gateway.outcome import Outcome
from wackel_gateway.pressure import BUSY, PRESSURE, Pressure
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import reader
from wackel_protocols.dynamixel2.packet import StatusPacket

MS = 1_000_000


def tell(path: Path, total_us: int) -> None:
    path.write_text(
        f"some avg10=1.53 avg60=1.87 avg300=1.73 total={total_us}\n"
        "full avg10=0.00 avg60=0.00 avg300=0.00 total=0\n"
    )


def test_the_share_is_that_of_the_last_few_tenths_of_a_second(tmp_path: Path) -> None:
    path = tmp_path / "cpu"
    tell(path, 5_000_000)
    pressure = Pressure(path)
    for now_ms, total_us in ((1000, 5_000_000), (1200, 5_100_000), (1250, 5_100_000)):
        tell(path, total_us)
        pressure.look(now_ms * MS)
    tell(path, 5_150_000)
    assert pressure.share(1300 * MS) == pytest.approx(0.5)
    tell(path, 5_160_000)
    pressure.look(2000 * MS)
    pressure.look(2200 * MS)
    assert pressure.share(2300 * MS) == 0.0


@pytest.mark.parametrize("text", ["", "some avg10=1.53 total=\n", "nonsense", "total=x"])
def test_a_kernel_that_tells_nothing_or_something_else_is_not_busy(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "cpu"
    absent = Pressure(path)
    absent.look(MS)
    assert absent.share(MS) == 0.0
    path.write_text(text)
    other = Pressure(path)
    other.look(1000 * MS)
    assert other.share(2000 * MS) == 0.0


def _spin() -> None:
    while True:
        pass


@pytest.mark.process
def test_the_kernel_tells_of_more_processes_than_processors() -> None:
    if not PRESSURE.exists():
        pytest.skip("this kernel tells no pressure stall information")
    spinning = [Process(target=_spin, daemon=True) for _ in range(2 * (cpu_count() or 1) + 1)]
    for process in spinning:
        process.start()
    try:
        pressure = Pressure()

        def busy() -> bool:
            time.sleep(0.05)
            pressure.look(time.monotonic_ns())
            return pressure.share(time.monotonic_ns()) >= BUSY

        wait_until(busy, 20.0)
    finally:
        for process in spinning:
            process.kill()
            process.join()


def outcome(instruction: bytes, answers: bytes, took_ns: int) -> Outcome:
    read = reader(instruction)
    chunks = [(took_ns, answers)] if answers else []
    taken = read.read(answers)
    return Outcome(
        "slow", instruction, read.expectation, 0, 0, chunks, taken, took_ns, took_ns, 0, 1_000_000
    )


def test_an_answer_is_late_that_needs_longer_than_any_servo() -> None:
    ping, status = packet.ping(3), StatusPacket(3, 0, bytes(3)).encode()
    wire_ns = len(status) * 10_000
    assert outcome(ping, status, wire_ns + 1_200_000).late_ns == 0
    assert outcome(ping, status, wire_ns + 1_300_000).late_ns == 1_300_000
    assert outcome(ping, b"", 5 * MS).late_ns == 0
    both = b"".join(StatusPacket(each, 0, bytes(4)).encode() for each in (1, 2))
    # Those of many wait for each other, and for the one read that fetches them all.
    assert outcome(packet.sync_read((1, 2), 132, 4), both, 5 * MS).late_ns == 0
