"""Servos that are ready to drive: which requests that takes, and what the answers mean. Pure."""

from collections.abc import Callable

from wackel_drive.layout import Layout, Servo
from wackel_node.config import ConfigError, RobotConfig
from wackel_node.config_drive import DriveConfig
from wackel_node.session import NotReached
from wackel_protocols.dynamixel2.control_table import configured
from wackel_schemas.bus import BusReply, BusRequest

Ask = Callable[[Servo, BusRequest], BusReply]

_WHEEL_MODE = 1
"""Operating Mode: velocity control (e-manual, X series)."""


def commanded_buses(config: RobotConfig, drive: DriveConfig) -> list[str]:
    """The buses whose servos move the wheels.

    Raises:
        ConfigError: One of them takes no commands.
    """
    buses = sorted({bus for wheel in drive.wheels for bus, _ in wheel.servos()})
    for bus in buses:
        mode = config.buses[bus].mode
        if mode != "poll":
            raise ConfigError(
                f"buses.{bus}.mode = {mode!r}: wheels can be driven in mode 'poll' only; in the "
                "others wackel commands no servo"
            )
    return buses


def prepared(config: RobotConfig, layout: Layout, ask: Ask) -> dict[Servo, float]:
    """Puts the driving servos into wheel mode.

    Returns:
        Their greatest velocities, rad/s, as far as their models have such a limit.

    Raises:
        NotReached: A servo did not do what it was asked for.
    """

    def done(servo: Servo, request: BusRequest) -> int | None:
        reply = ask(servo, request)
        if not reply.ok:
            raise NotReached(
                f"servo {servo.id} on bus {servo.bus} cannot be made to drive: {request.operation} "
                f"{request.register}: {reply.text}; see `wackel health`"
            )
        return reply.value

    def read(servo: Servo, register: str) -> int | None:
        return done(servo, BusRequest(operation="read", id=servo.id, register=register))

    def write(servo: Servo, register: str, value: int) -> None:
        done(servo, BusRequest(operation="write", id=servo.id, register=register, value=value))

    limits = {}
    for joint in layout.rolling:
        if joint is None:
            continue
        servo = joint.servo
        if read(servo, "operating_mode") != _WHEEL_MODE:
            write(servo, "torque_enable", 0)
            write(servo, "operating_mode", _WHEEL_MODE)
        for each in config.buses[servo.bus].servos:
            limit = configured(each.model).registers.get("velocity_limit")
            if each.id == servo.id and limit is not None:
                raw = read(servo, limit.name)
                if raw:
                    limits[servo] = limit.to_si(raw)
    return limits
