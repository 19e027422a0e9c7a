"""From robot.toml to kinematics."""

import math

import numpy as np
import pytest

from wackel_drive.layout import Joint, Layout, Servo
from wackel_kinematics.array import Floats
from wackel_kinematics.forward import forward
from wackel_node.config import parse

BUS = '[buses.main]\nport = "p"\n'


def layout(text: str) -> Layout:
    drive = parse(BUS + text).drive
    assert drive is not None
    return Layout(drive)


def twist(text: str, heading: list[float], rate: list[float]) -> Floats:
    found = layout(text)
    steering = found.drive.steering(np.array(heading))
    return forward(found.drive, steering, np.array(rate)).twist


DIFFERENTIAL = """
[drive]
kind = "differential"
[[drive.wheels]]
name = "left"
x = 0.0
y = 0.2
radius = 0.05
bus = "main"
drive = 1
[[drive.wheels]]
name = "right"
x = 0.0
y = -0.2
radius = 0.05
bus = "main"
drive = 2
direction = -1
"""


def test_a_differential_drive_turns_by_its_track() -> None:
    assert twist(DIFFERENTIAL, [0, 0], [10, 14]) == pytest.approx([0.6, 0.0, 0.5])


def test_the_effective_track_takes_the_place_of_the_measured_one() -> None:
    skidding = DIFFERENTIAL.replace("[drive]", "[drive]\ntrack = 0.8")
    assert twist(skidding, [0, 0], [10, 14]) == pytest.approx([0.6, 0.0, 0.25])


def test_joints_name_servo_sign_and_offset() -> None:
    found = layout(DIFFERENTIAL)
    assert found.names == ("left", "right")
    assert found.rolling == (Joint(Servo("main", 1), 1), Joint(Servo("main", 2), -1))
    assert found.steering == (None, None)


def test_the_wheels_of_one_side_act_as_one() -> None:
    four = "".join(
        f'[[drive.wheels]]\nname = "w{i}"\nx = {x}\ny = {y}\nradius = 0.05\nbus = "main"\n'
        f"drive = {i}\n"
        for i, (x, y) in enumerate([(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)])
    )
    found = twist('[drive]\nkind = "differential"\n' + four, [0] * 4, [10, 14, 10, 14])
    assert found == pytest.approx([0.6, 0.0, 0.5])


STEERED = '[drive]\nkind = "steered"\n' + "".join(
    f'[[drive.wheels]]\nname = "w{i}"\nl = 0.3\nalpha = {2 * math.pi * i / 3}\nradius = 0.05\n'
    f'bus = "main"\ndrive = {i}\nsteering = {10 + i}\nsteering_bus = "main"\n'
    "steering_direction = -1\nsteering_offset = 0.1\n"
    for i in range(3)
)


def test_steered_wheels_in_polar_form_follow_their_headings() -> None:
    assert twist(STEERED, [math.pi / 2] * 3, [10] * 3) == pytest.approx([0.0, 0.5, 0.0])
    assert layout(STEERED).steering[1] == Joint(Servo("main", 11), -1, 0.1)


@pytest.mark.parametrize(
    ("kind", "wheels", "heading", "rate", "expected"),
    [
        (
            "tricycle",
            ["x = 0.5\ny = 0.0\nsteering = 9\ndrive = 1", "x = 0.0\ny = 0.2", "x = 0.0\ny = -0.2"],
            [math.pi / 4, 0, 0],
            [10, 0, 0],
            [0.5 / math.sqrt(2), 0.0, 1 / math.sqrt(2)],
        ),
        (
            "ackermann",
            [
                "x = 0.5\ny = 0.2\nsteering = 8",
                "x = 0.5\ny = -0.2\nsteering = 9",
                "x = 0.0\ny = 0.2\ndrive = 1",
                "x = 0.0\ny = -0.2\ndrive = 2",
            ],
            [0.0, 0.0, 0, 0],
            [0, 0, 10, 10],
            [0.5, 0.0, 0.0],
        ),
        (
            "mecanum",
            [
                f"x = {x}\ny = {y}\ndrive = {i}\nroller = {roller * math.pi / 4}"
                for i, (x, y, roller) in enumerate(
                    [(0.2, 0.2, -1), (0.2, -0.2, 1), (-0.2, 0.2, 1), (-0.2, -0.2, -1)]
                )
            ],
            [0] * 4,
            [-10, 10, 10, -10],
            [0.0, 0.5, 0.0],
        ),
        (
            "omni",
            [
                f"l = 0.2\nalpha = {a}\nheading = {a + math.pi / 2}\ndrive = {i}"
                for i, a in enumerate((0.0, 2.1, 4.2))
            ],
            [0] * 3,
            [4] * 3,
            [0.0, 0.0, 1.0],
        ),
    ],
)
def test_every_kind_moves_as_its_wheels_say(
    kind: str, wheels: list[str], heading: list[float], rate: list[float], expected: list[float]
) -> None:
    tables = "".join(
        f'[[drive.wheels]]\nname = "w{i}"\nradius = 0.05\nbus = "main"\n{wheel}\n'
        for i, wheel in enumerate(wheels)
    )
    text = f'[drive]\nkind = "{kind}"\n{tables}'
    assert twist(text, heading, rate) == pytest.approx(expected, abs=1e-9)
