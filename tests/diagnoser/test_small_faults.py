"""Small faults: found as changes of what is constant, and claimed only where motion shows them."""

import math
from collections.abc import Iterator
from operator import sub
from random import Random

import numpy as np
import pytest

from tests.diagnoser.fleet import COMPLAINTS, Member
from tests.diagnoser.rig import GYRO, Rig
from tests.odometry.simulation import differential_drive, steered_drive
from wackel_diagnoser.constants import Constants, Shown
from wackel_diagnoser.findings import CHANGED
from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import Measured, Rows
from wackel_diagnoser.small_faults import BLOCK_S, DELAY, LOOK_S, SmallFaults
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.inverse import inverse
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas import component
from wackel_virtual.build import Build

GYROS = {GYRO: GyroConfig()}
STEP_S = 0.01
CURRENT_A = 0.2
LAG_S = 0.05


class Driven:
    """Steps of a drive that does exactly what it is told, but for what is changed.

    Attributes:
        scale: Of what each wheel shows.
        bias: Of the gyro, rad/s.
        off: Of each steering from its reference, rad.
    """

    def __init__(self, config: DriveConfig) -> None:
        self.layout = Layout(config)
        self.rows = Rows(self.layout, config, GYROS)
        n = self.layout.drive.n
        self.scale, self.bias, self.off = np.ones(n), 0.0, np.zeros(n)
        self._rng = np.random.default_rng(1)
        self._now = 0

    def shown(self, twist: Floats) -> Shown:
        drive, n = self.layout.drive, self.layout.drive.n
        begin, self._now = self._now, self._now + round(STEP_S * 1e9)
        motion = inverse(drive, twist, drive.steering(np.zeros(n)))
        heading = np.where(drive.steers, drive.heading(motion.steering), np.nan)
        rates = np.full(n, np.nan)
        rates[drive.roll_wheels] = motion.wheel_rate[drive.roll_wheels]
        speed = drive.roll_radius * rates[drive.roll_wheels]
        yaw = twist[2] + self.bias + self._rng.normal(0.0, 0.002)
        zeros = np.zeros(n)
        target = Target(
            heading.tolist(),
            [0.0] * n,
            [0.0] * n,
            speed.tolist(),
            [0.0] * len(speed),
            [0.0] * len(speed),
            heading.tolist(),
            (twist[0], twist[1], twist[2]),
            0.0,
        )
        shown = heading + self.off, zeros, rates * self.scale, np.array([yaw])
        step = Step(begin, self._now, STEP_S, *(each.tolist() for each in shown))
        currents = [CURRENT_A] * len(speed)
        measured = self.rows.measure(step, target, np.zeros(1), currents)
        return Shown(step, target, measured, np.zeros(1), currents, LAG_S)

    def drive(self, seconds: float, speed: float = 1.0) -> Iterator[Shown]:
        """On a path that turns slowly from one direction to another."""
        for _ in range(round(seconds / STEP_S)):
            t = self._now / 1e9
            twist = [0.4 + 0.1 * math.sin(t), 0.2 * math.sin(0.7 * t), 0.5 * math.cos(0.4 * t)]
            if not self.layout.drive.steers.any():
                twist[1] = 0.0
            yield self.shown(speed * np.array(twist))


@pytest.mark.parametrize("config", [steered_drive(3), steered_drive(4), differential_drive()])
def test_equations_tell_constants(config: DriveConfig) -> None:
    driven = Driven(config)
    constants = Constants(driven.layout, config, driven.rows, GYROS)
    driven.scale[0], driven.bias = 1.01, 0.03
    shown = list(driven.drive(60.0))
    equations = constants.equations([shown[at : at + 10] for at in range(0, len(shown), 10)])
    told = np.linalg.solve(np.diag(constants.prior) + equations[:, :-1], equations[:, -1])
    assert told[constants.gyro[0]] == pytest.approx(0.03, abs=0.004)
    scale = told[list(constants.scale)]
    assert scale[0] - scale[1] == pytest.approx(0.01, abs=0.002)
    assert told[constants.off[0]] - told[constants.off[1]] == pytest.approx(0.01, abs=0.002)


@pytest.mark.parametrize("config", [steered_drive(4), differential_drive()])
def test_blocks_say_together_what_each_says_by_itself(config: DriveConfig) -> None:
    driven = Driven(config)
    constants = Constants(driven.layout, config, driven.rows, GYROS)
    shown = list(driven.drive(0.2))
    driven.bias = math.nan
    shown += driven.drive(0.02)
    driven.bias = 0.0
    shown += driven.drive(0.08)
    blocks = [shown[:8], shown[8:19], shown[19:]]
    each = sum(constants.equations([block]) for block in blocks)
    assert constants.equations(blocks) == pytest.approx(each, rel=1e-9, abs=1e-6)


def followed(config: DriveConfig) -> tuple[Driven, SmallFaults]:
    driven = Driven(config)
    small = SmallFaults(driven.layout, config, driven.rows, GYROS)
    feed(driven, small, 2.5 * DELAY * LOOK_S)
    assert small.found is None
    return driven, small


def feed(driven: Driven, small: SmallFaults, seconds: float, speed: float = 1.0) -> None:
    for shown in driven.drive(seconds, speed):
        small.step(shown, calm=True)


def test_a_change_is_found_with_its_size_and_ends() -> None:
    driven, small = followed(steered_drive(4))
    driven.off[2] = math.radians(0.5)
    feed(driven, small, 5.0)
    assert small.found is not None
    assert small.found.component == component.wheel_steering("w2")
    assert small.found.size == pytest.approx(math.radians(0.5), rel=0.2)
    driven.off[2] = 0.0
    feed(driven, small, 5.0)
    assert small.found is None


def test_a_shock_is_no_change() -> None:
    driven, small = followed(steered_drive(4))
    driven.bias = 2.0
    feed(driven, small, 2 * BLOCK_S)
    driven.bias = 0.0
    feed(driven, small, 2 * DELAY * LOOK_S)
    assert small.found is None


def test_all_drives_off_together_are_no_fault_of_one() -> None:
    driven, small = followed(steered_drive(3))
    driven.scale[:] = 0.8
    feed(driven, small, 10.0)
    assert small.found is None


def test_what_this_motion_does_not_show_is_not_claimed() -> None:
    driven, small = followed(steered_drive(4))
    driven.scale[1] = 1.03
    feed(driven, small, 10.0, speed=0.0)
    assert small.found is None
    feed(driven, small, 4.0)
    assert small.found is not None
    assert small.found.component == component.wheel_drive("w1")


def test_a_gyro_that_jumps_is_found_at_rest() -> None:
    driven, small = followed(steered_drive(3))
    driven.bias = 0.02
    feed(driven, small, 4.0, speed=0.0)
    assert small.found is not None
    assert small.found.component == component.gyro(GYRO)
    assert small.found.size == pytest.approx(0.02, rel=0.2)


def test_slip_that_bad_calibration_forces_is_no_change() -> None:
    rig = Rig.of("judge8/healthy/3/3/15", 3, worse=3.0)
    rig.drive(45.5)  # to the first long curve
    assert rig.reports == []


def test_tyres_that_a_hard_curve_loads_are_no_change_of_the_gyro() -> None:
    rig = Rig.of("judge13/hard/3/3/11", 3, worse=3.0, driving="hard")
    rig.drive(40.0)
    assert "gyro_deviates" not in {report.code for report in rig.reports}


def test_bad_calibration_that_turns_the_robot_is_no_change_of_the_gyro() -> None:
    rig = Rig.of("judge13/lines/4/3/58", worse=3.0, driving="lines")
    rig.drive(30.0)  # one line, a turn on the spot, and a line in another direction
    assert rig.reports == []


def test_of_how_drives_follow_nothing_is_left_but_what_encoders_round() -> None:
    """What a motor pushes makes it late, which its lag has in it already."""
    rig = Rig.of("tune/following/0", build=Build(droop_m_s=0.09, grip_A=0.6))
    rig.drive(40.0)
    rows, radius = rig.diagnoser._rows, rig.config.wheels[0].radius
    measure, before, misses = rows.measure, [0.0] * 4, []

    def watched(step: Step, target: Target, bias: Floats, currents: list[float]) -> Measured:
        nonlocal before
        measured = measure(step, target, bias, currents)
        if max(map(abs, map(sub, target.speed, before))) > 1.0 * STEP_S:  # it hastens by 1 m/s²
            misses.append(measured.z[rows.rolling])
        before = target.speed
        return measured

    rows.measure = watched  # type: ignore[method-assign]
    rig.drive(20.0)
    assert len(misses) > 200
    rounds = rig.config.encoder_step * radius / STEP_S / math.sqrt(6)
    assert np.std(misses) < 1.15 * rounds


@pytest.mark.parametrize(("number", "lag_s"), [(3, 0.06), (7, 0.04)])
def test_commands_that_jump_teach_how_drives_give_way(number: int, lag_s: float) -> None:
    """What is missed right after a jump is not taken for what a minute of even motion tells."""
    build = Build(lag_s=lag_s)
    rig = Rig.of(f"tune/late/{number}", 3, driving="jumps", build=build)
    rig.drive(30.0)
    following = rig.diagnoser._rows.following
    assert following.gives_way == pytest.approx(build.droop_m_s / build.grip_A, rel=0.1)


def test_a_jump_between_two_blocks_does_not_make_drives_seem_late_for_good() -> None:
    """One whose drives lag 0.02 s. Each stop from an even motion then missed what was expected."""
    rig = Member.of("03e3888f1aeb066d", 568).rig()
    rig.drive(84.0)
    assert [report for report in rig.reports if report.code not in COMPLAINTS] == []


@pytest.mark.parametrize("number", [0, 54])
def test_drives_that_give_way_are_no_fault_on_the_next_circle(number: int) -> None:
    """One even motion does not show how much they do; on the next, wheels pull them otherwise."""
    soft = Build(droop_m_s=0.12, grip_A=0.45)
    rig = Rig.of(f"soft/{number}", 3, driving="circles", build=soft, shown=False)
    rig.drive(75.0)
    assert not rig.reports


@pytest.mark.parametrize(("number", "seconds"), [(1437, 175.0), (816, 270.0)])
def test_what_few_motions_have_shown_does_not_tell_how_another_turns_the_robot(
    number: int, seconds: float
) -> None:
    """Circles one after the other: half a minute of each teaches little more than a moment."""
    rig = Member.of("a46d9a97bf9aef70", number).rig()
    rig.drive(seconds)
    assert rig.reports == []


def test_currents_that_hardly_vary_do_not_tell_how_drives_give_way() -> None:
    """On an even circle they vary by their noise, so that drives seem not to; the others' share of
    speed would then be another, but not that of one which pushes nothing."""
    rig = Member.of("f1f73556c6368a5a", 180).rig()
    rig.drive(246.0)
    assert rig.reports == []


def test_no_drive_runs_ahead_of_its_load() -> None:
    """Two hard jumps seemed to show that; what each drive is faster was then worked out for one
    that does, and taken off for one that does not. One wheel seemed to slip for a minute."""
    rig = Member.of("7e4c3398b3706329", 749).rig()
    rig.drive(10.0)
    assert [report for report in rig.reports if report.code not in COMPLAINTS] == []


def test_a_small_jump_of_the_gyro_is_told_though_a_command_makes_wheels_skid_meanwhile() -> None:
    """What skids is a moment's doing; a change that lasts is none."""
    seed = "1e0712c722d31794/mujoco/3/54"
    rig = Rig.of(seed, 3, physics="mujoco", build=Build.drawn(Random(f"{seed}/build")))
    rig.drive(31.6)
    assert rig.reports == []
    rig.inject("gyro_offset", value=0.02)
    rig.drive(15.0)
    assert rig.active() == [("gyro_deviates", "gyro/body")]
    [report] = rig.reports
    assert report.confidence == CHANGED


def test_what_stands_is_no_small_fault() -> None:
    driven, small = followed(steered_drive(4))
    driven.scale[1] = 0.0
    feed(driven, small, 5.0)
    assert small.found is None


def test_a_motor_that_pulls_all_others_along_is_named_though_all_miss_their_references() -> None:
    """On soft tyres nothing slips; how much drives give way has never shown before."""
    rig = Rig.of("judge9/mujoco/3/70", 3, physics="mujoco")
    rig.drive(31.7)
    rig.inject("drive_scale", "w0", 0.16)
    rig.drive(2.5)
    assert rig.active() == [("wheel_deviates", "wheel/w0/drive")]


@pytest.fixture(scope="module")
def warm() -> Rig:
    rig = Rig.of("tune/small")
    rig.drive(30.0)
    assert rig.reports == []
    return rig


@pytest.mark.parametrize(
    ("kind", "code"), [("drive_scale", "wheel_deviates"), ("drive_sensor_scale", "wheel_sensor")]
)
def test_motor_and_sensor_are_told_apart(warm: Rig, kind: str, code: str) -> None:
    rig = warm.copy()
    rig.inject(kind, "w1", 0.03)
    rig.drive(10.0)
    assert rig.active() == [(code, "wheel/w1/drive")]


@pytest.mark.parametrize("kind", ["steering_offset", "steering_sensor_offset"])
def test_of_a_steering_half_a_degree_off_no_kind_is_claimed(warm: Rig, kind: str) -> None:
    rig = warm.copy()
    rig.inject(kind, "w1", math.radians(0.5))
    rig.drive(12.0)
    assert rig.active() == [("steering_deviates", "wheel/w1/steering")]
    assert {report.code for report in rig.reports} == {"steering_deviates"}


@pytest.mark.parametrize(
    ("number", "driving", "lag_s"), [(0, "circles", 0.062), (4, "shuttle", 0.039)]
)
def test_what_coarse_encoders_round_is_no_change(number: int, driving: str, lag_s: float) -> None:
    drive = steered_drive(4, encoder_step=2 * math.pi / 1024)
    rig = Rig.of(f"vary/coarse/{number}", drive, driving=driving, build=Build(lag_s=lag_s))
    rig.drive(80.0)
    assert rig.reports == []


def test_a_motor_of_a_slow_robot_that_is_hardly_wrong_is_named() -> None:
    """Its wheels are always on the way to what they are told; how late, is known."""
    robot = Rig.of("slow/2", 3, build=Build(lag_s=0.11))
    robot.drive(30.0)
    robot.inject("drive_scale", "w2", -0.03)
    robot.drive(8.0)
    assert robot.active() == [("wheel_deviates", "wheel/w2/drive")]
