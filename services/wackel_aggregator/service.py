"""Wires topics, clock and state file to the core."""

import os
from pathlib import Path
from time import monotonic

from wackel_aggregator.core import Aggregator
from wackel_aggregator.store import Store
from wackel_node.config import RobotConfig
from wackel_node.node import Node
from wackel_node.precedence import DIAGNOSIS, LOOK_S, GiveWay, come_first
from wackel_schemas import keys, wire
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import FaultRecord, HealthReply, HealthRequest, Heartbeat

# Added to the 1.25 s after which a heartbeat is late, a hung service shows within 1.5 s.
_LOOK_S = 0.25
_COMMIT_S = 1.0
# A broken cable is twenty reports within a millisecond, and each health tells all faults.
_BURST_S = 0.002


def needed_services(config: RobotConfig) -> list[str]:
    """The services without which nothing is known of the robot."""
    gateways = [f"gateway/{bus}" for bus in config.buses]
    gyros = [f"imu/{name}" for name, gyro in config.gyros.items() if gyro.source == "iio"]
    drive = ["odometry/main", "diagnoser/main"] if config.drive is not None else []
    return [*gateways, *gyros, "classifier/main", *drive] if gateways else []


def wanted_services(config: RobotConfig) -> list[str]:
    """The services that the configuration asks for and that tell nothing about the robot."""
    return ["recorder/main"] if config.recorder.directory else []


def state_directory(config: RobotConfig) -> Path:
    """Where the state file goes."""
    if config.state_directory:
        return Path(config.state_directory)
    home = os.environ.get("XDG_STATE_HOME")
    return (Path(home) if home else Path.home() / ".local/state") / "wackel"


def run(config: RobotConfig) -> None:
    """Runs the service until a signal ends it.

    Raises:
        Taken: Another aggregator of this robot is running.
    """
    come_first(DIAGNOSIS)
    with (
        Store(state_directory(config), config.robot) as store,
        Node("aggregator", "main", config) as node,
    ):
        clock = node.clock
        core = Aggregator(
            needed_services(config), store.load(), clock.instant(), wanted_services(config)
        )
        publisher = node.publisher(keys.HEALTH)
        # Most of a long memory is as it was when something is news.
        encoded = wire.EncodedOnce[FaultRecord]()

        def on_fault(key: str, report: FaultReport) -> None:
            core.report(report, keys.chunk_of(keys.FAULT, key, "source"), clock.instant())
            look()

        def on_heartbeat(key: str, beat: Heartbeat) -> None:
            core.heartbeat(key.removeprefix("alive/"), beat, clock.instant())
            look()

        def on_alive(name: str, alive: bool) -> None:
            core.alive(name, alive, clock.instant())
            look()

        def on_request(request: HealthRequest) -> HealthReply:
            reply = core.request(request, clock.instant())
            look()
            return reply

        looked_s, looks_soon = 0.0, False

        def look() -> None:
            """At once, but once at what comes in a burst."""
            nonlocal looks_soon
            if looks_soon:
                return
            left_s = looked_s + _BURST_S - monotonic()
            if left_s > 0:
                looks_soon = True
                node.soon(left_s, publish)
            else:
                publish()

        def publish() -> None:
            nonlocal looked_s, looks_soon
            looked_s, looks_soon = monotonic(), False
            health = core.tick(clock.instant())
            if health is None:
                return
            health.faults = encoded(health.faults)
            data = publisher.encode(health)
            if core.unsaved():
                store.prepare(data)
            publisher.send(data)

        node.watch_alive(on_alive)
        node.subscribe(keys.ALIVE, on_heartbeat)
        node.subscribe(keys.FAULT, on_fault)
        node.serve(keys.HEALTH_REQUEST, on_request)
        node.every(_COMMIT_S, store.commit)
        node.every(_LOOK_S, publish)
        node.every(LOOK_S, GiveWay())
        node.ready()
        node.run()
