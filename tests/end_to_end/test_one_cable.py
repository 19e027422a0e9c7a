"""One loose cable on a robot that drives: the bus tells which cable, the drive which wheel."""

from pathlib import Path

import msgspec
import pytest

from tests import robot as robots
from wackel_cli.robot_model import RobotModel
from wackel_cli.robot_screen import render
from wackel_node.config import RobotConfig
from wackel_schemas import keys
from wackel_schemas.drive import Odometry
from wackel_virtual.scenario import load_scenario

pytestmark = pytest.mark.process

SCENARIO = Path(__file__).parents[2] / "docs" / "examples" / "steering-cable.toml"
CABLE = "bus/main/cable/5-6"
START_S = 60.0


def here(example: RobotConfig, directory: Path) -> RobotConfig:
    """The robot of an example, without what it would share with others on this computer."""
    own = robots.chain(directory, 0)
    bus = msgspec.structs.replace(example.buses["main"], port=own.buses["main"].port)
    made: RobotConfig = msgspec.structs.replace(
        example, buses={"main": bus}, zenoh=own.zenoh, state_directory=own.state_directory
    )
    return made


def unseen(odometry: Odometry) -> set[str]:
    """Wheels of which measurements are missing."""
    missing = (each.name for each in odometry.inputs if each.result == "missing")
    return {name.rpartition("/")[0] for name in missing}


def test_a_cable_to_a_steering_is_told_by_the_bus_and_by_the_drive(tmp_path: Path) -> None:
    scenario = load_scenario(SCENARIO)
    loose, broken = (
        msgspec.structs.replace(fault, start_s=0.0, duration_s=None) for fault in scenario.faults
    )
    assert (loose.kind, broken.kind) == ("loose_contact_bursts", "break")
    config = here(scenario.config, tmp_path)
    latest: list[Odometry] = []
    with robots.running(config, tmp_path) as robot:
        robot.wait(robot.ready, START_S)
        robot.link.subscribe(keys.ODOMETRY, lambda _, message: latest.append(message))
        pilot = ("pilot", "--config", str(tmp_path / "robot.toml"), "--path", "eight")
        with robots.process("wackel_cli", *pilot, log=tmp_path / "pilot.log"):
            robot.wait(lambda: bool(latest) and latest[-1].vx > 0.25)
            assert unseen(latest[-1]) == set()
            robot.disturb(loose)
            robot.wait(lambda: robot.confirmed("loose_contact", CABLE))
            # Now and then the drive does without the wheel.
            robot.wait(lambda: {"wheel/right"} in map(unseen, latest))
            robot.heal()
            robot.wait(lambda: robot.ready() and unseen(latest[-1]) == set(), START_S)
            healed = robot.fault("loose_contact", CABLE)
            assert healed is not None
            assert healed.status == "healed"

            robot.disturb(broken)
            robot.wait(lambda: robot.confirmed("cable_break", CABLE))
            robot.wait(lambda: unseen(latest[-1]) == {"wheel/right"})
            assert latest[-1].valid  # the others go on
            model = RobotModel(config)
            model.on_health(robot.health, 0.0)
            model.on_odometry(latest[-1], 0.0)
            screen = "\n".join(line.plain for line in render(model, 0.0, 120, 40))
            assert "● right no values" in screen
            assert "The cable between servo 5 and servo 6 on bus main is disconnected" in screen
            robot.heal()
            robot.wait(lambda: robot.ready() and unseen(latest[-1]) == set(), START_S)
