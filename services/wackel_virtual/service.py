"""The virtual robot as a process: ports, and faults on request."""

import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from wackel_node.clock import Clock
from wackel_node.config import RobotConfig
from wackel_node.errors import NotWritable
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_node.precedence import CONTROL, LOOK_S, GiveWay, come_first
from wackel_node.stop_signals import stop_signals
from wackel_schemas import keys
from wackel_schemas.drive import ImuSample
from wackel_schemas.virtual import Injection, VirtualReply, VirtualRequest
from wackel_virtual.bus import VirtualBus
from wackel_virtual.drive_faults import DRIVE_KINDS
from wackel_virtual.faults import InjectionError
from wackel_virtual.port import Ports, claimed
from wackel_virtual.scenario import Scenario, bus_of

if TYPE_CHECKING:
    from wackel_virtual.body import InPlane
    from wackel_virtual.coupled_drive import CoupledDrive, Sample

_PORTS_ON = 10_000
"""Not the next port, which is another robot's."""
_LAST_PORT = 65_535
_LOOK_FOR_END_S = 0.5
_POSES_APART_NS = 10_000_000


@contextmanager
def true_path(path: Path | None, clock: Clock) -> "Iterator[Callable[[InPlane, int], None] | None]":
    """Writes where the robot is into a file, as ``wackel calibrate`` reads it.

    Yields:
        To be called with each pose and its time, ns of the monotonic clock; nothing without a path.

    Raises:
        NotWritable: The file is there already, or cannot be made.
    """
    if path is None:
        yield None
        return
    try:
        # No path is lost to the next one, nor the last lines of it to a kill -9.
        file = path.open("x", buffering=1, encoding="utf-8")
    except FileExistsError as error:
        raise NotWritable(f"{path} exists; name another file, or move it away first") from error
    except OSError as error:
        raise NotWritable(f"{path}: {error.strerror}") from error
    latest_ns = 0

    def write(pose: "InPlane", monotonic_ns: int) -> None:
        nonlocal latest_ns
        if monotonic_ns - latest_ns >= _POSES_APART_NS:
            latest_ns = monotonic_ns
            x, y, heading = pose
            time_s = clock.stamp_ns(monotonic_ns) / 1e9
            file.write(f"{time_s:.6f},{x:.6f},{y:.6f},{math.remainder(heading, math.tau):.6f}\n")

    with file:
        file.write("time,x,y,theta\n")
        yield write


def run(scenario: Scenario, path: Path | None = None) -> None:
    """Runs the virtual robot, and answers requests over Zenoh, until a signal ends it.

    Args:
        scenario: The robot.
        path: File for the true path.

    Raises:
        ConfigError: A port cannot be made.
        ImportError: MuJoCo is wanted and not installed.
        NotWritable: The file is there already, or cannot be made.
    """
    config = scenario.config
    come_first(CONTROL)  # servos answer at once, however busy the computer of their robot is
    # Claimed first: who is refused must not have announced itself in the name of the one that runs.
    with (
        _claimed(scenario),
        Node("virtual", "main", config, own_endpoint(config)) as node,
        true_path(path, node.clock) as on_pose,
    ):
        gyros = {
            name: node.publisher(keys.IMU, name=name)
            for name, gyro in config.gyros.items()
            if gyro.source == "topic"
        }

        def on_sample(sample: "Sample", monotonic_ns: int) -> None:
            # On the thread of the wire, and nothing else uses these publishers.
            stamp = node.clock.stamp_ns(monotonic_ns)
            gyros[sample.name].put(ImuSample(stamp=stamp, angular_velocity=sample.rates))

        buses = scenario.make()
        drive = scenario.make_drive(buses)
        node.await_links()
        with _ports(scenario, buses, drive, on_sample, on_pose) as ports:
            active: list[Injection] = []

            def on_request(request: VirtualRequest) -> VirtualReply:
                nonlocal active
                reply = ports.call(lambda buses: obey(request, buses, config, drive))
                reply.stamp = node.clock.now_ns()
                logger.info("%s", reply.text)
                active = reply.active
                return reply

            def tell_ended() -> None:
                nonlocal active
                before, active = active, ports.call(lambda buses: _active(buses, drive))
                for fault in before:
                    if fault not in active:
                        logger.info("over: %s", in_words(fault))

            node.every(_LOOK_FOR_END_S, tell_ended)
            node.serve(keys.VIRTUAL_REQUEST, on_request)
            node.every(LOOK_S, GiveWay())
            node.ready()
            node.run()


def own_endpoint(config: RobotConfig) -> str | None:
    """Where the virtual robot of a configuration is reached while no rendezvous is there: on this
    computer, at a port that follows from the rendezvous'; ``None`` if that has none."""
    protocol, _, address = config.zenoh.endpoint.partition("/")
    port = address.rpartition(":")[2]
    if protocol != "tcp" or not port.isdecimal() or int(port) + _PORTS_ON > _LAST_PORT:
        return None
    return f"tcp/127.0.0.1:{int(port) + _PORTS_ON}"


def run_alone(scenario: Scenario, path: Path | None = None) -> None:
    """As :func:`run`, without Zenoh: for other software that wants a Dynamixel bus.

    Args:
        scenario, path: As there.

    Raises:
        ConfigError, ImportError, NotWritable: As there.
    """
    stopped = threading.Event()
    for number in stop_signals():
        signal.signal(number, lambda *_: stopped.set())
    buses = scenario.make()
    with (
        _claimed(scenario),
        true_path(path, Clock()) as on_pose,
        _ports(scenario, buses, scenario.make_drive(buses), None, on_pose) as ports,
    ):
        logger.info("ready")
        while not stopped.wait(_LOOK_FOR_END_S):
            ports.call(lambda _: None)  # raises if nobody is there any more


def obey(
    request: VirtualRequest,
    buses: Mapping[str, VirtualBus],
    config: RobotConfig,
    drive: "CoupledDrive | None" = None,
) -> VirtualReply:
    """Inject, heal or list; what cannot be done is refused with a reason."""
    injection = request.injection
    try:
        match request.operation:
            case "inject":
                if injection is None:
                    raise InjectionError("inject needs an injection")
                text = f"injected {in_words(_inject(injection, buses, config, drive))}"
            case "heal":
                wanted = injection or Injection(kind="")
                healed = _heal(wanted, buses, config, drive)
                words = "; ".join(map(in_words, healed))
                text = f"healed {words}" if healed else "nothing to heal"
            case "list":
                count = len(_active(buses, drive))
                text = f"{count} fault{'' if count == 1 else 's'} active"
    except InjectionError as error:
        return VirtualReply(stamp=0, ok=False, text=str(error), active=_active(buses, drive))
    return VirtualReply(stamp=0, ok=True, text=text, active=_active(buses, drive))


def _inject(
    injection: Injection,
    buses: Mapping[str, VirtualBus],
    config: RobotConfig,
    drive: "CoupledDrive | None",
) -> Injection:
    if injection.kind in DRIVE_KINDS:
        if drive is None:
            raise InjectionError(f"{injection.kind}: the robot has no [drive]")
        return drive.inject(injection)
    name = bus_of(injection, config)
    return msgspec.structs.replace(buses[name].inject(injection), bus=name)


def _heal(
    wanted: Injection,
    buses: Mapping[str, VirtualBus],
    config: RobotConfig,
    drive: "CoupledDrive | None",
) -> list[Injection]:
    """What names a wheel concerns the drive alone, what names a bus or a servo a bus alone."""
    names = [bus_of(wanted, config)] if wanted.bus else list(buses)
    if wanted.wheel is not None:
        names = []
    healed = [
        msgspec.structs.replace(fault, bus=name)
        for name in names
        for fault in buses[name].heal(wanted.kind, wanted.servo)
    ]
    if drive is not None and not wanted.bus and wanted.servo is None:
        healed += drive.heal(wanted.kind, wanted.wheel)
    return healed


def in_words(injection: Injection) -> str:
    """One line: ``break at servo 5 on bus main, from 2 s on, for 10 s``."""
    words = injection.kind
    if injection.servo is not None:
        words += f" at servo {injection.servo}"
    if injection.wheel is not None:
        words += f" at wheel {injection.wheel}"
    if injection.bus:
        words += f" on bus {injection.bus}"
    if injection.value is not None:
        words += f", value {injection.value:g}"
    if injection.start_s:
        words += f", from {injection.start_s:g} s on"
    if injection.duration_s is not None:
        words += f", for {injection.duration_s:g} s"
    return words


def _active(buses: Mapping[str, VirtualBus], drive: "CoupledDrive | None") -> list[Injection]:
    active = [
        msgspec.structs.replace(injection, bus=name)
        for name, bus in buses.items()
        for injection in bus.active()
    ]
    return active if drive is None else active + drive.active()


def _claimed(scenario: Scenario) -> AbstractContextManager[None]:
    buses = scenario.config.buses.values()
    return claimed(Path(port) for port in [*(bus.port for bus in buses), *scenario.taps.values()])


def _ports(
    scenario: Scenario,
    buses: Mapping[str, VirtualBus],
    drive: "CoupledDrive | None",
    on_sample: "Callable[[Sample, int], None] | None",
    on_pose: "Callable[[InPlane, int], None] | None",
) -> Ports:
    configs = scenario.config.buses
    ports = Ports(
        {name: (bus, Path(configs[name].port)) for name, bus in buses.items()},
        {name: Path(port) for name, port in scenario.taps.items()},
        drive,
        on_sample,
        on_pose,
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
