"""MuJoCo's physics against the fast body: two models of friction that share no code."""

import importlib
import sys

import numpy as np
import pytest

from tests.odometry.simulation import differential_drive, steered_drive
from tests.virtual.test_drive_simulation import driven, headings, mean_twist, rates, simulation
from wackel_drive.layout import Layout
from wackel_node.config import ConfigError
from wackel_node.config_drive import DriveConfig, WheelConfig
from wackel_schemas.virtual import Injection
from wackel_virtual.body import GRAVITY, WheelStates, World
from wackel_virtual.build import Build

BUILD = Build()

pytest.importorskip("mujoco")

PAPER = (1.5, 0.0, 1.5)


def after(
    kind: str, value: float | None = None, *, wheels: int = 4, physics: str = "mujoco"
) -> list[float]:
    """Mean twist from 1 to 2 s after the fault."""
    robot = simulation(steered_drive(wheels), physics=physics)  # type: ignore[arg-type]
    driven(robot, 2.0)
    robot.inject(Injection(kind=kind, value=value, wheel="w1"))
    return mean_twist(driven(robot, 2.0)[100:])


@pytest.mark.parametrize("wheels", [3, 4, 6])
def test_a_sound_robot_does_what_it_is_told(wheels: int) -> None:
    robot = simulation(steered_drive(wheels), physics="mujoco")
    for _ in range(100):
        robot.step(0.6, 0.0, 0.6)
    vx, vy, omega = mean_twist(driven(robot, 1.0))
    assert (vx, omega) == pytest.approx((0.6, 0.6), rel=0.01)
    assert abs(vy) < 0.01


def test_a_differential_robot_does_what_it_is_told() -> None:
    cycles = driven(simulation(differential_drive(), physics="mujoco"), 3.0)
    vx, _, omega = mean_twist(cycles[-100:])
    assert (vx, omega) == pytest.approx((0.6, 0.6), rel=0.01)


def test_pose_is_where_the_twists_lead() -> None:
    cycles = driven(simulation(steered_drive(3), physics="mujoco"), 4.0)
    turned = sum(cycle.twist[2] for cycle in cycles) * 0.01
    assert cycles[-1].pose[2] == pytest.approx(turned, rel=0.01)
    way = np.diff([cycle.pose[:2] for cycle in cycles], axis=0)
    speeds = [np.hypot(*cycle.twist[:2]) for cycle in cycles[1:]]
    assert np.hypot(*way.T).sum() == pytest.approx(sum(speeds) * 0.01, rel=0.01)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("wheel_blocked", None),
        ("wheel_free", None),
        ("drive_scale", 0.1),
        ("steering_offset", 0.2),
        ("steering_reference_error", 0.2),
    ],
)
def test_both_bodies_agree_on_what_a_fault_does(kind: str, value: float | None) -> None:
    by_contact = after(kind, value, physics="mujoco")
    without = after(kind, value, physics="fast")
    # They differ by the creep of tyres, which only one of them has.
    assert by_contact == pytest.approx(without, abs=0.04)


def test_the_papers_robot_is_braked_on_the_side_of_its_blocked_wheel() -> None:
    """Paper, section 5: it turns much less, the other wheels slow down a little."""
    twists = {}
    for physics in ("mujoco", "fast"):
        robot = simulation(steered_drive(3), physics=physics)  # type: ignore[arg-type]
        for step in range(400):
            robot.step(*(step / 400 * np.array(PAPER)))
        before = rates(driven(robot, 0.5, PAPER)[-1])
        robot.inject(Injection(kind="wheel_blocked", wheel="w2"))
        cycles = driven(robot, 4.0, PAPER)[200:]
        shares = np.mean([rates(cycle) for cycle in cycles], axis=0) / before
        assert np.all((shares[:2] > 0.85) & (shares[:2] < 0.99))
        assert abs(shares[2]) < 0.01
        twists[physics] = mean_twist(cycles)
        assert twists[physics][2] < 0.6 * 1.5
    assert twists["mujoco"] == pytest.approx(twists["fast"], abs=0.15)


@pytest.mark.parametrize("duration_s", [0.001, 0.003, 0.005, 0.01])
def test_steps_of_any_length_take_their_time(duration_s: float) -> None:
    from wackel_virtual.mujoco_body import MujocoBody

    layout = Layout(steered_drive(3))
    ahead = [0.0] * 3
    body = MujocoBody(layout.drive, ahead, BUILD)
    rolling = WheelStates([6.0] * 3, [True] * 3, [False] * 3, ahead)
    world = World([BUILD.friction] * 3, (0.0, 0.0, 0.0))
    for _ in range(round(1.0 / duration_s)):
        body.step(rolling, world, duration_s)
    start, before = body.pose[0], body.angle
    for _ in range(round(1.0 / duration_s)):
        body.step(rolling, world, duration_s)
    assert body.pose[0] - start == pytest.approx(0.3, rel=0.01)
    assert np.subtract(body.angle, before) == pytest.approx(6.0, rel=0.01)


def braking(kind: str) -> list[tuple[float, float, float]]:
    """Of a robot whose wheels are braked within 25 ms, each 2 ms: its speed, that at which wheels
    roll (both as mean of that time) and their mean effort; m/s and shares."""
    from wackel_virtual.mujoco_body import MujocoBody

    drive = Layout(steered_drive(4)).drive
    about = (np.arctan2(*drive.xy.T[::-1]) + np.pi / 2).tolist()
    heading, lever, part = (
        (about, drive.length_m, 2) if kind == "about" else ([0.0] * drive.n, 1.0, 0)
    )
    body = MujocoBody(drive, heading, BUILD)
    world = World([BUILD.friction] * drive.n, (0.0, 0.0, 0.0))
    radius, goal, result = drive.roll_radius, 0.25, []
    for cycle in range(400):
        goal *= np.exp(-0.002 / 0.025) if cycle >= 300 else 1.0
        wheels = WheelStates((goal / radius).tolist(), [True] * 4, [False] * 4, heading)
        before, angle = body.pose[part], body.angle
        body.step(wheels, world, 0.002)
        robot = lever * (body.pose[part] - before) / 0.002
        rolled = np.mean(np.subtract(body.angle, angle) * radius) / 0.002
        result.append((robot, float(rolled), float(np.mean(body.effort))))
    return result[299:]


@pytest.mark.parametrize("kind", ["along", "about"])
def test_a_robot_stops_with_its_wheels_and_not_before(kind: str) -> None:
    for robot, rolled, _ in braking(kind):
        assert robot == pytest.approx(rolled, abs=0.002)


def test_motors_show_what_they_push_the_robot_with() -> None:
    """As those of the fast body do, whose wheels have no inertia."""
    cycles = braking("along")
    effort = sum(effort for _, _, effort in cycles[1:])
    assert effort * BUILD.friction * GRAVITY * 0.002 == pytest.approx(-cycles[0][0], rel=0.1)


def test_a_motor_without_its_wheel_pushes_nothing() -> None:
    """Though the wheel is hastened, and what is left of the motor with it."""
    from wackel_virtual.mujoco_body import MujocoBody

    ahead = [0.0] * 3
    body = MujocoBody(Layout(steered_drive(3)).drive, ahead, BUILD)
    world = World([BUILD.friction] * 3, (0.0, 0.0, 0.0))
    for cycle in range(50):
        body.step(
            WheelStates([0.1 * cycle] * 3, [True, False, True], [False] * 3, ahead), world, 0.01
        )
        assert body.effort[1] == 0.0
    assert body.rate[1] == pytest.approx(body.rate[0], rel=0.01)
    assert min(body.effort[0], body.effort[2]) > 0.01


def test_a_wheel_comes_free_again() -> None:
    robot = simulation(steered_drive(4), physics="mujoco")
    driven(robot, 1.0)
    robot.inject(Injection(kind="wheel_blocked", wheel="w0", duration_s=0.5))
    driven(robot, 1.5)
    assert mean_twist(driven(robot, 0.5)) == pytest.approx((0.6, 0.0, 0.6), abs=0.02)


def test_a_push_moves_the_robot_and_ends() -> None:
    robot = simulation(steered_drive(3), physics="mujoco")
    driven(robot, 1.5)
    robot.inject(Injection(kind="push"))
    pushed = driven(robot, 0.2)[-1].twist
    assert np.abs(pushed - np.array([0.6, 0.0, 0.6])).max() > 0.05
    assert mean_twist(driven(robot, 2.0)[100:]) == pytest.approx((0.6, 0.0, 0.6), abs=0.02)


def test_wheels_on_ice_slip() -> None:
    robot = simulation(steered_drive(3), physics="mujoco")
    for wheel in ("w0", "w1", "w2"):
        robot.inject(Injection(kind="ice_patch", wheel=wheel))
    assert driven(robot, 0.3, (1.0, 0.0, 0.0))[-1].twist[0] < 0.5


def test_steering_turns_while_it_drives() -> None:
    robot = simulation(steered_drive(4), physics="mujoco")
    driven(robot, 1.0, (0.4, 0.0, 0.0))
    cycles = driven(robot, 1.0, (0.4, 0.2, 0.0))
    assert headings(cycles[-1]) == pytest.approx([np.arctan2(0.2, 0.4)] * 4, abs=0.01)
    assert mean_twist(cycles[50:]) == pytest.approx((0.4, 0.2, 0.0), abs=0.01)


def test_wheels_with_rollers_need_the_fast_body() -> None:
    wheels = [
        WheelConfig(
            name=f"w{i}", l=0.2, alpha=2.1 * i, heading=2.1 * i, radius=0.05, bus="b", drive=i
        )
        for i in range(3)
    ]
    with pytest.raises(ConfigError, match="fast"):
        simulation(DriveConfig(kind="omni", wheels=wheels), physics="mujoco")


def test_without_mujoco_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, "wackel_virtual.mujoco_body", raising=False)
    with pytest.raises(ImportError, match=r"pip install 'wackel\[sim\]'"):
        importlib.import_module("wackel_virtual.mujoco_body")


@pytest.mark.parametrize("droop_m_s", [0.02, 0.06, 0.12])
@pytest.mark.parametrize("twist", [(1.0, 0.0, 0.0), (0.0, 0.0, 3.0)], ids=["along", "about"])
def test_motors_of_any_stiffness_show_what_accelerates_the_robot(
    droop_m_s: float, twist: tuple[float, float, float]
) -> None:
    """Whenever a stiff one catches up with its goal."""
    efforts = []
    for physics in ("fast", "mujoco"):
        robot = simulation(
            steered_drive(3),
            physics=physics,  # type: ignore[arg-type]
            build=Build(droop_m_s=droop_m_s),
        )
        vx, vy, omega = twist
        driven(robot, 1.0, (0.01 * vx, 0.01 * vy, 0.01 * omega))
        for part in np.arange(0.01, 0.6, 0.01).tolist():
            robot.step(part * vx, part * vy, part * omega)
        efforts.append(np.abs(robot._drivetrain.body.effort))
    of_its_own = 0.013  # of wheels, which have inertia in MuJoCo only
    assert efforts[1] == pytest.approx(efforts[0] + of_its_own, rel=0.15)
