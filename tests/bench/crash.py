"""``kill -9`` of each service in turn while a servo is silent: who tells, what else is hit.

Told: the first health that calls the service dead; for the aggregator, the first health of its
successor. Recovered: all services ready and the fault confirmed, as before. In between, no health
may be without the fault, no other process may be restarted, and no transition may be missing.
"""

import os
import signal
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from rich.table import Table

from tests.bench.progress import steps
from tests.bench.result import Figure, table
from tests.bench.robot import BEYOND_WHEELS, config
from tests.robot import Heard, Robot, fault, running, status
from wackel_cli.supervisor import SOUND_LIFE_S
from wackel_node.config import RecorderConfig
from wackel_schemas import component

_SERVO = BEYOND_WHEELS[0]
_FAULT = ("servo_silent", component.servo("main", _SERVO))
_AGGREGATOR = "aggregator/main"


@dataclass
class _Victim:
    """A service and what its deaths did.

    Attributes:
        told_s, recovered_s: After the kill.
        hit: Other processes that were restarted.
        without: Health messages without the fault, or with more than one occurrence of it.
    """

    name: str
    told_s: list[float] = field(default_factory=list)
    recovered_s: list[float] = field(default_factory=list)
    hit: int = 0
    without: int = 0

    def figures(self) -> list[Figure]:
        return [
            Figure(f"{self.name}: told, worst", max(self.told_s), "s", None, 2.0),
            Figure(f"{self.name}: recovered, worst", max(self.recovered_s), "s"),
            Figure(f"{self.name}: other processes restarted", self.hit, "", None, 0.0),
            Figure(f"{self.name}: health without the fault", self.without, "", None, 0.0),
        ]


def run(*, quick: bool = False) -> Table:
    """Kills every service several times."""
    rounds = 1 if quick else 5
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        recorder = RecorderConfig(directory=str(directory / "recordings"))
        robot_config = msgspec.structs.replace(config(directory), recorder=recorder)
        with running(robot_config, directory) as robot:
            robot.wait(robot.ready)
            victims = [_Victim(name) for name in robot.pids() if name != "virtual/main"]
            robot.inject("silent", _SERVO)
            robot.wait(lambda: robot.confirmed(*_FAULT))
            for _ in steps(range(rounds), "killing"):
                for victim in victims:
                    _kill(robot, victim)
                robot.listen(SOUND_LIFE_S)  # or the next restart would be delayed as in a loop
            numbers = robot.numbers
            missing = max(numbers) + 1 - len(numbers)
    figures = [figure for victim in victims for figure in victim.figures()]
    figures.append(Figure("transitions that were never told", missing, "", None, 0.0))
    return table(f"kill -9 of each service during a fault, {rounds} times", figures)


def _kill(robot: Robot, victim: _Victim) -> None:
    known, boot, pids = len(robot.heard), robot.health.boot, robot.pids()
    names = [name for name in pids if name != "virtual/main"]
    begin_ns = robot.link.clock.now_ns()
    os.kill(pids[victim.name], signal.SIGKILL)

    def tells(heard: Heard) -> bool:
        if victim.name == _AGGREGATOR:
            return heard.health.boot != boot
        return status(heard.health, victim.name) == "dead"

    def told() -> list[Heard]:
        return [heard for heard in robot.heard[known:] if tells(heard)]

    def recovered() -> bool:
        ready = all(robot.status(name) == "ready" for name in names)
        return ready and bool(told()) and robot.confirmed(*_FAULT)

    robot.wait(recovered)
    victim.told_s.append((told()[0].at_ns - begin_ns) / 1e9)
    victim.recovered_s.append((robot.heard[-1].at_ns - begin_ns) / 1e9)
    now = robot.pids()
    victim.hit += sum(now[name] != pids[name] for name in pids if name != victim.name)
    records = [fault(health, *_FAULT) for _, health in robot.heard[known:]]
    victim.without += sum(
        record is None or record.status == "healed" or record.occurrences != 1 for record in records
    )
