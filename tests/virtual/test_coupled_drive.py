"""Servos on the virtual bus that turn wheels: what happens to the one happens to the other."""

import math
from collections.abc import Iterable
from itertools import pairwise

import pytest

from tests.odometry.simulation import steered_drive
from tests.virtual.material import MS, statuses
from wackel_node.config import BusConfig, ServoConfig
from wackel_node.config_drive import GyroConfig, GyroRegister
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.control_table import model
from wackel_schemas.virtual import Injection
from wackel_virtual.board import boards
from wackel_virtual.bus import VirtualBus
from wackel_virtual.coupled_drive import CoupledDrive, Sample

MODEL = model("XM430-W210")
DRIVES, STEERINGS = (0, 1, 2), (100, 101, 102)
CHAIN = (0, 100, 1, 101, 2, 102)
GYROS = {
    "body": GyroConfig(),
    "board": GyroConfig(source="bus", bus="main", id=200, registers={"z": GyroRegister(address=0)}),
}
RADIUS = 0.05


class Robot:
    """Its host: writes and reads registers, in virtual time."""

    def __init__(self, seed: int = 1) -> None:
        config = BusConfig(
            port="unused", return_delay_us=0, servos=[ServoConfig(id=i) for i in CHAIN]
        )
        self.bus = VirtualBus(config, seed, boards=boards(GYROS, "main"))
        self.drive = CoupledDrive(steered_drive(3), GYROS, {"main": self.bus}, seed)
        self.samples: list[Sample] = []
        self.now_ns = 0

    def write(self, name: str, values: dict[int, float]) -> None:
        register = MODEL.registers[name]
        data = {i: register.encode(register.from_si(value)) for i, value in values.items()}
        self.bus.exchange(
            self.now_ns, packet.sync_write(register.address, register.length, data), MS
        )
        self.now_ns += MS

    def read(self, name: str, ids: Iterable[int] = DRIVES) -> list[float | None]:
        """In SI units; None for one that does not answer."""
        register = MODEL.registers[name]
        request = packet.sync_read(list(ids), register.address, register.length)
        answers = {
            status.id: status.parameters
            for status in statuses(self.bus.exchange(self.now_ns, request, 8 * MS))
        }
        self.now_ns += 8 * MS
        return [register.to_si(register.decode(answers[i])) if i in answers else None for i in ids]

    def pass_(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)
        self.bus.advance(self.now_ns)
        self.drive.advance(self.now_ns)
        self.samples += self.drive.samples(self.now_ns)

    def go(self, rate: float = 4.0) -> None:
        """Straight on, rad/s."""
        self.write("torque_enable", dict.fromkeys(CHAIN, 1))
        self.write("goal_position", dict.fromkeys(STEERINGS, 0.0))
        self.write("goal_velocity", dict.fromkeys(DRIVES, rate))


def test_goals_of_servos_move_the_robot_and_registers_show_it() -> None:
    robot = Robot()
    robot.go()
    robot.pass_(1.0)
    start = float(robot.drive.drivetrain.body.pose[0])
    before = robot.read("present_position")
    robot.pass_(1.0)
    way = float(robot.drive.drivetrain.body.pose[0]) - start
    turned = [after - b for after, b in zip(robot.read("present_position"), before, strict=True)]  # type: ignore[operator]
    assert way == pytest.approx(4.0 * RADIUS * 1.008, rel=0.02)
    assert turned == pytest.approx([4.0 * 1.008] * 3, rel=0.02)
    assert robot.read("present_velocity") == pytest.approx([4.0] * 3, abs=0.1)


def test_steering_goals_turn_the_wheels() -> None:
    robot = Robot()
    robot.go()
    robot.write("goal_position", dict.fromkeys(STEERINGS, 0.5))
    robot.pass_(1.0)
    assert robot.read("present_position", STEERINGS) == pytest.approx([0.5] * 3, abs=0.005)
    vx, vy, _ = robot.drive.drivetrain.body.twist
    assert math.atan2(vy, vx) == pytest.approx(0.5, abs=0.03)


def test_between_steps_a_wheel_goes_on_and_never_back() -> None:
    robot = Robot()
    robot.go()
    positions = [robot.read("present_position")[0] for _ in range(200)]
    steps = [b - a for a, b in pairwise(positions)]  # type: ignore[operator]
    assert min(steps) >= 0.0
    assert steps[-1] == pytest.approx(4.0 * 0.008, abs=0.004)


def test_gyros_measure_their_own_time_and_boards_show_theirs() -> None:
    robot = Robot()
    robot.go()
    robot.write("goal_velocity", {0: 4.0, 1: 4.0, 2: 2.0})
    robot.pass_(1.0)
    assert {sample.name for sample in robot.samples} == {"body"}
    at = [sample.at_ns for sample in robot.samples]
    assert [b - a for a, b in pairwise(at)] == [10 * MS] * (len(at) - 1)
    omega = float(robot.drive.drivetrain.body.twist[2])
    assert omega != pytest.approx(0.0, abs=0.01)
    for shown in (robot.samples[-1].rates[2], robot.bus.boards[200].rates["board"][2]):
        assert shown == pytest.approx(omega, abs=0.04)  # bias and noise


def test_a_drive_that_is_ahead_shows_the_time_that_is_asked_for() -> None:
    behind, ahead = Robot(), Robot()
    for robot in (behind, ahead):
        robot.go()
        robot.pass_(0.5)
    ahead.drive.advance(ahead.now_ns + 12 * MS)
    assert ahead.drive.drivetrain.rolled[0] > behind.drive.drivetrain.rolled[0]
    assert ahead.read("present_position") == behind.read("present_position")
    assert ahead.read("present_velocity") == behind.read("present_velocity")


def test_a_sample_is_there_when_its_time_is_over() -> None:
    robot = Robot()
    robot.drive.advance(50 * MS)
    assert [sample.end_ns for sample in robot.drive.samples(25 * MS)] == [10 * MS, 20 * MS]
    assert robot.drive.sample_ns() == 30 * MS
    assert [sample.at_ns for sample in robot.drive.samples(35 * MS)] == [25 * MS]
    assert len(robot.drive.samples(50 * MS)) == 2
    assert robot.drive.sample_ns() is None
    assert robot.drive.move_ns() == 55 * MS


def test_a_broken_cable_takes_the_power_of_wheels_behind_it() -> None:
    robot = Robot()
    robot.go()
    robot.pass_(1.0)
    robot.bus.inject(Injection(kind="break", servo=101))
    robot.pass_(0.5)
    robot.write("goal_velocity", dict.fromkeys(DRIVES, -2.0))
    robot.write("goal_position", dict.fromkeys(STEERINGS, 0.3))
    robot.pass_(1.0)
    # Servos 0 and 1 drive on; 2 and its steering have no power, the steering of 1 neither.
    assert robot.read("present_velocity")[:2] == pytest.approx([-2.0, -2.0], abs=0.3)
    assert robot.read("present_velocity")[2] is None
    drivetrain = robot.drive.drivetrain
    assert drivetrain.steered == pytest.approx([0.3, 0.0, 0.0], abs=0.01)
    assert drivetrain.current[2] == 0.0
    assert drivetrain.rate[2] < -1.0  # dragged along


def test_after_a_break_servos_have_no_torque_until_they_are_told() -> None:
    robot = Robot()
    robot.go()
    robot.pass_(1.0)
    robot.bus.inject(Injection(kind="break", servo=2, duration_s=0.5))
    robot.pass_(1.5)
    assert robot.read("torque_enable") == [1, 1, 0]
    assert robot.drive.drivetrain.current[2] == 0.0
    robot.go(6.0)
    robot.pass_(0.05)
    assert robot.drive.drivetrain.current[2] > 0.05


def test_a_blocked_wheel_shows_in_its_registers() -> None:
    robot = Robot()
    robot.go()
    robot.pass_(1.0)
    robot.drive.inject(Injection(kind="wheel_blocked", wheel="w1"))
    robot.pass_(1.0)
    rates = robot.read("present_velocity")
    assert rates[1] == 0.0
    assert rates[0] is not None and rates[0] > 2.0
    currents = robot.read("present_current")
    assert currents[1] is not None and currents[1] > 1.0
    assert [fault.wheel for fault in robot.drive.active()] == ["w1"]
    robot.drive.heal()
    robot.pass_(1.0)
    assert robot.read("present_velocity") == pytest.approx([4.0] * 3, abs=0.1)


def test_a_motor_that_is_off_stays_off_until_it_is_healed_and_switched_on() -> None:
    robot = Robot()
    robot.go()
    robot.drive.inject(Injection(kind="wheel_free", wheel="w0"))
    robot.pass_(0.5)
    assert robot.read("torque_enable") == [0, 1, 1]
    robot.go()
    assert robot.read("torque_enable") == [0, 1, 1]
    robot.drive.heal("wheel_free", "w0")
    robot.pass_(0.1)
    assert robot.read("torque_enable") == [0, 1, 1]
    robot.go()
    assert robot.read("torque_enable") == [1, 1, 1]


def test_a_wrong_sensor_shows_in_the_registers() -> None:
    robot = Robot()
    robot.go()
    robot.drive.inject(Injection(kind="steering_sensor_stuck", wheel="w2", value=0.25))
    robot.drive.inject(Injection(kind="drive_sensor_stuck", wheel="w1", value=1.0))
    robot.pass_(0.5)
    assert robot.read("present_position", STEERINGS)[2] == pytest.approx(0.25, abs=0.002)
    assert robot.read("present_velocity")[1] == pytest.approx(1.0, abs=0.02)


def test_an_overload_lets_the_wheel_roll() -> None:
    robot = Robot()
    robot.go()
    robot.pass_(1.0)
    robot.bus.inject(Injection(kind="overload", servo=1))
    robot.pass_(0.5)
    assert robot.drive.drivetrain.current[1] == 0.0
    assert robot.read("present_velocity")[1] == pytest.approx(4.0, abs=0.3)


def test_a_reboot_forgets_whole_turns_only() -> None:
    robot = Robot()
    robot.go()
    robot.pass_(4.0)
    before = robot.read("present_position")[0]
    assert before is not None and before > 10.0
    robot.write("goal_velocity", dict.fromkeys(DRIVES, 0.0))
    robot.pass_(1.0)
    stopped = robot.read("present_position")[0]
    assert stopped is not None
    robot.bus.exchange(robot.now_ns, packet.reboot(0), 500 * MS)
    robot.now_ns += 500 * MS
    after = robot.read("present_position")[0]
    assert after is not None and abs(after) <= math.pi
    assert math.remainder(after - stopped, math.tau) == pytest.approx(0.0, abs=0.01)


def test_the_same_seed_gives_the_same_run() -> None:
    def run(seed: int) -> list[object]:
        robot = Robot(seed)
        robot.go()
        robot.pass_(0.5)
        return [robot.read("present_position"), robot.read("present_current"), robot.samples]

    assert run(3) == run(3)
    assert run(3) != run(4)
