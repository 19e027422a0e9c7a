"""Before a robot is driven, its servos have to be able to drive it."""

import pytest

from tests.odometry.simulation import BUS, differential_drive
from wackel_drive.layout import Layout, Servo
from wackel_node.config import BusConfig, ConfigError, RobotConfig, ServoConfig
from wackel_node.session import NotReached
from wackel_pilot.wheel_mode import commanded_buses, prepared
from wackel_schemas.bus import BusReply, BusRequest

DRIVE = differential_drive()
LEFT, RIGHT = Servo(BUS, 1), Servo(BUS, 2)


def robot(model: str = "XM430-W210", **settings: str) -> RobotConfig:
    servos = [ServoConfig(id=i, model=model) for i in (1, 2)]
    bus = BusConfig(port="p", servos=servos, **settings)  # type: ignore[arg-type]
    return RobotConfig(buses={BUS: bus}, drive=DRIVE)


class Gateway:
    """Answers from its registers; a servo that is not there, or a register, is refused."""

    def __init__(self, **registers: int) -> None:
        self.registers = {servo: dict(registers) for servo in (LEFT, RIGHT)}
        self.written: list[tuple[int, str | None, int | None]] = []

    def ask(self, servo: Servo, request: BusRequest) -> BusReply:
        registers = self.registers.get(servo, {})
        if request.register not in registers:
            return BusReply(stamp=0, ok=False, text="no answer")
        if request.operation == "write":
            self.written.append((servo.id, request.register, request.value))
            return BusReply(stamp=0, ok=True, text="")
        return BusReply(stamp=0, ok=True, text="", value=registers[request.register])


def test_servos_in_position_mode_are_put_into_wheel_mode_with_their_torque_off() -> None:
    gateway = Gateway(operating_mode=3, torque_enable=1, velocity_limit=330)
    prepared(robot(), Layout(DRIVE), gateway.ask)
    assert gateway.written == [
        (servo, *each) for servo in (1, 2) for each in (("torque_enable", 0), ("operating_mode", 1))
    ]


def test_servos_that_drive_already_are_left_as_they_are() -> None:
    gateway = Gateway(operating_mode=1, velocity_limit=330)
    assert prepared(robot(), Layout(DRIVE), gateway.ask)[LEFT] == pytest.approx(7.91, abs=0.01)
    assert gateway.written == []


def test_a_model_may_be_named_by_its_series() -> None:
    gateway = Gateway(operating_mode=1, velocity_limit=330)
    limits = prepared(robot("X"), Layout(DRIVE), gateway.ask)
    assert limits == prepared(robot(), Layout(DRIVE), gateway.ask)


def test_a_model_without_a_velocity_limit_is_not_asked_for_it() -> None:
    assert prepared(robot("XL320"), Layout(DRIVE), Gateway(operating_mode=1).ask) == {}


@pytest.mark.parametrize("registers", [{}, {"operating_mode": 1}, {"operating_mode": 3}])
def test_a_servo_that_does_not_do_as_asked_is_named(registers: dict[str, int]) -> None:
    gateway = Gateway(operating_mode=1, velocity_limit=330)
    gateway.registers[RIGHT] = registers
    with pytest.raises(NotReached, match=r"servo 2 on bus main cannot .* no answer"):
        prepared(robot(), Layout(DRIVE), gateway.ask)


def test_a_bus_that_wackel_does_not_command_is_named_with_its_mode() -> None:
    assert commanded_buses(robot(), DRIVE) == [BUS]
    for mode in ("tap", "proxy"):
        with pytest.raises(ConfigError, match=f"buses.main.mode = '{mode}'.*'poll'"):
            commanded_buses(robot(mode=mode, proxy_port="q"), DRIVE)
