"""The virtual robot as a process: ports, and faults on request."""

import signal
import threading
from collections.abc import Mapping
from pathlib import Path

import msgspec

from wackel_node.config import RobotConfig
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_schemas import keys
from wackel_schemas.virtual import Injection, VirtualReply, VirtualRequest
from wackel_virtual.bus import VirtualBus
from wackel_virtual.faults import InjectionError
from wackel_virtual.port import Ports
from wackel_virtual.scenario import Scenario, bus_of


def run(scenario: Scenario) -> None:
    """Runs the virtual robot, and answers requests over Zenoh, until a signal ends it.

    Raises:
        ConfigError: A port cannot be made, or a model is not known.
    """
    with Node("virtual", "main", scenario.config) as node, _ports(scenario) as ports:

        def on_request(request: VirtualRequest) -> VirtualReply:
            reply = ports.call(lambda buses: obey(request, buses, scenario.config))
            reply.stamp = node.clock.now_ns()
            logger.info("%s", reply.text)
            return reply

        node.serve(keys.VIRTUAL_REQUEST, on_request)
        node.ready()
        node.run()


def run_alone(scenario: Scenario) -> None:
    """As :func:`run`, without Zenoh: for other software that wants a Dynamixel bus.

    Raises:
        ConfigError: As :func:`run`.
    """
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    with _ports(scenario):
        logger.info("ready")
        stopped.wait()


def obey(
    request: VirtualRequest, buses: Mapping[str, VirtualBus], config: RobotConfig
) -> VirtualReply:
    """Inject, heal or list; what cannot be done is refused with a reason."""
    injection = request.injection
    try:
        match request.operation:
            case "inject":
                if injection is None:
                    raise InjectionError("inject needs an injection")
                name = bus_of(injection, config)
                done = msgspec.structs.replace(buses[name].inject(injection), bus=name)
                text = f"injected {in_words(done)}"
            case "heal":
                wanted = injection or Injection(kind="")
                names = [bus_of(wanted, config)] if wanted.bus else list(buses)
                healed = [
                    in_words(msgspec.structs.replace(fault, bus=name))
                    for name in names
                    for fault in buses[name].heal(wanted.kind, wanted.servo)
                ]
                text = f"healed {'; '.join(healed)}" if healed else "nothing to heal"
            case "list":
                count = len(_active(buses))
                text = f"{count} fault{'' if count == 1 else 's'} active"
    except InjectionError as error:
        return VirtualReply(stamp=0, ok=False, text=str(error), active=_active(buses))
    return VirtualReply(stamp=0, ok=True, text=text, active=_active(buses))


def in_words(injection: Injection) -> str:
    """One line: ``break at servo 5 on bus main, from 2 s on, for 10 s``."""
    words = injection.kind
    if injection.servo is not None:
        words += f" at servo {injection.servo}"
    if injection.bus:
        words += f" on bus {injection.bus}"
    if injection.value is not None:
        words += f", value {injection.value:g}"
    if injection.start_s:
        words += f", from {injection.start_s:g} s on"
    if injection.duration_s is not None:
        words += f", for {injection.duration_s:g} s"
    return words


def _active(buses: Mapping[str, VirtualBus]) -> list[Injection]:
    return [
        msgspec.structs.replace(injection, bus=name)
        for name, bus in buses.items()
        for injection in bus.active()
    ]


def _ports(scenario: Scenario) -> Ports:
    configs = scenario.config.buses
    ports = Ports(
        {name: (bus, Path(configs[name].port)) for name, bus in scenario.make().items()},
        {name: Path(port) for name, port in scenario.taps.items()},
    )
    for name, config in configs.items():
        logger.info(
            "bus %s: %d servos at %d bit/s on %s",
            name,
            len(config.servos),
            config.baud_rate,
            config.port,
        )
    for name, port in scenario.taps.items():
        logger.info("bus %s: tapped on %s", name, port)
    return ports
