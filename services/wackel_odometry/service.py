"""Wires topics to the core."""

from collections.abc import Iterable

from wackel_node.config import RobotConfig
from wackel_node.config_drive import DriveConfig
from wackel_node.fault_publisher import FaultPublisher
from wackel_node.node import Node
from wackel_odometry.core import Odometer
from wackel_schemas import keys
from wackel_schemas.bus import BusState
from wackel_schemas.drive import (
    Exclusions,
    ImuSample,
    Odometry,
    OdometryReply,
    OdometryRequest,
    PoseSet,
)
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message


def run(config: RobotConfig, drive: DriveConfig) -> None:
    """Runs the service until a signal ends it."""
    with Node("odometry", "main", config) as node:
        core = Odometer(drive, config.gyros)
        node.keep_journal()
        odometry = node.publisher(keys.ODOMETRY)
        poses_set = node.publisher(keys.POSE_SET)
        faults = FaultPublisher(node, "odometry", core.active)

        def publish(messages: Iterable[Message]) -> None:
            for message in messages:
                if isinstance(message, Odometry):
                    odometry.put(message)
                elif isinstance(message, FaultReport):
                    faults.put(message)

        def on_state(key: str, state: BusState) -> None:
            publish(core.bus_state(keys.chunk_of(keys.STATE, key, "bus"), state))

        def on_imu(key: str, sample: ImuSample) -> None:
            publish(core.imu(keys.chunk_of(keys.IMU, key, "name"), sample))

        def on_exclusions(_: str, message: Exclusions) -> None:
            core.exclusions(message)

        def on_request(request: OdometryRequest) -> OdometryReply:
            reply = core.request(request, node.clock.now_ns())
            if reply.ok and request.operation != "get":
                # A recorder hears no queries: for it, and a replay, this one becomes an input.
                message = PoseSet(stamp=reply.stamp, request=request)
                poses_set.put(message)
                node.taken(keys.POSE_SET.key(), message)
            return reply

        for bus in sorted({bus for wheel in drive.wheels for bus, _ in wheel.servos()}):
            node.subscribe(keys.STATE, on_state, bus=bus)
        for name in config.gyros:
            node.subscribe(keys.IMU, on_imu, name=name)
        node.subscribe(keys.EXCLUSIONS, on_exclusions)
        node.serve(keys.ODOMETRY_REQUEST, on_request)
        node.ready()
        node.run()
