"""Wires topics to the core."""

from wackel_diagnoser.core import Diagnoser
from wackel_node.config import RobotConfig
from wackel_node.config_drive import DriveConfig
from wackel_node.fault_publisher import FaultPublisher
from wackel_node.node import Node
from wackel_schemas import keys
from wackel_schemas.bus import BusState
from wackel_schemas.drive import Exclusions, ImuSample, TwistCommand
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message
from wackel_schemas.residuals import Residuals


def run(config: RobotConfig, drive: DriveConfig) -> None:
    """Runs the service until a signal ends it."""
    with Node("diagnoser", "main", config) as node:
        residuals = node.publisher(keys.RESIDUALS)
        core = Diagnoser(drive, config.gyros, lambda: residuals.has_reader)
        node.keep_journal()
        exclusions = node.publisher(keys.EXCLUSIONS)
        faults = FaultPublisher(node, "diagnoser", core.active)

        def publish(messages: list[Message]) -> None:
            # Exclusions first, and before the journal that comes with a fault: odometry obeys at
            # once, and a replay knows that they were said when it comes to what led to them.
            for message in messages:
                if isinstance(message, Exclusions):
                    exclusions.put(message)
            for message in messages:
                if isinstance(message, Residuals):
                    residuals.put(message)
                elif isinstance(message, FaultReport):
                    faults.put(message)

        def on_state(key: str, state: BusState) -> None:
            publish(core.bus_state(keys.chunk_of(keys.STATE, key, "bus"), state))

        def on_imu(key: str, sample: ImuSample) -> None:
            publish(core.imu(keys.chunk_of(keys.IMU, key, "name"), sample))

        def on_command(_: str, message: TwistCommand) -> None:
            core.command(message)

        for bus in sorted({bus for wheel in drive.wheels for bus, _ in wheel.servos()}):
            node.subscribe(keys.STATE, on_state, bus=bus)
        for name in config.gyros:
            node.subscribe(keys.IMU, on_imu, name=name)
        node.subscribe(keys.TWIST_COMMAND, on_command)
        node.ready()
        node.run()
