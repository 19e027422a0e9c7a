"""No false alarm in any kind of driving, also of a robot that is badly calibrated."""

from itertools import cycle, islice, pairwise
from random import Random

import msgspec
import numpy as np
import pytest

from tests.diagnoser.driving import DRIVING, course
from tests.diagnoser.fleet import COMPLAINTS, Member
from tests.diagnoser.rig import Rig
from tests.odometry.simulation import other_drives, steered_drive
from wackel_node.config_drive import DriveConfig
from wackel_schemas import component
from wackel_schemas.fault import FaultReport
from wackel_virtual.build import Build


@pytest.mark.parametrize("kind", ["random", *DRIVING])
def test_courses_begin_and_end_at_rest_and_repeat_with_their_seed(kind: str) -> None:
    path = course(kind, np.random.default_rng(1), 30.0)
    assert len(path) >= 2000
    assert not path[0].any()
    assert not path[-1].any()
    assert (path == course(kind, np.random.default_rng(1), 30.0)).all()


def test_only_commands_that_jump_ask_for_more_than_tyres_hold() -> None:
    for kind in DRIVING:
        path = course(kind, np.random.default_rng(2), 60.0)
        most = max(float(np.hypot(*(b - a)[:2])) for a, b in pairwise(path)) * 100.0
        assert (most > 6.0) == (kind == "jumps"), kind


@pytest.mark.parametrize(
    ("kind", "count"), [("circles", 4), ("shuttle", 4), ("hard", 3), ("jumps", 3)]
)
def test_bad_calibration_is_no_fault(kind: str, count: int) -> None:
    rig = Rig.of(f"tune/driving/{count}", count, worse=3.0, driving=kind)
    rig.drive(25.0)
    assert [each.code for each in rig.reports if each.component != component.COMMAND] == []


@pytest.mark.parametrize(("lag_s", "number"), [(0.022, 1), (0.04, 4), (0.06, 5)])
def test_servos_of_any_lag_are_sound_though_commands_jump(lag_s: float, number: int) -> None:
    """What is still to come of a jump differs a lot for lags that hardly differ."""
    rig = Rig.of(f"tune/lag/{number}", 4, driving="jumps", build=Build(lag_s=lag_s))
    rig.drive(18.0)
    assert [each.code for each in rig.reports if each.component != component.COMMAND] == []
    assert rig.residuals is not None
    steering, rolling = rig.residuals.lags_s
    # Steerings are taken to turn slower by an encoder's step, which a shorter lag makes up for.
    assert steering == pytest.approx(lag_s, rel=0.05, abs=0.0013)
    # Drives give way to the robot's mass, which looks like a lag of up to 10 ms.
    assert 0.0 < rolling - lag_s < 0.01


def _steered_late(drive: DriveConfig, *faults: tuple[str, str]) -> Rig:
    """A robot that turns for the first time after a long way straight on; faults, kind and wheel,
    begin just before."""
    rig = Rig.of("tune/first turn", drive, build=Build(lag_s=0.12), shown=False)
    way, turn = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    for share in np.linspace(0.0, 1.0, 100):
        rig.cycle(share * way)
    rig.drive(4.0, way)
    for share in np.linspace(1.0, 0.0, 100):
        rig.cycle(share * way)
    rig.drive(0.5, np.zeros(3))
    for kind, wheel in faults:
        rig.inject(kind, wheel)
    for share in np.linspace(0.0, 1.0, 50):
        rig.cycle(share * turn)
    rig.drive(1.0, turn)
    return rig


STEERED_LATE = pytest.mark.parametrize(
    "drive", [steered_drive(4), other_drives()["ackermann"]], ids=["4 steered", "ackermann"]
)


@STEERED_LATE
def test_steerings_whose_lag_nobody_knows_yet_are_sound(drive: DriveConfig) -> None:
    assert _steered_late(drive).reports == []


@STEERED_LATE
@pytest.mark.parametrize("kind", ["steering_blocked", "steering_sensor_stuck"])
def test_of_these_one_that_fails_is_told_in_its_first_turn(drive: DriveConfig, kind: str) -> None:
    rig = _steered_late(drive, (kind, drive.wheels[0].name))
    assert {report.component for report in rig.reports} == {
        component.wheel_steering(drive.wheels[0].name)
    }


@pytest.mark.parametrize(
    "way",
    [
        [(0.2, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.0, 0.0)],
        [(0.05, 0.3, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0)],
    ],
    ids=["ahead", "sideways"],
)
def test_drives_whose_lag_nobody_knows_yet_are_sound(way: list[tuple[float, ...]]) -> None:
    """In its first seconds there are few commands, all of which jump: that is not much to learn
    from, and what is off meanwhile is not how much such a robot is usually off."""
    drive = other_drives()["mecanum"]
    rig = Rig.of("tune/first jumps", drive, build=Build(lag_s=0.12), shown=False)
    rig.drive(1.0, np.zeros(3))
    for twist in way:
        rig.drive(2.1, np.array(twist))
    assert rig.reports == []


def test_a_robot_that_never_shows_its_lags_is_watched_as_closely_as_another() -> None:
    """It changes its speed too gently; what its sensors are like it shows even so."""
    rig = Rig.of("tune/gentle", 4, shown=False)
    faster, way = np.linspace(0.0, 1.0, 300), np.array([0.4, 0.0, 0.0])
    for share in (*faster, *faster[::-1], *faster, *faster[::-1], *faster):
        rig.cycle(share * way)
    rig.inject("gyro_offset", value=0.05)
    begin_ns = rig.now_ns
    rig.drive(1.0, way)
    assert [report.code for report in rig.reports] == ["gyro_deviates"]
    assert rig.reports[0].stamp - begin_ns < 200_000_000


def test_states_that_are_stamped_late_are_no_fault_of_steerings() -> None:
    """In every tenth, by up to 2 ms; all seem to turn faster in one step than steerings can."""
    rig, random = Rig.of("tune/late/5", 4, shown=False), Random("late/5")
    said: list[str] = []
    for twist in islice(cycle(rig.path.tolist()), 3000):
        now = rig.simulation.step(*twist)
        if random.random() < 0.1:
            late_ns = round(1e6 * min(random.expovariate(1.0), 2.0))
            now.state = msgspec.structs.replace(now.state, stamp=now.state.stamp + late_ns)
        said += [message.code for message in rig.feed(now) if isinstance(message, FaultReport)]
    assert said == []


def test_wheels_that_turn_at_a_start_are_no_lag_of_the_drives() -> None:
    """They slow each other down; taken for a lag, it is missed where all stop together."""
    rig = Rig.of("alarms/1022", 3, physics="mujoco", driving="jumps")
    rig.drive(15.0)
    assert [each.code for each in rig.reports if each.component != component.COMMAND] == []


def test_friction_learnt_at_low_speed_is_not_believed_at_a_higher_one() -> None:
    """The first acceleration to 1.6 m/s looks as if the motors did nothing."""
    rig = Rig.of("alarms/1212", 4)
    rig.drive(13.0)
    assert rig.reports == []


def test_a_motor_that_others_spare_all_slowing_down_is_not_idle() -> None:
    """For a second they push its wheel just as much as it would have to brake."""
    rig = Rig.of("alarms/548", 4, build=Build(lag_s=0.1057))
    rig.drive(12.0)
    assert rig.reports == []


def test_a_tyre_that_spends_all_its_grip_is_no_fault_of_its_wheel() -> None:
    """The outer wheel of a robot that turns as quickly as it can slips by a tenth."""
    rig = Rig.of("alarms/311", 3, physics="mujoco", driving="hard", build=Build(lag_s=0.0219))
    rig.drive(65.0)
    assert [each.code for each in rig.reports if each.component != component.COMMAND] == []


def test_wheels_that_pull_each_other_are_no_fault_of_the_gyro() -> None:
    """Some skid for it, and turn the robot otherwise than they show, by a twelfth."""
    rig = Rig.of("alarms/2748", 4, physics="mujoco", worse=3.0, driving="circles")
    rig.drive(70.0)
    assert rig.reports == []


@pytest.mark.parametrize(
    ("seed", "driving", "seconds"),
    [("b5/27", "random", 17.0), ("b5/53", "random", 43.0), ("b6/49", "hard", 72.0)],
    ids=["gyro", "zero", "wheel"],
)
def test_calibration_three_times_worse_is_no_fault(seed: str, driving: str, seconds: float) -> None:
    """What it forces on four wheels that hold well looks in some motions like one of a part."""
    rig = Rig.of(
        seed, 4, physics="mujoco", worse=3.0, driving=driving, build=Build.drawn(Random(seed))
    )
    rig.drive(seconds)
    assert [each.code for each in rig.reports if each.component != component.COMMAND] == []


@pytest.mark.parametrize(
    ("number", "driving", "seconds"), [(374, "jumps", 6.0), (390, "hard", 136.0)]
)
def test_wheels_that_skid_for_a_command_are_no_fault(
    number: int, driving: str, seconds: float
) -> None:
    """Neither where no steering can follow it, nor where tyres do not hold what it asks for."""
    member = Member.of("becb69e2c89c286c", number)
    rig = Rig.of(member.seed, 3, driving=driving, build=member.build)
    rig.drive(seconds)
    assert [each.code for each in rig.reports if each.component != component.COMMAND] == []


@pytest.mark.parametrize(
    ("fleet", "number", "seconds"),
    [("free1", 63, 8.0), ("free1", 72, 12.0), ("free2", 172, 22.0), ("free2", 384, 66.0)],
    ids=["skid that is over", "steering told to turn by nothing", "lag not known yet", "at ease"],
)
def test_nothing_is_wrong_with_this_member(fleet: str, number: int, seconds: float) -> None:
    rig = Member.of(fleet, number).rig()
    rig.drive(seconds)
    assert [each.code for each in rig.reports if each.code not in COMPLAINTS] == []


def test_a_command_that_jumps_does_not_hide_a_blocked_wheel() -> None:
    rig = Rig.of("tune/driving", 4, driving="jumps")
    rig.drive(15.0)
    rig.inject("wheel_blocked", "w2")
    rig.drive(4.0)
    assert ("wheel_blocked", "wheel/w2/drive") in rig.active()


def test_a_command_that_no_steering_can_follow_is_what_disturbs_the_drive() -> None:
    """It is told as such, and that all wheels slip for it is not told once more."""
    seed = "hard/29"
    rig = Rig.of(seed, 4, physics="mujoco", driving="jumps", build=Build.drawn(Random(seed)))
    rig.drive(100.0)
    assert {report.code for report in rig.reports} == {"command_infeasible"}
