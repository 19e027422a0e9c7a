"""Publishes commands at a steady rate until a signal ends it, then stops the wheels."""

import signal
import time
from functools import partial

from wackel_drive.layout import Layout, Servo
from wackel_node.config import RobotConfig
from wackel_node.config_drive import DriveConfig
from wackel_node.errors import AlreadyRunning
from wackel_node.link import Link
from wackel_node.node import Node
from wackel_node.session import NotReached
from wackel_pilot.control import Control
from wackel_pilot.hearing import LOOK_S, Hearing
from wackel_pilot.path import Path
from wackel_pilot.wheel_mode import commanded_buses, prepared
from wackel_schemas import keys
from wackel_schemas.bus import BusCommand, BusReply, BusRequest, BusState, ServoGoal
from wackel_schemas.drive import TwistCommand
from wackel_schemas.keys import BUS_REQUEST

RATE_HZ = 100.0
COMMAND_TIMEOUT_S = 1.0
"""Then the gateway stops the wheels: only if the pilot was killed is it silent for so long."""
TORQUE_S = 1.0
"""How often torque is asked for: a servo that has restarted then drives on."""
STOPPING_S = 0.2
"""For so long the wheels are told to stand: a command may be lost."""
REQUEST_S = 5.0
_RETRY_S = 0.1


def run(config: RobotConfig, drive: DriveConfig, path: Path, duration_s: float | None) -> None:
    """Drives along a path.

    Args:
        config: The robot.
        drive: Its drive.
        path: The way.
        duration_s: For so long; absent: until a signal comes.

    Raises:
        ConfigError: A bus that moves wheels takes no commands.
        NotReached: No gateway answers, or a servo that drives does not; or the robot has fallen
            silent. It must not drive on by itself when it is back.
        AlreadyRunning: Another pilot drives it.
    """
    buses = commanded_buses(config, drive)
    with Link(config) as link:
        if "pilot/main" in link.alive():
            raise AlreadyRunning(f"a pilot drives robot {config.robot} already; stop it first")
    with Node("pilot", "main", config) as node:
        # Suspended, it would leave the robot driving: servos go on as they were last told.
        signal.signal(signal.SIGTSTP, lambda *_: node.stop())
        layout = Layout(drive)
        control = Control(drive, prepared(config, layout, partial(_ask, node)))
        twists = node.publisher(keys.TWIST_COMMAND)
        commands = {bus: node.publisher(keys.COMMAND, bus=bus) for bus in buses}
        hearing = Hearing({bus: config.buses[bus].rate for bus in buses})
        silent: list[str] = []
        start_s = torque_s = time.monotonic()

        def command() -> None:
            nonlocal torque_s
            now_s = time.monotonic()
            passed_s = now_s - start_s
            if duration_s is not None and passed_s >= duration_s:
                node.stop()
                return
            torque = now_s >= torque_s
            if torque:
                torque_s = now_s + TORQUE_S
            send(*control.step(path(passed_s)), torque=torque)

        def send(
            twist: tuple[float, float, float],
            goals: dict[str, list[ServoGoal]],
            *,
            torque: bool,
        ) -> None:
            stamp = node.clock.now_ns()
            vx, vy, omega = twist
            twists.put(TwistCommand(stamp=stamp, vx=vx, vy=vy, omega=omega))
            for bus, each in goals.items():
                if torque:
                    for goal in each:
                        goal.torque_enabled = True
                commands[bus].put(BusCommand(stamp=stamp, goals=each, timeout_s=COMMAND_TIMEOUT_S))

        def look() -> None:
            silent[:] = hearing.look()
            if silent:
                node.stop()

        def hear(key: str, _: BusState) -> None:
            hearing.heard(keys.chunk_of(keys.STATE, key, "bus"))

        for bus in buses:
            node.subscribe(keys.STATE, hear, bus=bus)
        node.await_links()
        node.every(LOOK_S, look)
        node.every(1.0 / RATE_HZ, command)
        node.ready()
        try:
            node.run()
        finally:
            # At the same rate as before: a command that is lost on its way is made up for.
            for _ in range(round(STOPPING_S * RATE_HZ)):
                send(*control.step((0.0, 0.0, 0.0)), torque=False)
                time.sleep(1.0 / RATE_HZ)
    if silent:
        raise NotReached(
            f"nothing has come from bus {', '.join(silent)} for a while, so the pilot ends: see "
            "`wackel health`, or start the robot with `wackel up`"
        )


def _ask(node: Node, servo: Servo, request: BusRequest) -> BusReply:
    """The answer of a gateway; one that this process is not linked with yet is waited for, and
    what did not succeed is tried again: an answer may get lost on the wire."""
    limit_s = time.monotonic() + REQUEST_S

    def over() -> bool:
        return node.stopping or time.monotonic() > limit_s

    while True:
        try:
            reply = node.ask(BUS_REQUEST, request, timeout_s=REQUEST_S, bus=servo.bus)
        except TimeoutError as error:
            if over():
                raise node.unanswered(f"gateway of bus {servo.bus}") from error
        else:
            if reply.ok or over():
                return reply
        node.pump(_RETRY_S)
