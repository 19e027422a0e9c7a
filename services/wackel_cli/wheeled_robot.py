"""A robot on three steered wheels, as the paper's, that lives only while a command runs."""

import socket
from collections.abc import Sequence
from dataclasses import replace
from math import pi
from pathlib import Path

from wackel_cli.supervisor import Job
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, ZenohConfig
from wackel_node.config_drive import DriveConfig, GyroConfig, WheelConfig

BUS = "main"
WHEELS = ("w1", "w2", "w3")
PILOT = "pilot/main"
"""Name of the job that drives it."""


def three_wheels(
    name: str, directory: Path, servos: Sequence[ServoConfig], nominal_voltage: float
) -> RobotConfig:
    """Its configuration: ports, state and rendezvous are its own, so it collides with no other.

    Args:
        name: Of the robot.
        directory: For its ports and its state.
        servos: In cable order; those with the ids 1, 3 and 5 drive wheels, 2, 4 and 6 steer them.
        nominal_voltage: Of the bus, V.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    wheels = [
        WheelConfig(
            name=wheel,
            l=0.2,
            alpha=pi / 3 + 2 * pi * i / 3,
            radius=0.05,
            bus=BUS,
            drive=2 * i + 1,
            steering=2 * i + 2,
        )
        for i, wheel in enumerate(WHEELS)
    ]
    return RobotConfig(
        robot=name,
        state_directory=str(directory),
        zenoh=ZenohConfig(endpoint=endpoint),
        buses={
            BUS: BusConfig(
                port=str(directory / "bus"),
                rate=100.0,
                nominal_voltage=nominal_voltage,
                servos=list(servos),
            )
        },
        drive=DriveConfig(kind="steered", wheels=wheels),
        gyros={"body": GyroConfig()},
    )


def with_physics(jobs: Sequence[Job], physics: str) -> list[Job]:
    """The jobs, with the virtual robot on this physics."""
    return [
        replace(job, arguments=(*job.arguments, "--physics", physics))
        if job.name == "virtual/main"
        else job
        for job in jobs
    ]
