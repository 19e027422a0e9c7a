"""Every kind of fault that the virtual bus can have: injected, named in its place, healed."""

import itertools
import math
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random

import msgspec
import pytest

from tests import robot as robots
from tests.conftest import wait_until
from tests.end_to_end.command import LIMIT_S, wackel
from tests.robot import Robot
from wackel_schemas import keys
from wackel_schemas.bus import BusCommand, BusRequest, ServoGoal
from wackel_virtual.faults import KINDS

pytestmark = [pytest.mark.process, pytest.mark.alone]

SERVOS = 6


@dataclass(frozen=True)
class Case:
    """A fault and its name.

    Attributes:
        kind: As ``wackel virtual kinds`` lists it.
        place: Servo, or the one to which the cable leads.
        code: As ``fault_codes`` has it.
        component: Below the bus; empty: the bus itself.
        value: Strength; absent: the usual one.
        reboot: The servo has to be rebooted after the repair.
    """

    kind: str
    place: int | None
    code: str
    component: str = ""
    value: float | None = None
    reboot: bool = False

    def __str__(self) -> str:
        return self.kind if self.place is None else f"{self.kind} at {self.place}"

    def path(self, bus: str) -> str:
        """The component on this bus."""
        return f"bus/{bus}/{self.component}" if self.component else f"bus/{bus}"

    def inject(self, config: Path, bus: str) -> None:
        place = [] if self.place is None else ["--servo", str(self.place)]
        value = [] if self.value is None else ["--value", str(self.value)]
        virtual(config, "inject", self.kind, "--bus", bus, *place, *value)

    def heal(self, config: Path, bus: str) -> None:
        virtual(config, "heal", self.kind, "--bus", bus)

    def is_confirmed(self, robot: Robot, bus: str) -> bool:
        return robot.confirmed(self.code, self.path(bus))

    def is_healed(self, robot: Robot, bus: str) -> bool:
        fault = robot.fault(self.code, self.path(bus))
        return fault is not None and fault.status == "healed"


def virtual(config: Path, *arguments: str) -> None:
    done = wackel("virtual", *arguments, "--config", config)
    assert done.returncode == 0, done.stdout + done.stderr


AT_ONCE = [
    Case("slow", 4, "slow_servo", "servo/4"),
    Case("break", 4, "cable_break", "cable/3-4"),
    Case("silent", 3, "servo_silent", "servo/3"),
    Case("duplicate_id", 3, "duplicate_id", "servo/3"),
    Case("rhythmic_jammer", None, "rhythmic_jammer"),
    Case("permanent_jammer", None, "permanent_jammer"),
    Case("undervoltage", 2, "undervoltage", "servo/2", reboot=True),
    Case("contact_resistance", 4, "contact_resistance", "cable/3-4"),
    Case("overload", 6, "overload", "servo/6", reboot=True),
    Case("hardware_error", 1, "overheating", "servo/1", reboot=True),
    Case("power_off", None, "lost_signal"),
    Case("unplugged", None, "adapter_unplugged", "adapter"),
    Case("latency_timer", None, "latency_timer", "adapter"),
]
IN_MOTION = Case("frozen", 2, "frozen_values", "servo/2")
OVER_TIME = [
    Case("loose_contact", 4, "loose_contact", "cable/3-4", value=10.0),
    Case("loose_contact_bursts", 3, "loose_contact", "cable/2-3", value=10.0),
    Case("noise", None, "noise", value=1e-4),
    Case("loss", 3, "packet_loss", "servo/3", value=0.2),
    Case("return_delay", 2, "return_delay", "servo/2"),
]


def test_no_kind_is_left_out() -> None:
    assert {case.kind for case in [*AT_ONCE, IN_MOTION, *OVER_TIME]} == set(KINDS)


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("robot")


@pytest.fixture(scope="module")
def robot(directory: Path) -> Iterator[Robot]:
    with robots.running(robots.chain(directory, SERVOS), directory) as running:
        running.wait(running.ready, LIMIT_S)
        yield running


@pytest.fixture
def repaired(robot: Robot, directory: Path) -> Iterator[None]:
    """Whatever a test has found, the next one begins with a sound robot."""
    yield
    virtual(directory / "robot.toml", "heal")


@pytest.mark.parametrize("case", AT_ONCE, ids=str)
def test_a_fault_is_named_in_its_place_and_healed_after_the_repair(
    robot: Robot, repaired: None, directory: Path, case: Case
) -> None:
    config = directory / "robot.toml"
    case.inject(config, "main")
    robot.wait(lambda: case.is_confirmed(robot, "main"), LIMIT_S)
    fault = robot.fault(case.code, case.path("main"))
    assert fault is not None
    assert fault.message
    assert fault.remedy
    assert fault.evidence is not None
    assert fault.evidence.summary

    case.heal(config, "main")
    if case.reboot:
        request = BusRequest(operation="reboot", id=case.place)
        assert robot.link.ask(keys.BUS_REQUEST, request, bus="main", timeout_s=10.0).ok
    robot.wait(lambda: case.is_healed(robot, "main"), LIMIT_S)


def test_values_that_freeze_while_the_servos_are_moved_are_named_and_healed(
    robot: Robot, repaired: None, directory: Path
) -> None:
    publisher = robot.link.publisher(keys.COMMAND, bus="main")
    steps = itertools.count()

    def swing() -> None:
        angle = math.sin(0.2 * next(steps))
        goals = [
            ServoGoal(id=servo, position=angle, torque_enabled=True)
            for servo in range(1, SERVOS + 1)
        ]
        publisher.put(BusCommand(stamp=robot.link.clock.now_ns(), goals=goals))
        robot.link.pump(0.03)

    moved: list[float] = []
    robot.link.subscribe(
        keys.STATE, lambda _, state: moved.extend(s.position for s in state.servos if s.position)
    )
    for _ in range(40):  # who has followed only a few goals may have no torque
        swing()
    wait_until(lambda: bool(moved) and max(moved) - min(moved) > 0.5, LIMIT_S, swing)
    IN_MOTION.inject(directory / "robot.toml", "main")
    wait_until(lambda: IN_MOTION.is_confirmed(robot, "main"), LIMIT_S, swing)
    IN_MOTION.heal(directory / "robot.toml", "main")
    wait_until(lambda: IN_MOTION.is_healed(robot, "main"), LIMIT_S, swing)


def test_an_adapter_that_stalls_is_named_and_no_cable(tmp_path: Path) -> None:
    """The process of the virtual bus stands still: to others that is an adapter that does.

    On a robot of its own: one whose supply was off a moment ago has half a loose contact already.
    """
    with robots.running(robots.chain(tmp_path, SERVOS), tmp_path) as robot:
        robot.wait(robot.ready, LIMIT_S)
        pid, random = robot.pids()["virtual/main"], Random("stalls")

        def stall() -> None:
            os.kill(pid, signal.SIGSTOP)
            robot.listen(0.03)  # so long nothing answers: what is tested, not a wait
            os.kill(pid, signal.SIGCONT)
            robot.listen(random.uniform(0.3, 0.35))  # not in step with the cycle

        lag = Case("", None, "adapter_lag", "adapter")
        wait_until(lambda: lag.is_confirmed(robot, "main"), LIMIT_S, stall)
        for _ in range(10):
            stall()
        faults = [fault for heard in robot.heard for fault in heard.health.faults]
        assert [fault for fault in faults if fault.code == "loose_contact"] == []
        robot.wait(lambda: lag.is_healed(robot, "main"), LIMIT_S)


def test_faults_of_several_buses_at_once_are_named_each_on_its_own(tmp_path: Path) -> None:
    cases = {case.kind: case for case in OVER_TIME}
    config = robots.chain(tmp_path, 4, rate=50.0)
    buses = {
        name: msgspec.structs.replace(config.buses["main"], port=str(tmp_path / name))
        for name in (*cases, "healthy")
    }
    config = msgspec.structs.replace(config, buses=buses)
    with robots.running(config, tmp_path) as robot:
        robot.wait(robot.ready, LIMIT_S)
        for bus, case in cases.items():
            case.inject(tmp_path / "robot.toml", bus)
        missing = dict(cases)

        def all_named() -> bool:
            for bus in [bus for bus, case in missing.items() if case.is_confirmed(robot, bus)]:
                del missing[bus]
            return not missing

        robot.wait(all_named, 2 * LIMIT_S)
        blamed = [f for f in robot.health.faults if f.component.startswith("bus/healthy")]
        assert [f for f in blamed if f.severity == "fault" and f.status == "confirmed"] == []
        virtual(tmp_path / "robot.toml", "heal")
        # By itself the gateway reads this register twice a minute.
        look = BusRequest(operation="read", id=2, register="return_delay_time")
        assert robot.link.ask(keys.BUS_REQUEST, look, bus="return_delay", timeout_s=10.0).ok
        # Contact lost in bursts is believed sound after half a minute; test_one_cable waits for it.
        del cases["loose_contact_bursts"]
        robot.wait(
            lambda: all(case.is_healed(robot, bus) for bus, case in cases.items()), 2 * LIMIT_S
        )
