"""Scenario files: a virtual robot and what goes wrong with it when.

::

    seed = 7
    robot = "robot.toml"   # or [buses.NAME] tables as there; neither: 12 servos at ./wackel-bus
    loss = 0.0005          # ordinary loss, share of answers
    latency_ms = 1         # USB latency timer
    taps = { main = "tap" } # ports of second adapters that only listen, by bus

    physics = "fast"       # or "mujoco" (extra sim); of a robot with a drive

    [[faults]]
    kind = "loose_contact" # `wackel virtual kinds` lists them
    servo = 5              # for a cable, the servo that it leads to
    value = 8
    start_s = 2
    duration_s = 10

    [[faults]]
    kind = "wheel_blocked" # one of the drive
    wheel = "left"
    start_s = 20
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
from msgspec import Meta

from wackel_node.config import BusConfig, ConfigError, RobotConfig, ServoConfig, load, parse
from wackel_node.config_errors import first_problem
from wackel_node.config_types import Name, Positive, Share
from wackel_node.toml_text import toml_text
from wackel_schemas.virtual import Injection
from wackel_virtual.board import boards
from wackel_virtual.bus import VirtualBus
from wackel_virtual.drive_faults import DRIVE_KINDS, checked_drive
from wackel_virtual.faults import InjectionError, checked

if TYPE_CHECKING:
    from wackel_virtual.coupled_drive import CoupledDrive

DEFAULT_BUS = BusConfig(
    port="wackel-bus",
    servos=[ServoConfig(id=i) for i in range(1, 13)],
    return_delay_us=0,
)
"""What runs where no configuration is given: the usual chain of a small humanoid's legs."""


class _Fault(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """An :class:`~wackel_schemas.virtual.Injection` as it stands in a file."""

    kind: str
    bus: str = ""
    servo: int | None = None
    wheel: str | None = None
    value: float | None = None
    start_s: Annotated[float, Meta(ge=0)] = 0.0
    duration_s: Positive | None = None


class _File(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    seed: int = 0
    robot: str = ""
    buses: dict[Name, BusConfig] = {}
    loss: Share = 0.0
    latency_ms: Annotated[int, Meta(ge=0, le=255)] = 0
    taps: dict[str, str] = {}
    physics: Literal["fast", "mujoco"] = "fast"
    faults: list[_Fault] = []


class Scenario(msgspec.Struct, kw_only=True, frozen=True):
    """A virtual robot and its faults, checked.

    Attributes:
        config: The robot; its buses are what is made.
        seed: Of everything random.
        loss: Share of answers that are lost on healthy buses.
        latency_ms: USB latency timer of the adapters.
        taps: Ports of second adapters, which only listen, by bus.
        physics: Of the drive.
        faults: Each with the name of its bus, or of the drive.
    """

    config: RobotConfig
    seed: int = 0
    loss: float = 0.0
    latency_ms: int = 0
    taps: dict[str, str] = {}
    physics: Literal["fast", "mujoco"] = "fast"
    faults: list[Injection] = []

    def make(self) -> dict[str, VirtualBus]:
        """The buses by name, their faults scheduled."""
        buses = {}
        for name, bus in self.config.buses.items():
            # Buses of one robot must not share their randomness.
            buses[name] = VirtualBus(
                bus,
                f"{self.seed}/{name}",
                latency_ms=self.latency_ms,
                loss=self.loss,
                tapped=name in self.taps,
                boards=boards(self.config.gyros, name),
            )
        for fault in self.faults:
            if fault.bus:
                buses[fault.bus].inject(fault)
        return buses

    def make_drive(self, buses: Mapping[str, VirtualBus]) -> "CoupledDrive | None":
        """What these buses, which are new, move, its faults scheduled; absent without wheels.

        Raises:
            ImportError: MuJoCo is wanted and not installed.
        """
        if self.config.drive is None:
            return None
        from wackel_virtual.coupled_drive import CoupledDrive

        drive = CoupledDrive(self.config.drive, self.config.gyros, buses, self.seed, self.physics)
        for fault in self.faults:
            if not fault.bus:
                drive.inject(fault)
        return drive


def of_robot(config: RobotConfig, seed: int = 0) -> Scenario:
    """A healthy robot; one without buses gets :data:`DEFAULT_BUS`."""
    if not config.buses:
        config = msgspec.structs.replace(config, buses={"main": DEFAULT_BUS})
    return Scenario(config=config, seed=seed)


def load_scenario(path: Path) -> Scenario:
    """Reads and checks a file.

    Raises:
        ConfigError: One line: file, key, what stands there and what is allowed.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows' editors put a mark in front
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from error
    return parse_scenario(text, path)


def parse_scenario(text: str, path: Path = Path("scenario.toml")) -> Scenario:
    """Checks the text of a file; ``path`` is how errors call it and where ``robot`` starts from.

    Raises:
        ConfigError: As :func:`load_scenario`.
    """
    try:
        tree = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not TOML: {error}") from error
    problem = first_problem(tree, _File)
    if problem:
        raise ConfigError(f"{path}: {problem}")
    file = msgspec.convert(tree, _File)
    if file.robot and file.buses:
        raise ConfigError(f"{path}: robot and buses exclude each other; leave out one")
    if file.robot:
        config = load(path.parent / file.robot)
    else:
        # Checked as in a robot.toml, so that it has the same rules.
        config = parse(toml_text({"buses": tree.get("buses", {})}), str(path))
    robot = of_robot(config)
    scenario = Scenario(
        config=robot.config,
        seed=file.seed,
        loss=file.loss,
        latency_ms=file.latency_ms,
        physics=file.physics,
        faults=[
            _placed(fault, robot.config, f"{path}: faults[{i}]")
            for i, fault in enumerate(file.faults)
        ],
    )
    return tapped(scenario, file.taps, f"{path}: taps")


def tapped(scenario: Scenario, taps: Mapping[str, str], where: str) -> Scenario:
    """The scenario with second adapters, which only listen.

    Args:
        scenario: As it was.
        taps: Their ports, by bus.
        where: How errors call them.

    Raises:
        ConfigError: There is no such bus, or the port is taken.
    """
    buses = scenario.config.buses
    taken = {bus.port for bus in buses.values()}
    for name, port in taps.items():
        if name not in buses:
            raise ConfigError(f"{where}: there is no bus {name!r}; there are {', '.join(buses)}")
        if port in taken:
            raise ConfigError(f"{where}: {name} = {port!r}: the port is taken; choose another")
        taken.add(port)
    return msgspec.structs.replace(scenario, taps=dict(taps))


def bus_of(injection: Injection, config: RobotConfig) -> str:
    """The bus that an injection concerns: the one it names, or the only one.

    Raises:
        InjectionError: There is no such bus, or several and none is named.
    """
    known = ", ".join(config.buses)
    if injection.bus:
        if injection.bus not in config.buses:
            raise InjectionError(f"there is no bus {injection.bus!r}; there are {known}")
        return injection.bus
    if len(config.buses) != 1:
        raise InjectionError(f"name the bus; there are {known}")
    return next(iter(config.buses))


def _placed(fault: _Fault, config: RobotConfig, where: str) -> Injection:
    injection = Injection(**msgspec.structs.asdict(fault))
    try:
        if injection.kind in DRIVE_KINDS:
            return _on_drive(injection, config)
        name = bus_of(injection, config)
        injection = checked(injection, config.buses[name].ids())
    except InjectionError as error:
        raise ConfigError(f"{where}: {error}") from error
    return msgspec.structs.replace(injection, bus=name)


def _on_drive(injection: Injection, config: RobotConfig) -> Injection:
    if config.drive is None:
        raise InjectionError(f"{injection.kind}: the robot has no [drive]")
    from wackel_drive.layout import Layout

    return checked_drive(injection, Layout(config.drive))
