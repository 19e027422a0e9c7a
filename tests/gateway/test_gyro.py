"""A gyro in the registers of a device: what an answer says, and when it is asked."""

import math
import struct
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_gateway.commands import Refused
from wackel_gateway.gyro import BusGyro
from wackel_gateway.job import Job, Stage
from wackel_gateway.roster import Block, Roster
from wackel_gateway.schedule import Schedule
from wackel_node.config import ServoConfig
from wackel_node.config_drive import GyroConfig, GyroRegister
from wackel_protocols.dynamixel2.answers import reader
from wackel_protocols.dynamixel2.packet import StatusPacket, read

OPENCR = {axis: GyroRegister(address=60 + 4 * i) for i, axis in enumerate("xyz")}
"""As in TurtleBot 3's control table (turtlebot3_node/control_table.hpp)."""


def gyro(registers: Mapping[str, GyroRegister] = OPENCR) -> BusGyro:
    return BusGyro(
        GyroConfig(source="bus", bus="main", id=200, registers=dict(registers))  # type: ignore[arg-type]
    )


def test_the_registers_of_an_opencr_are_read_in_one_go_and_are_the_rates() -> None:
    opencr = gyro()
    assert opencr.block == Block(60, 12)
    sample = opencr.sample(struct.pack("<3f", 0.5, -0.25, 2.0), 7, 0.25)
    assert (sample.stamp, sample.late_s) == (7, 0.25)
    assert sample.angular_velocity == (0.5, -0.25, 2.0)


def test_whole_numbers_have_a_scale_and_an_axis_without_register_shows_nothing() -> None:
    registers = {
        "z": GyroRegister(address=10, encoding="int16", scale=0.001),
        "x": GyroRegister(address=14, encoding="int32", scale=-0.5),
    }
    sample = gyro(registers).sample(struct.pack("<hhi", -2000, 999, 4), 1, 0.0)
    assert sample.angular_velocity == pytest.approx((-2.0, 0.0, -2.0))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_no_sample(bad: float) -> None:
    with pytest.raises(Refused, match="gyro sends no number"):
        gyro().sample(struct.pack("<3f", 0.0, bad, 0.0), 1, 0.0)


@given(st.binary(max_size=40))
def test_any_answer_is_a_sample_of_numbers_or_refused(data: bytes) -> None:
    try:
        sample = gyro().sample(data, 1, 0.0)
    except Refused:
        return
    assert all(map(math.isfinite, sample.angular_velocity))


class Bench:
    """A schedule without servos, asked for its jobs at a rate of 100 Hz."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.schedule = Schedule(Roster([]), 100.0, [(200, Block(60, 12))], fast=True, now_ns=0)

    def cycle(self, *, answered: bool) -> list[Job]:
        jobs = []
        while (job := self.schedule.next(self.now_ns)) is not None:
            jobs.append(job)
            data = StatusPacket(200, 0, bytes(12)).encode() if answered else b""
            self.schedule.done(
                job, reader(job.instruction).read(data), self.now_ns, self.now_ns + 1_000_000
            )
        self.now_ns += 10_000_000
        return jobs


def test_every_cycle_reads_the_device_even_without_any_servo() -> None:
    bench = Bench()
    for _ in range(5):
        jobs = bench.cycle(answered=True)
        assert [(job.stage, job.instruction) for job in jobs] == [(Stage.DEVICE, read(200, 60, 12))]


def test_a_silent_device_is_asked_less_and_less_and_takes_part_again_at_once() -> None:
    bench = Bench()
    asked = [bool(bench.cycle(answered=False)) for _ in range(600)]
    assert all(asked[:3])  # a lost answer costs nothing
    assert sum(asked[300:]) <= 4
    assert any(asked[400:])
    while not bench.cycle(answered=True):
        pass
    assert all(bench.cycle(answered=True) for _ in range(10))


def test_servos_are_read_before_the_device() -> None:
    schedule = Schedule(
        Roster([ServoConfig(id=1)]), 100.0, [(200, Block(60, 12))], fast=False, now_ns=0
    )
    now_ns, stages = 0, []
    for _ in range(20):
        job = schedule.next(now_ns)
        if job is None:
            now_ns = schedule.due_ns
            continue
        length = job.block.length if job.block else 3
        answer = StatusPacket(job.ids[0], 0, bytes(length)).encode()
        schedule.done(job, reader(job.instruction).read(answer), now_ns, now_ns + 300_000)
        now_ns += 300_000
        stages.append(job.stage)
    first = stages.index(Stage.CYCLE)
    assert stages[first + 1] is Stage.DEVICE
