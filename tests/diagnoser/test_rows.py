"""Rows of a step in which something is not known: nothing is said of it, and of the rest all."""

import math
from random import Random

import numpy as np
import pytest
from msgspec.structs import replace

from tests.diagnoser.rig import Rig
from tests.odometry.simulation import differential_drive, other_drives, steered_drive
from wackel_diagnoser.constants import Constants, Shown
from wackel_diagnoser.reference import LAG, PENDING, Reference
from wackel_diagnoser.rows import Following, Measured, Rows
from wackel_diagnoser.tyres import HOLDS_M_S2
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas.drive import TwistCommand
from wackel_schemas.fault import FaultReport

GYROS = {"body": GyroConfig()}
STEP_NS = 10_000_000
STEP_S = STEP_NS / 1e9
LAG_S = 0.05


class Moving:
    """Wheels that roll forward, each at 10 rad/s."""

    def __init__(self, config: DriveConfig) -> None:
        self.layout = Layout(config)
        self.rows = Rows(self.layout, config, GYROS)
        self.reference = Reference(self.layout, config)
        self._end = STEP_NS

    def command(self, *, omega: float = 0.0, along: float = 0.0) -> None:
        """That they shall; ``along``: which way, rad."""
        vx, vy = 0.5 * math.cos(along), 0.5 * math.sin(along)
        self.reference.command(TwistCommand(stamp=self._end, vx=vx, vy=vy, omega=omega))

    def shown(
        self,
        *,
        lost: int | None = None,
        load: float = 0.0,
        yaw: float = 0.01,
        stands: float = 0.0,
        learnt: bool = True,
    ) -> Shown:
        """The next step; ``lost``: the wheel that has not been heard of; ``load``: of the first
        motor; ``yaw``: what the gyro shows; ``stands``: where all wheels do, rad; ``learnt``:
        whether lags are."""
        drive = self.layout.drive
        heading = np.where(drive.steers, stands, np.nan)
        steered = np.where(drive.steers, 0.0, np.nan)
        rate = np.full(drive.n, 10.0)
        if lost is not None:
            heading[lost] = steered[lost] = rate[lost] = np.nan
        begin, self._end = self._end, self._end + STEP_NS
        each = heading.tolist(), steered.tolist(), rate.tolist()
        step = Step(begin, self._end, STEP_S, *each, [yaw])
        target = self.reference.step(step, 0.0)
        assert target.lag_share > LAG or not target.known
        if learnt:
            target = replace(target, pending_share=PENDING, lag_share=LAG)
        currents = [load, *[0.0] * (len(drive.roll_wheels) - 1)]
        measured = self.rows.measure(step, target, np.zeros(1), currents)
        return Shown(step, target, measured, np.zeros(1), currents, LAG_S)


def sound(measured: Measured) -> bool:
    """Whether all of it are numbers, and what is missing says nothing."""
    missing = ~measured.present
    variance, loose, size = measured.spread()
    each = (measured.z, measured.h, variance, loose, size)
    return (
        all(bool(np.isfinite(values).all()) for values in each)
        and not measured.z[missing].any()
        and not measured.h[missing].any()
        and not size[missing].any()
    )


def missing(rows: Rows, measured: Measured) -> set[str]:
    return {name for name, there in zip(rows.names, measured.present, strict=True) if not there}


@pytest.mark.parametrize("config", [steered_drive(4), differential_drive()])
def test_without_a_command_only_references_are_missing(config: DriveConfig) -> None:
    moving = Moving(config)
    measured = moving.shown().measured
    assert sound(measured)
    assert measured.speed == pytest.approx(10.0 * config.wheels[0].radius)
    kinds = {name.rsplit("/", 1)[-1] for name in missing(moving.rows, measured)}
    assert kinds <= {"steering", "rolling"}
    assert "rolling" in kinds
    moving.command()
    assert moving.shown().measured.present.all()


@pytest.mark.parametrize("learnt", [True, False])
def test_a_servo_that_is_not_heard_takes_its_own_rows_with_it(learnt: bool) -> None:
    moving = Moving(steered_drive(4))
    moving.command()
    moving.shown(learnt=learnt)
    measured = moving.shown(lost=2, learnt=learnt).measured
    assert sound(measured)
    kinds = ("slide", "roll", "steering", "rolling")
    assert missing(moving.rows, measured) == {f"wheel/w2/{kind}" for kind in kinds}


def test_wheels_that_steer_late_are_expected_to_pull_each_other() -> None:
    """While they turn, each points a little elsewhere than its encoder shows, which none alone
    explains."""
    slips = []
    for lag_s in (0.0, 0.02):
        moving = Moving(steered_drive(4))
        moving.rows.lag_s = lag_s
        moving.command()
        moving.shown()
        moving.command(omega=1.0)
        slips.append(np.sqrt(moving.shown().measured.spread().loose[moving.rows.rolls]))
    at_once, late = slips
    assert (late > at_once + 0.005).all()


def test_wheels_that_turn_are_known_to_pull_each_other_once_no_command_is_known() -> None:
    """As if none had been known before: one that is lost while wheels turn makes no fault."""
    slips = []
    for told in (True, False):
        moving = Moving(steered_drive(4))
        for hundredths in range(50):
            if told:
                moving.command(along=hundredths / 100)
            moving.shown(stands=hundredths / 100)
        moving.shown(stands=0.5)
        if told:
            moving.command(along=1.0)
        shown = moving.shown(stands=0.51)
        assert not shown.target.known
        slips.append(np.sqrt(shown.measured.spread().loose[moving.rows.slides]))
    assert (slips[1] > 0.01).all()
    assert slips[0] == pytest.approx(slips[1], rel=0.15)


def test_a_drive_that_pushes_may_be_slower() -> None:
    moving = Moving(steered_drive(4))
    moving.rows.following = Following([0.0] * 4, gives_way=0.05, late_s=0.0)
    moving.command()
    rolling = moving.rows.rolling
    unloaded = moving.shown().measured.z[rolling]
    loaded = moving.shown(load=0.4).measured.z[rolling]
    assert loaded - unloaded == pytest.approx([0.02, 0.0, 0.0, 0.0], abs=1e-9)


def test_a_drive_is_expected_to_be_as_slow_and_as_early_as_it_is() -> None:
    moving = Moving(differential_drive())
    moving.rows.following = Following([-0.01, 0.0], gives_way=0.0, late_s=-0.005)
    moving.command()
    before = moving.shown()
    speeds = [each + 0.02 for each in before.target.speed]
    hastening = replace(before.target, speed=speeds)
    yielded = moving.rows.measure(before.step, hastening, np.zeros(1), [0.0, 0.0]).yielded
    early = 0.005 * 0.02 / STEP_S
    assert yielded == pytest.approx([early - 0.01 * speeds[0], early])


def test_wheels_that_are_calibrated_badly_may_turn_the_robot_otherwise_than_they_show() -> None:
    moving = Moving(steered_drive(3))
    moving.command()
    unsure = []
    for wrong in (0.003, 0.009):
        moving.rows.adopt(
            np.full(moving.rows.gyros.stop, wrong**2), scales=np.zeros((2, moving.rows.count))
        )
        unsure.append(
            math.sqrt(moving.shown().measured.spread().variance[moving.rows.gyros].item())
        )
    assert unsure[1] == pytest.approx(3.0 * unsure[0], rel=0.01)


def test_the_robot_goes_on_as_it_did_long_after_wheels_point_elsewhere() -> None:
    """At 1.5 m/s they turn by 57° in 0.1 s; tyres need 0.3 s for what that asks of them."""
    moving = Moving(steered_drive(3))
    moving.command()
    target = replace(moving.shown().target, speed=[1.5] * 3)
    skids = []
    for angle in [*[0.0] * 30, *np.linspace(0.0, 1.0, 11), *[1.0] * 30]:
        begin, end = STEP_NS * len(skids), STEP_NS * (len(skids) + 1)
        rate = (1.5 / moving.layout.drive.roll_radius).tolist()
        step = Step(begin, end, STEP_S, [angle] * 3, [0.0] * 3, rate, [0.0])
        told = replace(target, heading=[angle] * 3, turned=[0.0] * 3)
        skids.append(moving.rows.measure(step, told, np.zeros(1), [0.0] * 3).creep)
    turned = 30 + 10
    assert skids[29] < 0.001
    assert 2.0 * 1.5 * math.sin(0.5) - HOLDS_M_S2 * 0.1 < skids[turned] < 1.1
    assert skids[turned + 5] > 0.3
    assert skids[turned + 20] < 0.1


def test_a_gyro_that_jumps_while_nobody_turns_is_held_against_the_wheels_at_once() -> None:
    unsure = []
    for omega in (0.0, 0.5):
        moving = Moving(steered_drive(4))
        moving.command()
        for _ in range(20):
            moving.shown()
        moving.command(omega=omega)
        for yaw in (0.1, 0.2):
            measured = moving.shown(yaw=yaw).measured
        unsure.append(math.sqrt(measured.spread().loose[moving.rows.gyros].item()))
    nobody, turning = unsure
    assert nobody < 0.01
    assert turning > 0.05


@pytest.mark.parametrize("lost", [None, 1])
def test_constants_are_not_learnt_from_what_is_missing(lost: int | None) -> None:
    config = steered_drive(4)
    moving = Moving(config)
    constants = Constants(moving.layout, config, moving.rows, GYROS)
    block = [moving.shown(lost=lost) for _ in range(10)]
    equations = constants.equations([block])
    assert np.isfinite(equations).all()
    assert not equations[constants.off.start : constants.off.stop].any()


@pytest.mark.parametrize("name", ["steered", "mecanum", "omni"])
def test_stamps_that_are_a_millisecond_off_are_no_fault(name: str) -> None:
    drive = {"steered": steered_drive(3), **other_drives()}[name]
    rig, random = Rig.of(f"tune/uneven/{name}", drive), Random(1)
    for _ in range(3000):
        cycle = rig.simulation.step(*rig.path[rig.cycles % len(rig.path)].tolist())
        rig.cycles += 1
        cycle.state.stamp += random.randrange(1_000_000)
        assert not [each for each in rig.feed(cycle) if isinstance(each, FaultReport)]


@pytest.mark.parametrize("name", ["differential", "mecanum", "omni"])
def test_answers_that_are_late_though_no_stamp_shows_it_are_no_fault(name: str) -> None:
    """As of a computer or an adapter that is busy."""
    drive = {"differential": differential_drive(), **other_drives()}[name]
    rig, random = Rig.of(f"late/{name}/0", drive), Random(0)
    for _ in range(2500):
        cycle = rig.simulation.step(*rig.path[rig.cycles % len(rig.path)].tolist())
        rig.cycles += 1
        late_s = random.uniform(-0.001, 0.001)
        for servo in cycle.state.servos:
            assert servo.position is not None
            assert servo.velocity is not None
            servo.position += servo.velocity * late_s
        assert not [each for each in rig.feed(cycle) if isinstance(each, FaultReport)]
