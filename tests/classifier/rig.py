"""A virtual bus behind the gateway's own master, in virtual time: an hour of traffic in minutes.

Everything is the product's: the schedule that decides what is asked, the exchange that waits and
reads, the wire that answers. Only the clock and the port between them are replaced, by a host that
is as late as a usual Linux host: some tens of microseconds, and milliseconds once in some thousand
waits.
"""

from collections.abc import Callable, Iterator
from random import Random

from wackel_classifier.core import BusClassifier
from wackel_gateway import exchange
from wackel_gateway.commands import writes
from wackel_gateway.exchange import Exchange
from wackel_gateway.patience import Patience
from wackel_gateway.roster import Roster
from wackel_gateway.schedule import Schedule
from wackel_node.config import BusConfig, ClassifierConfig, ServoConfig
from wackel_schemas.bus import ServoGoal, Transaction
from wackel_schemas.fault import FaultReport
from wackel_schemas.virtual import Injection
from wackel_virtual.bus import VirtualBus

EPOCH_NS = 1_700_000_000_000_000_000
HICCUP = 1 / 4000
"""How often the host oversleeps by milliseconds."""
CALL_NS = 1_000
"""What a look at the clock costs."""


def chain(size: int, **settings: object) -> BusConfig:
    """A bus of servos with ids 1, 2, … in cable order."""
    servos = [ServoConfig(id=servo_id) for servo_id in range(1, size + 1)]
    return BusConfig(port="none", servos=servos, **settings)  # type: ignore[arg-type]


class VirtualPort:
    """The gateway's port and clock, on a virtual bus."""

    latency_timer_ms = 1

    def __init__(self, bus: VirtualBus, baud_rate: int, random: Random) -> None:
        self.baud_rate = baud_rate
        self.now_ns = 0
        self._bus = bus
        self._random = random
        self._unread: list[bytes] = []

    def clock(self) -> int:
        self.now_ns += CALL_NS
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9) + self._oversleeping()

    def write(self, data: bytes) -> None:
        self._bus.transmit(self.now_ns, data, self.baud_rate)

    def read(self) -> bytes:
        self._unread += [data for _, data in self._bus.deliveries(self.now_ns)]
        data = b"".join(self._unread)
        self._unread.clear()
        return data

    def wait(self, timeout_ms: int) -> bool:
        limit = self.now_ns + timeout_ms * 1_000_000
        while not self._unread:
            self._unread += [data for _, data in self._bus.deliveries(self.now_ns)]
            due = self._bus.next_ns()
            if self._unread or due is None or due > limit:
                break
            self.now_ns = max(self.now_ns, due)
        if not self._unread:
            self.now_ns = limit
        self.now_ns += self._oversleeping()
        return bool(self._unread)

    def _oversleeping(self) -> int:
        if self._random.random() < HICCUP:
            return self._random.randrange(1_000_000, 4_000_000)
        return max(5_000, int(self._random.gauss(50_000, 12_000)))


class Rig:
    """One bus, its master and its classifier."""

    def __init__(
        self,
        config: BusConfig,
        seed: int = 0,
        *,
        loss: float = 0.0,
        limits: ClassifierConfig | None = None,
        goals: Callable[[float], list[ServoGoal]] | None = None,
    ) -> None:
        self.bus = VirtualBus(config, seed, loss=loss)
        self.limits = limits or ClassifierConfig()
        self.classifier = BusClassifier("main", config, self.limits)
        self.transactions = 0
        self.reports: list[FaultReport] = []
        self._port = VirtualPort(self.bus, config.baud_rate, Random(f"{seed}/host"))
        patience = Patience(config.baud_rate, self._port.latency_timer_ms)
        self._exchange = Exchange(self._port, patience, lambda: False)  # type: ignore[arg-type]
        self._roster = Roster(config.servos)
        self._schedule = Schedule(self._roster, config.rate, fast=config.fast_sync_read, now_ns=0)
        self._goals = goals

    @property
    def seconds(self) -> float:
        return self._port.now_ns / 1e9

    def inject(self, kind: str, servo: int | None = None, value: float | None = None) -> None:
        self.bus.inject(Injection(kind=kind, servo=servo, value=value))

    def run(self, seconds: float) -> list[FaultReport]:
        """Goes on for so long; the reports of that time."""
        known = len(self.reports)
        for transaction in self.traffic(seconds):
            self._take(transaction)
        return self.reports[known:]

    def run_until(self, seconds: float, found: Callable[[FaultReport], bool]) -> FaultReport | None:
        """Goes on until a report is what is looked for, at most for so long."""
        for transaction in self.traffic(seconds):
            for report in self._take(transaction):
                if found(report):
                    return report
        return None

    def run_until_missing(self, seconds: float) -> int:
        """Goes on until an answer is missing, at most for so long; the stamp of that."""
        stamp = EPOCH_NS + self._port.now_ns
        for transaction in self.traffic(seconds):
            self._take(transaction)
            stamp = transaction.stamp
            if len(transaction.response_times) < len(transaction.expected):
                break
        return stamp

    def active(self) -> list[tuple[str, str]]:
        return [(report.code, report.component) for report in self.classifier.active()]

    def traffic(self, seconds: float) -> Iterator[Transaction]:
        """What the gateway would publish in the next seconds."""
        port, schedule = self._port, self._schedule
        end = port.now_ns + round(seconds * 1e9)
        cycles = schedule.cycles
        while port.now_ns < end:
            job = schedule.next(port.now_ns)
            if job is None:
                port.sleep(max(0.0, (schedule.due_ns - port.now_ns) / 1e9))
                continue
            # The gateway's own code on this clock.
            clock, sleep = exchange.monotonic_ns, exchange.sleep
            exchange.monotonic_ns, exchange.sleep = port.clock, port.sleep  # type: ignore[assignment]
            try:
                late = self._exchange.drain()
                self._exchange.send(job.purpose, job.instruction)
                outcome = self._exchange.gather()
            finally:
                exchange.monotonic_ns, exchange.sleep = clock, sleep  # type: ignore[assignment]
            if late is not None:
                yield late.message(EPOCH_NS)
            schedule.done(job, outcome.answers, outcome.begin_ns, outcome.ended_ns)
            schedule.heard(outcome.answers)
            yield outcome.message(EPOCH_NS)
            if self._goals is not None and schedule.cycles != cycles:
                cycles = schedule.cycles
                schedule.command(writes(self._goals(self.seconds), self._roster))

    def _take(self, transaction: Transaction) -> list[FaultReport]:
        self.transactions += 1
        reports = self.classifier.step(transaction)
        self.reports += reports
        return reports
