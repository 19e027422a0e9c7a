"""Wires topics to the core."""

import time
from collections.abc import Iterable

from wackel_node.config import RobotConfig
from wackel_node.config_drive import DriveConfig
from wackel_node.fault_publisher import FaultPublisher
from wackel_node.node import Node
from wackel_odometry.core import Odometer
from wackel_schemas import keys
from wackel_schemas.bus import BusState, BusStatistics
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
        lead_ns = node.clock.stamp_ns(0)  # of the messages' time over the monotonic clock

        def publish(messages: Iterable[Message]) -> None:
            for message in messages:
                if isinstance(message, Odometry):
                    odometry.put(message)
                elif isinstance(message, FaultReport):
                    faults.put(message)

        def on_state(key: str, state: BusState) -> None:
            nonlocal lead_ns
            lead_ns = state.stamp - node.arrived_ns
            publish(core.bus_state(keys.chunk_of(keys.STATE, key, "bus"), state))

        def on_statistics(key: str, statistics: BusStatistics) -> None:
            publish(core.bus_statistics(keys.chunk_of(keys.STATISTICS, key, "bus"), statistics))

        def on_imu(key: str, sample: ImuSample) -> None:
            publish(core.imu(keys.chunk_of(keys.IMU, key, "name"), sample))

        def on_exclusions(_: str, message: Exclusions) -> None:
            core.exclusions(message)

        def on_request(request: OdometryRequest) -> OdometryReply:
            now = lead_ns + time.monotonic_ns()
            reply = core.request(request, node.clock.now_ns(), now)
            if reply.ok and request.operation != "get":
                # A recorder hears no queries: for it, and a replay, this one becomes an input.
                message = PoseSet(stamp=reply.stamp, request=request)
                poses_set.put(message)
                node.taken(keys.POSE_SET.key(), message)
            return reply

        for bus in sorted({bus for wheel in drive.wheels for bus, _ in wheel.servos()}):
            node.subscribe(keys.STATE, on_state, bus=bus)
            node.subscribe(keys.STATISTICS, on_statistics, bus=bus)
        for name in config.gyros:
            node.subscribe(keys.IMU, on_imu, name=name)
        node.subscribe(keys.EXCLUSIONS, on_exclusions)
        node.serve(keys.ODOMETRY_REQUEST, on_request)
        node.ready()
        node.run()
