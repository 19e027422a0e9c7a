"""Where the odometry is part of a robot."""

from pathlib import Path

from tests.odometry.simulation import BUS, differential_drive
from wackel_aggregator.service import needed_services
from wackel_cli.up import robot_jobs
from wackel_node.config import BusConfig, RobotConfig

BUSES = {BUS: BusConfig(port="p")}


def names(config: RobotConfig) -> list[str]:
    return [job.name for job in robot_jobs(config, Path("robot.toml"))]


def test_a_robot_with_wheels_runs_odometry_and_needs_it() -> None:
    config = RobotConfig(buses=BUSES, drive=differential_drive())
    assert "odometry/main" in names(config)
    assert "odometry/main" in needed_services(config)


def test_a_robot_without_wheels_does_without() -> None:
    config = RobotConfig(buses=BUSES)
    assert "odometry/main" not in names(config)
    assert "odometry/main" not in needed_services(config)
