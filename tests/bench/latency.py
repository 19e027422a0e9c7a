"""How long after the wire has shown a fault health tells it, on a whole live robot.

Time runs from the end of the detection window: the end of the transaction with which the fault
could first be told, which is the evidence of its report. What a diagnosis has to wait for (more
losses, a ping of its own) is before that, and so is the time for which the gateway listens in vain;
from there on everything counts: publishing, each hop between processes, diagnosis, merging, saving
the state, until a program on the robot that reads ``health`` has the message that first tells the
fault, in Zenoh's callback. That program is linked as the services are, directly, and so is the end
of the chain beside it. An unplugged adapter has no deciding transaction: there it runs from the
moment at which the virtual bus pulled it.
"""

import tempfile
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median, quantiles

from rich.table import Table

from tests.bench.hops import relays
from tests.bench.progress import steps
from tests.bench.result import Figure, table
from tests.bench.robot import BEYOND_WHEELS, config
from tests.robot import Heard, Robot, fault, running, write
from wackel_node.link import Link
from wackel_schemas import component, keys
from wackel_schemas.health import FaultRecord, Health


@dataclass
class _Kind:
    """A fault that shows at once.

    Attributes:
        kind: As the virtual bus calls it.
        at_servo: Whether it concerns one servo, another one each time.
        code: As health calls it.
        took_ms: What was measured.
    """

    kind: str
    at_servo: bool
    code: str
    took_ms: list[float] = field(default_factory=list)


def run(*, quick: bool = False) -> Table:
    """Injects and heals faults of several kinds in turn."""
    kinds = [
        _Kind("overload", True, "overload"),
        _Kind("rhythmic_jammer", False, "rhythmic_jammer"),
        _Kind("silent", True, "servo_silent"),
        _Kind("unplugged", False, "adapter_unplugged"),
    ]
    rounds = 5 if quick else 30
    bare_ms: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        robot_config = config(directory)
        path = write(robot_config, directory, "hops")
        with (
            running(robot_config, directory) as robot,
            Link(robot_config, "peer") as link,
            relays(robot_config, path, link.session) as chain,
        ):
            reader = _Reader(link)
            robot.wait(lambda: robot.ready() and reader.heard() is not None)
            for number in steps(range(rounds), "latency"):
                for kind in kinds:
                    servo = _servo(number) if kind.at_servo else None
                    kind.took_ms.append(_took_ms(robot, reader, kind, servo))
                    bare_ms.append(chain.took_ms())
    figures = [
        Figure(f"{kind.code}: {what}", value, "ms")
        for kind in kinds
        for what, value in (("p50", median(kind.took_ms)), ("worst", max(kind.took_ms)))
    ]
    every = [took for kind in kinds for took in kind.took_ms]
    for what, budget in (("p50", 2.0), ("p99", 10.0)):
        ours, bare = (_share(taken, what) for taken in (every, bare_ms))
        figures.append(Figure(f"all: {what}", ours, "ms", None, budget))
        figures.append(Figure(f"all: {what}", ours, "ms", ("Zenoh alone, same way", bare)))
    return table(f"Latency: from the wire to health, {len(every)} faults", figures)


def _share(taken: list[float], what: str) -> float:
    cuts = quantiles(taken, n=100, method="inclusive")
    return cuts[{"p50": 49, "p99": 98}[what]]


def _servo(number: int) -> int:
    return BEYOND_WHEELS[number % len(BEYOND_WHEELS)]


class _Reader:
    """A program that reads health."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._heard: deque[Heard] = deque()
        link.subscribe(keys.HEALTH, self._take)

    def _take(self, _: str, health: Health) -> None:
        self._heard.append(Heard(self._link.clock.stamp_ns(self._link.arrived_ns), health))

    def heard(self) -> Heard | None:
        """The next message, if there is one."""
        self._link.pump()
        return self._heard.popleft() if self._heard else None


def _took_ms(robot: Robot, reader: _Reader, kind: _Kind, servo: int | None) -> float:
    """Injects a fault, measures, heals it and waits until all is well."""
    if kind.kind == "unplugged":
        place = component.adapter("main")
    else:
        place = component.bus("main") if servo is None else component.servo("main", servo)
    while reader.heard() is not None:
        pass  # told before
    begin_ns = robot.inject(kind.kind, servo)
    found: list[tuple[int, FaultRecord]] = []

    def told() -> bool:
        while (heard := reader.heard()) is not None:
            record = fault(heard.health, kind.code, place)
            if record is not None and record.status in ("pending", "confirmed"):
                found.append((heard.at_ns, record))
                return True
        return False

    robot.wait(told)
    at_ns, record = found[0]
    assert record.evidence is not None
    decided = record.evidence.transaction
    if decided is not None:
        begin_ns = decided.stamp + decided.ended_ns
    robot.heal()
    if kind.kind == "overload" and servo is not None:
        robot.reboot(servo)
    robot.wait(robot.ready)
    return (at_ns - begin_ns) / 1e6
