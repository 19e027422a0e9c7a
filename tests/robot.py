"""A virtual robot of one's own: configuration in a directory, real processes, what they say."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NamedTuple

from tests.conftest import free_port, wait_until
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, ZenohConfig, dump
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.bus import BusRequest
from wackel_schemas.health import FaultRecord, Health
from wackel_schemas.virtual import Injection, VirtualReply, VirtualRequest

SERVICES = ("gateway/main", "classifier/main", "aggregator/main")
_START_S = 30.0  # all processes at once on a busy computer
_STOP_S = 10.0


def chain(directory: Path, servos: int, **settings: object) -> RobotConfig:
    """A robot that collides with no other: own port, own state; one bus called main.

    Args:
        directory: Where the bus's port and the state go.
        servos: How many; their ids are 1, 2, … in cable order.
        settings: Of the bus.
    """
    bus = BusConfig(
        port=str(directory / "bus"),
        servos=[ServoConfig(id=servo_id) for servo_id in range(1, servos + 1)],
        **settings,  # type: ignore[arg-type]
    )
    return RobotConfig(
        robot="testbot",
        buses={"main": bus},
        zenoh=ZenohConfig(endpoint=f"tcp/127.0.0.1:{free_port()}"),
        state_directory=str(directory / "state"),
    )


def write(config: RobotConfig, directory: Path, name: str = "robot") -> Path:
    """The configuration as a file."""
    path = directory / f"{name}.toml"
    path.write_text(dump(config), encoding="utf-8")
    return path


class Heard(NamedTuple):
    """A health message and when Zenoh had it, UTC ns."""

    at_ns: int
    health: Health


class Robot:
    """A virtual robot that ``wackel up`` runs, and a program that listens to its health.

    Attributes:
        link: The program's link.
        up: The process of ``wackel up``.
        heard: Every health message so far.
    """

    def __init__(self, link: Link, up: subprocess.Popen[str], lines: Path) -> None:
        self.link = link
        self.up = up
        self.heard = [Heard(0, Health(stamp=0, level="unknown", summary="nothing heard"))]
        self._lines = lines
        link.subscribe(keys.HEALTH, self._take)

    def _take(self, _: str, health: Health) -> None:
        self.heard.append(Heard(self.link.clock.stamp_ns(self.link.arrived_ns), health))

    @property
    def health(self) -> Health:
        """The latest."""
        return self.heard[-1].health

    @property
    def numbers(self) -> set[int]:
        """Of all transitions that were told."""
        return {told.number for _, health in self.heard for told in health.transitions}

    def wait(self, condition: Callable[[], bool], limit_s: float = 30.0) -> None:
        """Listens until a condition holds.

        Raises:
            AssertionError: It did not come true within the limit.
        """
        wait_until(condition, limit_s, lambda: self.link.pump(0.02))

    def listen(self, seconds: float) -> None:
        """Listens for so long."""
        limit = time.monotonic() + seconds
        while time.monotonic() < limit:
            self.link.pump(limit - time.monotonic())

    def ready(self) -> bool:
        """Whether all is well and every service that has been started says so."""
        return self.health.level == "ok" and all(
            self.status(name) == "ready" for name in self.pids()
        )

    def status(self, service: str) -> str:
        """What health says of a service; empty if nothing."""
        return status(self.health, service)

    def fault(self, code: str, component: str) -> FaultRecord | None:
        """What health says of a fault."""
        return fault(self.health, code, component)

    def confirmed(self, code: str, component: str) -> bool:
        """Whether health has confirmed a fault."""
        found = self.fault(code, component)
        return found is not None and found.status == "confirmed"

    def pids(self) -> dict[str, int]:
        """Process id of each service, of its latest start, and of the virtual bus."""
        whole = self._lines.read_text().split("\n")[:-1]
        told = [json.loads(line) for line in whole]
        return {
            line["name"]: int(line["detail"].split()[1])
            for line in told
            if line["event"] == "started"
        }

    def inject(self, kind: str, servo: int | None = None, value: float | None = None) -> int:
        """Injects a fault; UTC ns at which the wire had it."""
        return self._ask("inject", Injection(kind=kind, servo=servo, value=value, bus="main")).stamp

    def disturb(self, injection: Injection) -> int:
        """Injects a fault of the drive; UTC ns at which the robot had it."""
        return self._ask("inject", injection).stamp

    def heal(self) -> None:
        """Ends all faults that were injected."""
        self._ask("heal", Injection(kind=""))

    def reboot(self, servo: int) -> None:
        """Restarts a servo through the gateway; only that ends a hardware error.

        A busy computer may lose an answer, so it is asked again.
        """
        request = BusRequest(operation="reboot", id=servo)

        def done() -> bool:
            return self.link.ask(keys.BUS_REQUEST, request, timeout_s=5.0, bus="main").ok

        wait_until(done, _START_S)

    def _ask(self, operation: Literal["inject", "heal"], injection: Injection) -> VirtualReply:
        request = VirtualRequest(operation=operation, injection=injection)
        reply = self.link.ask(keys.VIRTUAL_REQUEST, request, timeout_s=5.0)
        assert reply.ok, reply.text
        return reply


def status(health: Health, service: str) -> str:
    """What a health message says of a service; empty if nothing."""
    return next((s.status for s in health.services if s.name == service), "")


def fault(health: Health, code: str, component: str) -> FaultRecord | None:
    """What a health message says of a fault."""
    return next((f for f in health.faults if (f.code, f.component) == (code, component)), None)


@contextmanager
def running(
    config: RobotConfig, directory: Path, *options: str, virtual: bool = True
) -> Iterator[Robot]:
    """A robot under ``wackel up``; what its services log goes to ``up.log``.

    Args:
        config: Of the robot.
        directory: For its files.
        options: More of ``wackel up``.
        virtual: With a virtual bus at each port.
    """
    path = write(config, directory)
    lines = directory / "up.jsonl"
    command = [sys.executable, "-m", "wackel_cli", "up", str(path), "--json", *options]
    if virtual:
        command.append("--virtual")
    with (
        lines.open("w") as output,
        (directory / "up.log").open("w") as log,
        subprocess.Popen(command, stdout=output, stderr=log, text=True) as up,
    ):
        try:
            wait_until(lambda: "aggregator/main" in lines.read_text(), _START_S)
            with Link(config) as link:
                yield Robot(link, up, lines)
        except AssertionError as error:
            error.add_note(_last_of(directory / "up.log"))
            raise
        finally:
            _end(up)


@contextmanager
def process(*arguments: str, log: Path) -> Iterator[subprocess.Popen[str]]:
    """A Python process ``python -m …`` whose stdout is a pipe; ended with the block.

    Args:
        arguments: Module and its arguments.
        log: Where its stderr goes.
    """
    command = [sys.executable, "-m", *arguments]
    with (
        log.open("a") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as started,
    ):
        try:
            yield started
        except AssertionError as error:
            error.add_note(_last_of(log))
            raise
        finally:
            _end(started)


def _last_of(log: Path) -> str:
    lines = log.read_text(errors="replace").splitlines()[-10:]
    return "\n".join(["the processes said last:", *lines])


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(_STOP_S)
    finally:
        process.kill()
