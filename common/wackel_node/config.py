"""The robot's configuration, ``robot.toml``: types, defaults, and errors a person understands.

Every default stands here or in ``config_drive`` and nowhere else; ``wackel config`` prints them.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from wackel_node.config_drive import DriveConfig, GyroConfig, drive_problem, gyro_problem
from wackel_node.config_errors import first_problem
from wackel_node.config_types import MaybePath, Name, PortPath, Positive, Section, ServoId, Share
from wackel_node.errors import USAGE, Explained
from wackel_node.toml_text import toml_text
from wackel_protocols.dynamixel2.control_table import (
    BAUD_RATES,
    UnknownModel,
    baud_rate_register,
    configured,
)

Endpoint = Annotated[
    str,
    Meta(
        pattern=r"^(tcp|udp|tls|quic|ws|unixsock-stream)/\S+\Z",
        extra={"words": "a Zenoh endpoint such as 'tcp/127.0.0.1:7447'"},
    ),
]
BaudRate = Annotated[int, Meta(extra={"values": BAUD_RATES})]


class ConfigError(Explained, ValueError):
    """A configuration that cannot be used; the text is one line that names the key."""

    exit_code = USAGE


class ServoConfig(Section, kw_only=True, frozen=True):
    """One servo of a chain.

    Attributes:
        id: 0 … 252.
        model: Model name or series as in the control tables, ``XM430-W210``.
        role: What it moves, in the builder's words.
    """

    id: ServoId
    model: str = "XM430-W210"
    role: str = ""


class BusConfig(Section, kw_only=True, frozen=True):
    """One servo bus.

    Attributes:
        port: Path of the serial port.
        baud_rate: Bit/s.
        protocol: Wire protocol.
        mode: ``poll``: the gateway is the master; ``proxy``: the user's software opens
            ``proxy_port``; ``tap``: a second adapter that only listens.
        rate: Cycles per second in mode poll; the wire may allow fewer.
        servos: In cable order, from the adapter outwards.
        power: Where supply enters the chain: before the first servo (``adapter``), after the last
            (``far``), or both. The thesis calls ``far`` one-sided and ``adapter`` double-sided.
        return_delay_us: Return Delay Time that all servos of this bus should have, µs; absent: the
            one that most of them have.
        nominal_voltage: V; absent: not checked.
        proxy_port: Path at which mode proxy offers its port.
        fast_sync_read: Use Fast Sync Read where the firmware knows it.
    """

    port: PortPath
    baud_rate: BaudRate = 1_000_000
    protocol: Literal["dynamixel2"] = "dynamixel2"
    mode: Literal["poll", "proxy", "tap"] = "poll"
    rate: Annotated[float, Meta(gt=0, le=2000)] = 100.0
    servos: list[ServoConfig] = []
    power: Literal["adapter", "far", "both"] = "adapter"
    return_delay_us: Annotated[int, Meta(ge=0, le=508)] | None = None
    nominal_voltage: Positive | None = None
    proxy_port: MaybePath = ""
    fast_sync_read: bool = True

    def ids(self) -> tuple[int, ...]:
        """Servo ids in cable order."""
        return tuple(servo.id for servo in self.servos)


class LooseContactConfig(Section, kw_only=True, frozen=True):
    """When intermittent loss is a loose contact (thesis, 3.5 and 4).

    Attributes:
        window_s: Time that is looked back at; longer than one movement of the robot.
        sample_hz: How often the connection is sampled, 1/5 … 20 Hz in the thesis.
        rate_low: Failure rate below which loss is ordinary on TTL.
        rate_high: Failure rate above which the connection is gone rather than loose.
        evenness: Least (ē − 1)/(ê − 1): failures in one lump are a disconnection.
    """

    window_s: Positive = 10.0
    sample_hz: Positive = 20.0
    rate_low: Share = 0.02
    rate_high: Share = 0.9
    evenness: Share = 0.1


class ClassifierConfig(Section, kw_only=True, frozen=True):
    """Thresholds of the bus fault classifier that have a physical meaning.

    Attributes:
        ordinary_loss: Share of answers that may be lost on a healthy TTL bus.
        false_alarms_per_hour: Designed rate of the statistical tests, per bus.
        loose_contact: The thesis's analysis over time.
    """

    ordinary_loss: Share = 0.001
    false_alarms_per_hour: Positive = 0.001
    loose_contact: LooseContactConfig = LooseContactConfig()


class ZenohConfig(Section, kw_only=True, frozen=True):
    """How the processes meet.

    Attributes:
        endpoint: The rendezvous on the robot, at which ``wackel up`` or zenohd listens. A virtual
            robot itself listens 10000 ports further on, on this computer only.
        lease_ms: After this time without a sign, a peer counts as gone.
    """

    endpoint: Endpoint = "tcp/127.0.0.1:7447"
    lease_ms: Annotated[int, Meta(ge=100, le=60_000)] = 1000


class RecorderConfig(Section, kw_only=True, frozen=True):
    """Recordings of ``wackel up``.

    Attributes:
        directory: Where they go; empty: none is made.
        max_bytes, max_s: A new file after so much.
    """

    directory: MaybePath = ""
    max_bytes: Annotated[int, Meta(gt=0)] = 1_000_000_000
    max_s: Positive = 3600.0


class RobotConfig(Section, kw_only=True, frozen=True):
    """The whole file.

    Attributes:
        robot: The robot's name, the second chunk of every key.
        buses: By name.
        drive: The wheels; absent: no odometry.
        gyros: By name.
        zenoh, classifier, recorder: Sections of the same name.
        state_directory: Where the aggregator keeps confirmed faults over a restart; empty:
            ``$XDG_STATE_HOME/wackel``.
    """

    robot: Name = "robot"
    buses: dict[Name, BusConfig] = {}
    drive: DriveConfig | None = None
    gyros: dict[Name, GyroConfig] = {}
    zenoh: ZenohConfig = ZenohConfig()
    classifier: ClassifierConfig = ClassifierConfig()
    recorder: RecorderConfig = RecorderConfig()
    state_directory: MaybePath = ""


def drive_of(config: RobotConfig, purpose: str) -> DriveConfig:
    """The drive of a robot that needs one to ``purpose``.

    Raises:
        ConfigError: It has none.
    """
    if config.drive is None:
        raise ConfigError(
            f"no [drive] in the configuration of {config.robot}: list its wheels there to {purpose}"
        )
    return config.drive


def load(path: Path) -> RobotConfig:
    """Reads and checks a file.

    Raises:
        ConfigError: One line: file, key, what stands there and what is allowed.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows' editors put a mark in front
    except FileNotFoundError as error:
        raise ConfigError(
            f"{path}: no such file; `wackel scan --write {path}` makes one to start from"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from error
    return parse(text, str(path))


def parse(text: str, name: str = "robot.toml") -> RobotConfig:
    """Checks the text of a file; ``name`` is how errors call it.

    Raises:
        ConfigError: As :func:`load`.
    """
    try:
        tree = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also numbers and nesting beyond Python's limits
        raise ConfigError(f"{name}: not TOML: {error}") from error
    problem = first_problem(tree, RobotConfig)
    if problem:
        raise ConfigError(f"{name}: {problem}")
    config = msgspec.convert(tree, RobotConfig)
    _check(config, name)
    return config


def dump(config: RobotConfig) -> str:
    """The configuration as a file with every default written out."""
    return toml_text(msgspec.to_builtins(config))


def _check(config: RobotConfig, name: str) -> None:
    """What types cannot say."""
    ports: dict[str, str] = {}
    for bus_name, bus in config.buses.items():
        where = f"{name}: buses.{bus_name}"
        ids = bus.ids()
        doubled = sorted({i for i in ids if ids.count(i) > 1})
        if doubled:
            raise ConfigError(
                f"{where}.servos: id {doubled[0]} stands there twice; every id is used once a bus"
            )
        for number, servo in enumerate(bus.servos):
            try:
                model = configured(servo.model)
            except UnknownModel as error:
                raise ConfigError(f"{where}.servos[{number}].model: {error}") from error
            _, highest = model.registers["baud_rate"].bounds
            if baud_rate_register(bus.baud_rate) > highest:
                raise ConfigError(
                    f"{where}.baud_rate = {bus.baud_rate}: servo {servo.id}, a {model.name}, "
                    f"does not go beyond {BAUD_RATES[highest]}"
                )
        if bus.mode == "proxy" and not bus.proxy_port:
            raise ConfigError(
                f"{where}.proxy_port is missing: mode = 'proxy' needs the path at which your "
                "software opens the port"
            )
        if bus.port in ports:
            raise ConfigError(f"{where}.port = {bus.port!r}: bus {ports[bus.port]} has it already")
        ports[bus.port] = bus_name
    problem = None
    if config.drive is not None:
        problem = drive_problem(config.drive, {b: config.buses[b].ids() for b in config.buses})
    polled = {b: (bus.ids(), bus.rate) for b, bus in config.buses.items() if bus.mode == "poll"}
    problem = problem or gyro_problem(config.gyros, polled)
    if problem:
        raise ConfigError(f"{name}: {problem}")
