"""The drive without bus: what each fault does to the motion, and what sensors show of it."""

import math
from itertools import count, pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.odometry.simulation import differential_drive, other_drives, steered_drive
from wackel_node.config import ConfigError, RobotConfig
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas.virtual import Injection
from wackel_virtual.body import GRAVITY
from wackel_virtual.build import Build
from wackel_virtual.calibration_errors import CalibrationErrors
from wackel_virtual.drive_faults import DRIVE_KINDS
from wackel_virtual.drive_simulation import Cycle, DriveSimulation
from wackel_virtual.drivetrain import Physics
from wackel_virtual.faults import InjectionError

CIRCLE = (0.6, 0.0, 0.6)
"""m/s, m/s, rad/s: a circle of 1 m."""
RADIUS = 0.05


def simulation(
    drive: DriveConfig,
    *,
    physics: Physics = "fast",
    seed: int = 1,
    exact: bool = True,
    build: Build = Build(),  # noqa: B008  (frozen)
) -> DriveSimulation:
    gyro = GyroConfig(noise_density=1e-5, bias_stability=1e-6)
    errors = CalibrationErrors.none(drive) if exact else None
    robot = RobotConfig(drive=drive, gyros={"body": gyro})
    return DriveSimulation(robot, seed, physics=physics, errors=errors, build=build)


def driven(
    robot: DriveSimulation, seconds: float, twist: tuple[float, float, float] = CIRCLE
) -> list[Cycle]:
    return [robot.step(*twist) for _ in range(round(100 * seconds))]


def rates(cycle: Cycle) -> list[float]:
    """Rolling speeds shown, rad/s; servo i < 100 drives wheel i."""
    return [servo.velocity or 0.0 for servo in cycle.state.servos if servo.id < 100]


def currents(cycle: Cycle) -> list[float]:
    return [servo.current or 0.0 for servo in cycle.state.servos if servo.id < 100]


def headings(cycle: Cycle) -> list[float]:
    return [servo.position or 0.0 for servo in cycle.state.servos if servo.id >= 100]


def mean_twist(cycles: list[Cycle]) -> list[float]:
    return list(np.mean([cycle.twist for cycle in cycles], axis=0))


def faulty(
    kind: str, value: float | None = None, wheel: str | None = "w1", wheels: int = 3
) -> tuple[list[Cycle], list[Cycle]]:
    """Two seconds before the fault, and two after."""
    robot = simulation(steered_drive(wheels))
    before = driven(robot, 2.0)
    robot.inject(Injection(kind=kind, wheel=wheel, value=value))
    return before, driven(robot, 2.0)


@pytest.mark.parametrize("wheels", [3, 4, 8])
def test_a_sound_robot_does_what_it_is_told(wheels: int) -> None:
    cycles = driven(simulation(steered_drive(wheels)), 3.0)
    vx, vy, omega = mean_twist(cycles[-100:])
    assert (vx, omega) == pytest.approx((0.6, 0.6), rel=0.01)
    assert abs(vy) < 0.01
    # Each wheel shows the speed of its contact.
    angle = math.pi / wheels
    first = math.hypot(0.6 - 0.6 * 0.3 * math.sin(angle), 0.6 * 0.3 * math.cos(angle)) / RADIUS
    assert np.mean([rates(cycle)[0] for cycle in cycles[-100:]]) == pytest.approx(first, rel=0.01)


def test_a_differential_robot_does_what_it_can() -> None:
    robot = simulation(differential_drive())
    vx, vy, omega = mean_twist(driven(robot, 3.0, (0.5, 0.4, 1.0))[-100:])
    assert (vx, omega) == pytest.approx((0.5, 1.0), rel=0.02)
    assert abs(vy) < 0.02  # its wheels resist


@pytest.mark.parametrize(
    ("name", "twist", "share"),
    [
        ("mecanum", (2.0, 0.0, 0.0), math.sqrt(0.5)),  # rollers push along their axes, at 45°
        ("mecanum", (0.0, 2.0, 0.0), math.sqrt(0.5)),
        ("tricycle", (2.0, 0.0, 0.0), 1 / 3),  # one wheel of three pushes
        ("ackermann", (2.0, 0.0, 0.0), 1 / 2),
    ],
)
def test_no_wheel_pushes_with_more_than_its_grip(
    name: str, twist: tuple[float, float, float], share: float
) -> None:
    cycles = driven(simulation(other_drives()[name]), 0.3, twist)
    speeds = [math.hypot(*cycle.twist[:2]) for cycle in cycles]
    fastest = max(100 * (now - before) for before, now in pairwise(speeds))
    assert fastest == pytest.approx(share * Build().friction * GRAVITY, rel=0.03)


def test_motors_follow_with_a_lag_of_first_order() -> None:
    robot = simulation(steered_drive(3))
    driven(robot, 1.0, (0.01, 0.0, 0.0))
    speeds = [cycle.twist[0] for cycle in driven(robot, 1.0, (0.3, 0.0, 0.0))]
    after_50_ms = (speeds[4] - 0.01) / 0.29
    assert 0.5 < after_50_ms < 1 - math.exp(-1) + 0.02  # the mass takes its time, too
    assert speeds[-1] == pytest.approx(0.3, rel=0.01)


def test_a_blocked_wheel_drags_the_robot_and_its_motor_is_overloaded() -> None:
    before, after = faulty("wheel_blocked")
    assert all(rates(cycle)[1] == 0.0 for cycle in after)
    assert mean_twist(after[50:])[2] < 0.9 * mean_twist(before[100:])[2]
    assert max(map(abs, currents(after[-1]))) == abs(currents(after[-1])[1]) > 1.0


def test_a_wheel_that_jams_now_and_then_stands_for_its_share_of_the_time() -> None:
    robot = simulation(steered_drive(4))
    driven(robot, 1.0)
    robot.inject(Injection(kind="wheel_temporarily_blocked", wheel="w2", value=0.3))
    standing = np.array([rates(cycle)[2] == 0.0 for cycle in driven(robot, 60.0)])
    assert standing[0]
    assert 0.2 < standing.mean() < 0.4
    assert 20 < np.count_nonzero(np.diff(standing.astype(int)) == 1) < 100


def torques_read(cycles: list[Cycle], servo: int) -> list[bool]:
    """What a servo's register said whenever it was read."""
    states = [each for cycle in cycles for each in cycle.state.servos if each.id == servo]
    return [each.torque_enabled for each in states if each.torque_enabled is not None]


def test_a_free_wheel_rolls_along_without_current() -> None:
    before, after = faulty("wheel_free")
    assert rates(after[-1]) == pytest.approx(rates(before[-1]), rel=0.01)
    assert np.mean([currents(cycle)[1] for cycle in after]) == pytest.approx(0.0, abs=0.01)
    assert torques_read(after, 1)
    assert not any(torques_read(after, 1))


def test_play_lets_a_free_wheel_swing() -> None:
    _, after = faulty("wheel_free", 0.2)
    shown = np.array([rates(cycle)[1] for cycle in after])
    assert np.ptp(shown) == pytest.approx(0.4 * shown.mean(), rel=0.1)
    still = np.array([rates(cycle)[0] for cycle in after])
    assert np.ptp(still) < 0.05 * still.mean()


def test_a_loose_wheel_leaves_its_motor_without_load() -> None:
    robot = simulation(steered_drive(3))
    robot.inject(Injection(kind="wheel_loose", wheel="w1"))
    cycles = driven(robot, 0.3, (1.0, 0.0, 0.0))  # while it accelerates
    assert currents(cycles[10])[1] < 0.5 * currents(cycles[10])[0]
    read = torques_read(cycles + driven(robot, 1.0, (1.0, 0.0, 0.0)), 1)
    assert read
    assert all(read)


def test_a_motor_that_is_too_fast_turns_the_robot() -> None:
    before, after = faulty("drive_scale", 0.1)
    assert rates(after[-1])[1] > 1.02 * rates(before[-1])[1]
    assert abs(mean_twist(after)[2] - mean_twist(before[100:])[2]) > 0.003


def test_a_jammed_steering_shows_when_the_command_changes() -> None:
    robot = simulation(steered_drive(3))
    driven(robot, 1.0)
    robot.inject(Injection(kind="steering_blocked", wheel="w0"))
    same = driven(robot, 1.0)
    other = driven(robot, 1.0, (0.6, 0.0, -0.6))
    assert headings(same[-1])[0] == headings(other[-1])[0]
    assert headings(same[-1])[1] != headings(other[-1])[1]
    steering = next(servo for servo in other[-1].state.servos if servo.id == 100)
    assert abs(steering.current or 0.0) > 1.0


def test_a_wrong_reference_is_invisible_in_the_reading_and_moves_the_robot() -> None:
    before, after = faulty("steering_reference_error", 0.3)
    assert headings(after[-1]) == headings(before[-1])
    moved = np.subtract(mean_twist(after[100:]), mean_twist(before[100:]))
    assert np.abs(moved).max() > 0.002


def test_an_offset_shows_in_the_reading() -> None:
    before, after = faulty("steering_offset", 0.1)
    assert headings(after[-1])[1] - headings(before[-1])[1] == pytest.approx(0.1, abs=0.002)


@pytest.mark.parametrize("kind", ["drive_sensor_stuck", "drive_sensor_scale"])
def test_a_wrong_encoder_does_not_change_the_motion(kind: str) -> None:
    before, after = faulty(kind)
    assert mean_twist(after) == pytest.approx(mean_twist(before[100:]), abs=0.003)
    expected = 0.0 if kind == "drive_sensor_stuck" else 1.1 * rates(before[-1])[1]
    assert rates(after[-1])[1] == pytest.approx(expected, rel=0.01)
    # The counter agrees with the velocity.
    positions = [cycle.state.servos[1].position or 0.0 for cycle in after]
    assert positions[-1] - positions[0] == pytest.approx(1.99 * expected, rel=0.01)


def test_a_stuck_sensor_of_steering_does_not_change_the_motion() -> None:
    robot = simulation(steered_drive(3))
    driven(robot, 1.0)
    robot.inject(Injection(kind="steering_sensor_stuck", wheel="w0"))
    robot.inject(Injection(kind="steering_sensor_stuck", wheel="w1", value=0.5))
    robot.inject(Injection(kind="steering_sensor_offset", wheel="w2", value=-0.2))
    same = driven(robot, 1.0)
    other = driven(robot, 1.0, (0.6, 0.0, -0.6))
    assert headings(same[-1])[0] == headings(other[-1])[0]
    assert headings(other[-1])[1] == pytest.approx(0.5, abs=0.001)
    truth = math.atan2(-0.6 * 0.3 * math.cos(5 * math.pi / 3), 0.6 + 0.6 * 0.3 * -0.866)
    assert headings(other[-1])[2] == pytest.approx(truth - 0.2, abs=0.01)
    assert mean_twist(other[50:])[2] == pytest.approx(-0.6, rel=0.02)


def test_a_gyro_jumps_and_freezes() -> None:
    robot = simulation(steered_drive(3))
    driven(robot, 1.0)
    robot.inject(Injection(kind="gyro_offset", value=0.2, duration_s=0.5))
    shown = [cycle.imu.angular_velocity[2] for cycle in driven(robot, 1.0)]
    assert np.mean(shown[:50]) == pytest.approx(0.8, rel=0.02)
    assert np.mean(shown[50:]) == pytest.approx(0.6, rel=0.02)
    robot.inject(Injection(kind="gyro_frozen"))
    assert len({cycle.imu.angular_velocity for cycle in driven(robot, 1.0)}) == 1


def test_a_push_ends_and_the_robot_goes_on() -> None:
    before, after = faulty("push", wheel=None)
    assert np.abs(np.subtract(after[10].twist, before[-1].twist)).max() > 0.05
    assert mean_twist(after[100:]) == pytest.approx(mean_twist(before[100:]), abs=0.01)


def test_a_robot_that_is_pushed_on_spins_no_faster_than_the_push_makes_it() -> None:
    robot = simulation(steered_drive(3))
    driven(robot, 1.0)
    robot.inject(Injection(kind="push", duration_s=3.0))
    speeds = [math.hypot(*cycle.twist[:2]) for cycle in driven(robot, 4.0)]
    assert 1.0 < max(speeds) < 3.0 * GRAVITY


def test_wheels_slip_on_ice_when_the_robot_accelerates() -> None:
    def lost(ice: bool) -> float:
        robot = simulation(steered_drive(3))
        for wheel in ("w0", "w1", "w2") if ice else ():
            robot.inject(Injection(kind="ice_patch", wheel=wheel))
        cycle = driven(robot, 0.3, (1.0, 0.0, 0.0))[-1]
        return float(np.mean(rates(cycle))) * RADIUS - float(cycle.twist[0])

    assert lost(ice=False) < 0.02
    assert lost(ice=True) > 0.3


def test_a_patch_of_ice_lies_ahead_of_the_robot() -> None:
    def brake(ice: bool) -> float:
        """Way from 1 m/s to rest."""
        robot = simulation(steered_drive(3))
        driven(robot, 1.0, (1.0, 0.0, 0.0))
        if ice:
            robot.inject(Injection(kind="ice_patch"))
        start = driven(robot, 0.35, (1.0, 0.0, 0.0))[-1].pose[0]
        return float(driven(robot, 2.0, (0.0, 0.0, 0.0))[-1].pose[0] - start)

    assert brake(ice=True) > 1.5 * brake(ice=False)


def test_faults_begin_and_end_when_they_are_told_and_heal() -> None:
    robot = simulation(steered_drive(3))
    driven(robot, 1.0)
    robot.inject(Injection(kind="wheel_blocked", wheel="w0", start_s=0.5, duration_s=0.25))
    standing = [rates(cycle)[0] == 0.0 for cycle in driven(robot, 1.0)]
    assert standing == [50 <= i < 75 for i in range(100)]
    robot.inject(Injection(kind="wheel_blocked", wheel="w0"))
    robot.inject(Injection(kind="wheel_blocked", wheel="w2", start_s=0.2))
    assert rates(driven(robot, 0.1)[-1])[0] == 0.0
    robot.heal("wheel_blocked")
    assert min(rates(driven(robot, 1.0)[-1])) > 1.0


def test_the_same_seed_gives_the_same_cycles() -> None:
    def run(seed: int) -> list[object]:
        robot = simulation(steered_drive(4), seed=seed, exact=False)
        robot.inject(Injection(kind="wheel_temporarily_blocked", wheel="w0"))
        return [(cycle.state, cycle.imu, tuple(cycle.pose)) for cycle in driven(robot, 1.0)]

    assert run(5) == run(5)
    assert run(5) != run(6)


def test_calibration_errors_are_as_large_as_the_configuration_assumes() -> None:
    drive = steered_drive(4, radius_error=0.01, steering_error=0.02)
    drawn = [CalibrationErrors.drawn(drive, GyroConfig(), seed, 3.0) for seed in range(400)]
    assert np.std([each.radius for each in drawn]) == pytest.approx(0.03, rel=0.1)
    assert np.std([each.direction for each in drawn]) == pytest.approx(0.06, rel=0.1)


@pytest.mark.parametrize(
    "injection",
    [
        Injection(kind="broken"),
        Injection(kind="wheel_blocked"),
        Injection(kind="wheel_blocked", wheel="w9"),
        Injection(kind="wheel_blocked", wheel="w1", value=1.0),
        Injection(kind="wheel_blocked", wheel="w1", servo=3),
        Injection(kind="push", wheel="w1"),
        Injection(kind="steering_offset", wheel="w1", value=math.nan),
        Injection(kind="steering_offset", wheel="w1", start_s=-1.0),
    ],
)
def test_what_cannot_be_injected_is_refused(injection: Injection) -> None:
    with pytest.raises(InjectionError):
        simulation(steered_drive(3)).inject(injection)


def test_a_wheel_that_does_not_steer_has_no_steering_to_break() -> None:
    with pytest.raises(InjectionError, match="of its own"):
        simulation(differential_drive()).inject(Injection(kind="steering_blocked", wheel="left"))


def test_a_robot_without_drive_cannot_be_simulated() -> None:
    with pytest.raises(ConfigError):
        DriveSimulation(RobotConfig(), 1)


@settings(max_examples=25, deadline=None)
@given(
    wheels=st.integers(3, 5),
    twists=st.lists(st.tuples(*[st.floats(-50.0, 50.0)] * 3), min_size=1, max_size=6),
    kinds=st.lists(st.sampled_from(sorted(DRIVE_KINDS)), max_size=4),
)
def test_nothing_makes_it_show_what_is_not_a_number(
    wheels: int, twists: list[tuple[float, float, float]], kinds: list[str]
) -> None:
    robot = simulation(steered_drive(wheels), exact=False)
    for number, kind in zip(count(), kinds):
        wheel = f"w{number % wheels}"
        general = DRIVE_KINDS[kind].place == "robot"
        robot.inject(Injection(kind=kind, wheel=None if general else wheel))
    for twist in twists:
        cycle = driven(robot, 0.05, twist)[-1]
        for servo in cycle.state.servos:
            assert all(map(math.isfinite, (servo.position or 0, servo.velocity or 0)))
        assert np.isfinite([*cycle.pose, *cycle.twist, *cycle.imu.angular_velocity]).all()


def test_signs_and_offsets_of_servos_are_those_of_the_configuration() -> None:
    drive = steered_drive(3)
    wheels = [
        msgspec.structs.replace(wheel, direction=-1, steering_direction=-1, steering_offset=0.25)
        for wheel in drive.wheels
    ]
    plain = driven(simulation(drive), 1.0)[-1]
    turned = driven(simulation(msgspec.structs.replace(drive, wheels=wheels)), 1.0)[-1]
    assert rates(turned) == pytest.approx([-rate for rate in rates(plain)], abs=0.03)
    expected = [-(heading - 0.25) for heading in headings(plain)]
    assert headings(turned) == pytest.approx(expected, abs=0.002)
