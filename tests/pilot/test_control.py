"""From twists to goals of servos."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.odometry.simulation import differential_drive, steered_drive
from wackel_diagnoser.commands import CommandWatch
from wackel_drive.layout import Layout, Servo
from wackel_kinematics.forward import forward
from wackel_node.config_drive import DriveConfig, WheelConfig
from wackel_pilot.control import Control
from wackel_schemas.bus import ServoGoal
from wackel_schemas.drive import TwistCommand


def motion_of(config: DriveConfig, goals: dict[str, list[ServoGoal]]) -> list[float]:
    """The twist that servos at their goals give the robot."""
    layout = Layout(config)
    by_servo = {Servo(bus, goal.id): goal for bus, each in goals.items() for goal in each}
    rate = np.zeros(layout.drive.n)
    heading = np.zeros(layout.drive.n)
    for i, joint in enumerate(layout.rolling):
        if joint is not None:
            rate[i] = joint.sign * (by_servo[joint.servo].velocity or 0.0)
    for i, joint in enumerate(layout.steering):
        if joint is not None:
            heading[i] = joint.sign * (by_servo[joint.servo].position or 0.0) + joint.offset
    return list(forward(layout.drive, layout.drive.steering(heading), rate).twist)


def mirrored() -> DriveConfig:
    """Servos on two buses, turned the other way, zero elsewhere."""
    drive = steered_drive(4)
    wheels = [
        msgspec.structs.replace(
            wheel,
            direction=-1,
            steering_direction=-1,
            steering_offset=0.3,
            steering_bus="other",
        )
        for wheel in drive.wheels
    ]
    return msgspec.structs.replace(drive, wheels=wheels)


def tricycle() -> DriveConfig:
    """Steered and driven in front; the axle is behind the origin."""
    front = WheelConfig(name="front", x=0.3, y=0.0, radius=0.1, bus="main", drive=1, steering=2)
    rear = [
        WheelConfig(name=name, x=-0.2, y=y, radius=0.1, bus="main")
        for name, y in (("left", 0.2), ("right", -0.2))
    ]
    return DriveConfig(kind="tricycle", wheels=[front, *rear])


@pytest.mark.parametrize("config", [steered_drive(3), steered_drive(5), mirrored()])
def test_the_goals_give_the_twist_that_was_wanted(config: DriveConfig) -> None:
    control = Control(config, {})
    for twist in ((0.3, 0.0, 0.2), (0.3, 0.2, -0.4), (0.0, 0.4, 0.0), (-0.2, 0.1, 0.5)):
        commanded, goals = control.step(twist)
        assert commanded == twist
        assert motion_of(config, goals) == pytest.approx(twist, abs=1e-9)


def test_a_differential_drive_gets_what_it_can_do() -> None:
    config = differential_drive()
    commanded, goals = Control(config, {}).step((0.3, 0.5, 0.2))
    assert commanded == pytest.approx((0.3, 0.0, 0.2))
    assert motion_of(config, goals) == pytest.approx(commanded)


@pytest.mark.parametrize("config", [differential_drive(), tricycle(), steered_drive(3)])
@given(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0)))
def test_only_what_the_drive_can_do_is_commanded(
    config: DriveConfig, twist: tuple[float, float, float]
) -> None:
    (vx, vy, omega), _ = Control(config, {}).step(twist)
    complaint = CommandWatch(Layout(config)).look(TwistCommand(stamp=1, vx=vx, vy=vy, omega=omega))
    assert complaint is None or complaint.code != "command_infeasible"


def test_a_servo_that_could_not_follow_slows_the_whole_robot() -> None:
    config = differential_drive(radius=0.05)
    limits = {Servo("main", 1): 4.0, Servo("main", 2): 20.0}
    commanded, goals = Control(config, limits).step((1.0, 0.0, 0.0))
    assert commanded == pytest.approx((0.2, 0.0, 0.0))
    assert [goal.velocity for goal in goals["main"]] == pytest.approx([4.0, 4.0])


@given(
    st.lists(
        st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0)),
        min_size=1,
        max_size=30,
    )
)
def test_steering_stays_within_the_reach_of_servos(
    twists: list[tuple[float, float, float]],
) -> None:
    config = mirrored()
    control = Control(config, {})
    for twist in twists:
        commanded, goals = control.step(twist)
        for goal in [*goals["main"], *goals["other"]]:
            if goal.position is not None:
                assert abs(goal.position) <= math.pi
        if math.hypot(*twist[:2]) > 2.0:  # every contact moves
            assert motion_of(config, goals) == pytest.approx(commanded, abs=1e-6)


def test_a_robot_that_turns_its_direction_round_and_round_winds_no_cable() -> None:
    control = Control(steered_drive(3), {})
    for step in range(1000):
        angle = step * 0.02
        _, goals = control.step((0.3 * math.cos(angle), 0.3 * math.sin(angle), 0.0))
        assert all(abs(goal.position or 0.0) <= math.pi for goal in goals["main"])
