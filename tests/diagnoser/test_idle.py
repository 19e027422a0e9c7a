"""Motors that move nothing, and what is no such motor."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.diagnoser.rig import WARM_UP_S, Rig
from wackel_diagnoser.efforts import Needs, Rolling
from wackel_diagnoser.idle import AT_MOST, NOISE, IdleMotors
from wackel_kinematics.array import Floats
from wackel_schemas.fault import FaultReport

NEEDS = Needs(friction=0.15, mass=0.05, turning=-0.025, unsure=0.0)
USUAL = [0.1**2] * 4
LOOK_S = 0.04
STRAIGHT = [0.0] * 4
SOUND = [False] * 4


def see(
    motors: IdleMotors,
    speed: float,
    current: Floats,
    usual: list[float] = USUAL,
    faulty: list[bool] = SOUND,
) -> None:
    """One look at motors of a robot that goes straight on, at m/s."""
    rolling = Rolling(current.tolist(), NEEDS, usual)
    motors.step(LOOK_S, [speed] * 4, STRAIGHT, rolling, faulty=faulty)


def look(
    motors: IdleMotors,
    seconds: float,
    idle: int | None,
    work_a: float = 0.1,
    needs: Needs = NEEDS,
    *,
    sways_a: float = 0.003,
) -> None:
    """Lets motors drive at changing speed, all but one against each other; ``needs``: as learnt;
    ``sways_a``: by how much readings do."""
    rng = np.random.default_rng(1)
    push = np.zeros(4)
    for step in range(round(seconds / LOOK_S)):
        speed = np.full(4, 0.5 + 0.2 * math.sin(step * LOOK_S))
        push = 0.9 * push + math.sqrt(1 - 0.9**2) * rng.normal(0.0, work_a, 4)
        load = push + NEEDS[1] * 0.2 * math.cos(step * LOOK_S)
        if idle is not None:
            load[idle] = 0.0
        current = NEEDS[0] * speed + load + rng.normal(0.0, sways_a, 4)
        motors.step(
            LOOK_S, speed.tolist(), STRAIGHT, Rolling(current.tolist(), needs, USUAL), faulty=SOUND
        )


def test_a_motor_that_idles_while_others_work_is_found_and_heals() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    look(motors, 5.0, idle=2)
    assert motors.found == [False, False, True, False]
    look(motors, 4.0, idle=None)
    assert not any(motors.found)


def test_a_motor_that_was_found_stays_so_at_an_even_speed() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    look(motors, 5.0, idle=2)
    for _ in range(round(60.0 / LOOK_S)):
        see(motors, 0.3, np.full(4, NEEDS.friction * 0.3))
    assert motors.found == [False, False, True, False]


def test_a_motor_that_idles_unevenly_is_found() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    look(motors, 5.0, idle=2, sways_a=AT_MOST * NOISE)
    assert motors.found == [False, False, True, False]


def test_motors_that_all_have_little_to_do_are_not_idle() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    look(motors, 60.0, idle=None, work_a=0.002)
    assert not any(motors.found)


def test_motors_that_work_are_not_idle() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    look(motors, 600.0, idle=None)
    assert not any(motors.found)


def mistake(motors: IdleMotors, unsure: float) -> None:
    """Lets all motors slow down, and then hasten, so that they need as much less current, and then
    more, as their friction is taken for less than it is, and then for more; all but the first push
    each other a little."""
    rng = np.random.default_rng(4)
    speed, off, push = 1.6, 0.05, np.zeros(4)
    for sign in (-1, 1):
        needs = NEEDS._replace(friction=NEEDS.friction + sign * off, unsure=unsure)
        for _ in range(round(2.0 / LOOK_S)):
            speed *= math.exp(sign * off / NEEDS.mass * LOOK_S)
            push = 0.9 * push + math.sqrt(1 - 0.9**2) * rng.normal(0.0, 0.02, 4)
            push[0] = 0.0
            current = needs.friction * speed + push + rng.normal(0.0, 0.003, 4)
            rolling = Rolling(current.tolist(), needs, [0.02**2] * 4)
            motors.step(LOOK_S, [speed] * 4, STRAIGHT, rolling, faulty=SOUND)


def test_friction_that_is_taken_for_another_makes_no_motor_idle() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    mistake(motors, unsure=0.0)
    assert any(motors.found), "who is sure of it must think so"
    motors = IdleMotors(4, 1 / LOOK_S)
    mistake(motors, unsure=0.05)
    assert not any(motors.found)


def test_friction_that_is_hardly_known_excuses_no_motor_that_works() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    look(motors, 600.0, idle=None, needs=NEEDS._replace(unsure=0.05))
    assert not any(motors.found)


def swerve(motors: IdleMotors, *, told: bool) -> None:
    """Along and about at once, faster and slower, as a disc on four wheels at its rim: to turn, it
    needs half as much as it would to drive. The first wheel has nothing to do."""
    rng = np.random.default_rng(5)
    along, about = np.array([0.5, 0.1, 1.2, -0.6]), np.array([-1.0, 1.0, 1.0, -1.0])
    for step in range(round(8.0 / LOOK_S)):
        speed, hastens = math.sin(2.0 * step * LOOK_S), 2.0 * math.cos(2.0 * step * LOOK_S)
        current = NEEDS.friction * (along + about) * speed + rng.normal(0.0, 0.003, 4)
        current += NEEDS.mass * (along + 0.5 * about) * hastens
        turning = (about * speed).tolist() if told else STRAIGHT
        rolling = Rolling(current.tolist(), NEEDS, USUAL)
        motors.step(LOOK_S, ((along + about) * speed).tolist(), turning, rolling, faulty=SOUND)


def test_a_wheel_that_turning_leaves_nothing_to_do_is_not_idle() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    swerve(motors, told=False)
    assert motors.found[0], "who takes it for driving must think so"
    motors = IdleMotors(4, 1 / LOOK_S)
    swerve(motors, told=True)
    assert not any(motors.found)


def drive_evenly(motors: IdleMotors, seconds: float, blocked: int | None = None) -> None:
    """On even ground at an even speed, where motors need little but for friction."""
    rng = np.random.default_rng(2)
    push = np.zeros(4)
    for _ in range(round(seconds / LOOK_S)):
        push = 0.98 * push + math.sqrt(1 - 0.98**2) * rng.normal(0.0, 0.009, 4)
        current = NEEDS[0] * 0.3 + push + rng.normal(0.0, 0.003, 4)
        if blocked is not None:
            current[blocked] = 1.2
        see(motors, 0.3, current, [0.009**2] * 4)


def fight(motors: IdleMotors, *, known: bool) -> None:
    """A wheel is blocked, which two others drag by jerks, and the last is spared."""
    look(motors, 5.0, idle=None)
    rng = np.random.default_rng(8)
    for step in range(round(3.0 / LOOK_S)):
        seconds = step * LOOK_S
        speed = 0.3 + 0.15 * math.sin(4.0 * seconds)
        load = np.array((1.2, 0.6, 0.4, 0.0)) * (1.0 + 0.3 * math.sin(7.0 * seconds))
        current = NEEDS.friction * speed + load + rng.normal(0.0, 0.003, 4)
        see(motors, speed, current, [0.009**2] * 4, faulty=[known, False, False, False])


def test_a_motor_that_others_spare_while_they_drag_a_wheel_is_not_idle() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    fight(motors, known=False)
    assert motors.found[3], "who does not know of it must think so"
    motors = IdleMotors(4, 1 / LOOK_S)
    fight(motors, known=True)
    assert not any(motors.found)


def test_others_that_have_pushed_hard_a_second_ago_do_not_work_now() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    rng = np.random.default_rng(9)
    for step in range(round(6.6 / LOOK_S)):
        seconds = step * LOOK_S
        speed, hastens_m_s2 = 0.3 - 0.1 * math.cos(4.0 * seconds), 0.4 * math.sin(4.0 * seconds)
        load = np.full(4, NEEDS.mass * hastens_m_s2)
        if seconds < 5.0:
            load += rng.normal(0.0, 0.03, 4)
        elif seconds < 5.4:
            load += 0.3
            load[1] = 0.0
        else:  # the robot rolls as it would by itself
            load[:] = 0.0
        current = NEEDS.friction * speed + load + rng.normal(0.0, 0.003, 4)
        see(motors, speed, current, [0.03**2] * 4)
    assert not any(motors.found)


def test_on_even_ground_a_change_of_speed_and_back_tells() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    rng = np.random.default_rng(3)
    looks = round(1.2 / LOOK_S)

    def drive(idle: int | None) -> None:
        """Evenly, then faster for a second, and slower again."""
        drive_evenly(motors, 5.0)
        for step in range(2 * looks):
            acceleration = 1.0 if step < looks else -1.0
            speed = 0.3 + min(step, 2 * looks - step) * LOOK_S
            load = np.full(4, NEEDS[1] * acceleration)
            if idle is not None:
                load[idle] = 0.0
            current = NEEDS[0] * speed + load + rng.normal(0.0, 0.003, 4)
            see(motors, speed, current, [0.009**2] * 4)

    drive(idle=None)
    assert not any(motors.found)
    drive(idle=2)
    assert motors.found == [False, False, True, False]


def rub(motors: IdleMotors, share: Callable[[float], float]) -> None:
    """Three motors hasten the robot and slow it down, for six seconds. The second has nothing to do
    but needs more by a share of the friction that is known, which may depend on the time, s."""
    rng = np.random.default_rng(6)
    for step in range(round(6.0 / LOOK_S)):
        seconds = step * LOOK_S
        speed, acceleration = 1.0 - math.cos(2.0 * seconds), 2.0 * math.sin(2.0 * seconds)
        load = np.full(4, NEEDS.mass * acceleration)
        load[1] = share(seconds) * NEEDS.friction * speed
        current = NEEDS.friction * speed + load + rng.normal(0.0, 0.003, 4)
        see(motors, speed, current)


def test_a_motor_alone_may_need_a_third_less_than_motors_that_drive() -> None:
    """For what wheels rub away on the floor is taken for friction of the motors."""
    motors = IdleMotors(4, 1 / LOOK_S)
    rub(motors, lambda _: -0.3)
    assert motors.found == [False, True, False, False]


def test_a_motor_that_needs_now_more_now_less_at_the_same_speed_is_not_idle() -> None:
    """What others push may be nearly what it needs, but it is not the same for long."""
    motors = IdleMotors(4, 1 / LOOK_S)
    rub(motors, lambda seconds: -0.2 + 0.3 * math.sin(5.0 * seconds))
    assert not any(motors.found)


def test_a_motor_that_has_nothing_to_do_for_less_than_a_second_is_not_idle() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    look(motors, 5.0, idle=None)
    look(motors, 0.8, idle=1)
    assert not any(motors.found)


def test_motors_that_hardly_work_are_not_idle_nor_is_one_that_was_blocked() -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    drive_evenly(motors, 300.0)
    assert not any(motors.found)
    drive_evenly(motors, 1.0, blocked=1)
    drive_evenly(motors, 300.0)
    assert not any(motors.found)


def test_motors_of_a_robot_that_hastens_gently_are_not_idle() -> None:
    """They need about as much to hasten as they push each other, and that changes as slowly."""
    motors = IdleMotors(4, 1 / LOOK_S)
    rng = np.random.default_rng(7)
    push = np.zeros(4)
    for step in range(round(600.0 / LOOK_S)):
        seconds = step * LOOK_S
        speed, acceleration = 0.3 - 0.25 * math.cos(seconds), 0.25 * math.sin(seconds)
        push = 0.98 * push + math.sqrt(1 - 0.98**2) * rng.normal(0.0, 0.012, 4)
        load = push + NEEDS.mass * acceleration
        current = NEEDS.friction * speed + load + rng.normal(0.0, 0.003, 4)
        see(motors, speed, current, [0.012**2] * 4)
        assert not any(motors.found)


@pytest.mark.parametrize(("hastens_m_s2", "usual_a"), [(0.3, 0.14), (0.8, 0.05), (0.8, 0.016)])
def test_a_motor_that_others_relieve_of_an_even_push_is_not_idle(
    hastens_m_s2: float, usual_a: float
) -> None:
    """As of one robot in fifteen hours, that hastened hardly, and of one in seventy, that hastened
    evenly: all wheels push each other as before."""
    motors = IdleMotors(4, 1 / LOOK_S)
    rng = np.random.default_rng(8)
    speed, push = 1.0, np.array([0.05, 0.0, -0.15, 0.1])
    for _ in range(round(8.0 / LOOK_S)):
        speed += hastens_m_s2 * LOOK_S
        load = push + NEEDS.mass * hastens_m_s2
        load[1] = 0.0
        current = NEEDS.friction * speed + load + rng.normal(0.0, 0.005, 4)
        see(motors, speed, current, [usual_a**2] * 4)
        assert not any(motors.found)


NUMBERS = st.floats(-1e3, 1e3) | st.just(math.nan)  # as they can come


@given(arrays(np.float64, 4, elements=NUMBERS), arrays(np.float64, 4, elements=NUMBERS))
def test_nonsense_convicts_nobody(speed: Floats, current: Floats) -> None:
    motors = IdleMotors(4, 1 / LOOK_S)
    with np.errstate(all="ignore"):
        for _ in range(3):
            motors.step(
                LOOK_S,
                speed.tolist(),
                STRAIGHT,
                Rolling(current.tolist(), NEEDS, USUAL),
                faulty=SOUND,
            )
    assert not any(motors.found)
    look(motors, 5.0, idle=2)
    assert motors.found[2]


def test_a_wheel_off_its_motor_is_named() -> None:
    rig = Rig.of("tune/loose")
    rig.drive(WARM_UP_S)
    assert rig.reports == []
    rig.inject("wheel_loose", "w1")
    rig.drive(5.0)
    assert rig.active() == [("wheel_free", "wheel/w1/drive")]


def test_servos_that_do_not_answer_are_not_blamed() -> None:
    rig = Rig.of("tune/silent")
    rig.drive(12.0)
    for _ in range(800):
        cycle = rig.simulation.step(*rig.path[rig.cycles].tolist())
        rig.cycles += 1
        cycle.state.servos = [each for each in cycle.state.servos if each.id not in (1, 101)]
        assert [m for m in rig.feed(cycle) if isinstance(m, FaultReport)] == []


def test_a_wheel_that_is_at_ease_at_an_even_speed_is_not_free() -> None:
    rig = Rig.of("tune/paths/fast/4/1/0", 4)
    for _ in range(2):
        rig.drive(4.0, np.array([0.4, 0.0, 0.0]))
        rig.drive(2.0, np.array([0.0, 0.0, 0.8]))
        rig.drive(2.0, np.array([0.0, 0.4, 0.0]))
    assert "wheel_free" not in {report.code for report in rig.reports}
