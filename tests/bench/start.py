"""From the start of each service's process to its first message, and from SIGTERM to its end.

The first message is the first heartbeat; ready is the first that says so. The services are started
one after the other, each with the arguments that ``wackel up`` gives it.
"""

import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import msgspec
from rich.table import Table

from tests.bench.progress import steps
from tests.bench.result import Figure, table
from tests.bench.robot import config
from tests.conftest import wait_until
from tests.robot import write
from wackel_cli.supervisor import Job
from wackel_cli.up import robot_jobs
from wackel_node.config import RecorderConfig
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.health import Heartbeat

_FILTERPY = ("odometry/main",)
"""Services that import filterpy, and with it scipy, which alone takes most of a second."""


@dataclass
class _Service:
    """A service and how long it took, s, in each round."""

    job: Job
    first_s: list[float] = field(default_factory=list)
    ready_s: list[float] = field(default_factory=list)
    stop_s: list[float] = field(default_factory=list)

    def figures(self) -> list[Figure]:
        name = self.job.name
        budget = 2.0 if name in _FILTERPY else 1.0
        return [
            Figure(f"{name}: first message", median(self.first_s), "s", None, budget),
            Figure(f"{name}: first message, worst", max(self.first_s), "s"),
            Figure(f"{name}: ready", median(self.ready_s), "s"),
            Figure(f"{name}: stop", median(self.stop_s), "s", None, 1.0),
            Figure(f"{name}: stop, worst", max(self.stop_s), "s"),
        ]


def run(*, quick: bool = False) -> Table:
    """Starts and stops all services several times."""
    rounds = 3 if quick else 10
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        recorder = RecorderConfig(directory=str(directory / "recordings"))
        robot = msgspec.structs.replace(config(directory), recorder=recorder)
        path = write(robot, directory)
        services = [_Service(job) for job in robot_jobs(robot, path, virtual=True, record=True)]
        with Link(robot, "router") as link, (directory / "log").open("w") as log:
            beats = _Beats(link)
            for _ in steps(range(rounds), "starting"):
                _round(services, beats, log.fileno())
    figures = [figure for service in services for figure in service.figures()]
    return table(f"Start and stop of each service, {rounds} times", figures)


class _Beats:
    """When the first heartbeat of each state of each service came."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._at_s: dict[tuple[str, str], float] = {}
        link.subscribe(keys.ALIVE, self._take)

    def _take(self, key: str, beat: Heartbeat) -> None:
        name = key.removeprefix("alive/")
        for state in ("", beat.state):
            self._at_s.setdefault((name, state), time.monotonic())

    def forget(self) -> None:
        """Another round."""
        self._link.pump()
        self._at_s.clear()

    def wait(self, name: str, state: str = "") -> float:
        """When a service was first heard, in a state if one is given; monotonic s."""
        wait_until(lambda: (name, state) in self._at_s, 20.0, lambda: self._link.pump(0.1))
        return self._at_s[name, state]


def _round(services: list[_Service], beats: _Beats, log: int) -> None:
    """Starts all, then stops all."""
    beats.forget()
    started: list[tuple[_Service, subprocess.Popen[bytes]]] = []
    try:
        for service in services:
            begin_s = time.monotonic()
            command = [sys.executable, "-m", "wackel_cli", *service.job.arguments]
            started.append((service, subprocess.Popen(command, stdout=log, stderr=log)))
            service.first_s.append(beats.wait(service.job.name) - begin_s)
            service.ready_s.append(beats.wait(service.job.name, "ready") - begin_s)
        for service, process in reversed(started):
            begin_s = time.monotonic()
            process.send_signal(signal.SIGTERM)
            code = process.wait(10)
            service.stop_s.append(time.monotonic() - begin_s)
            if code:
                raise RuntimeError(f"{service.job.name} ended with exit code {code}")
    finally:
        for _, process in started:
            process.kill()
            process.wait()
