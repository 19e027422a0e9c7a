"""The gateway's schedule against the virtual bus, in simulated time: no port, no clock."""

from collections.abc import Iterator

from wackel_gateway.job import Job
from wackel_gateway.outcome import Outcome
from wackel_gateway.patience import Patience
from wackel_gateway.roster import Roster
from wackel_gateway.schedule import Schedule
from wackel_node.config import BusConfig
from wackel_protocols.dynamixel2.answers import reader
from wackel_virtual.bus import VirtualBus

_HOST_NS = 100_000


class Simulation:
    """A master and its bus; use :meth:`run` to let time pass.

    ``host_ns`` is what the host takes from the end of a transaction to the beginning of the next.
    """

    def __init__(self, config: BusConfig, bus: VirtualBus, host_ns: int = _HOST_NS) -> None:
        self.config = config
        self.bus = bus
        self.roster = Roster(config.servos)
        self.now_ns = 0
        self._host_ns = host_ns
        self.schedule = Schedule(
            self.roster, config.rate, fast=config.fast_sync_read, now_ns=self.now_ns
        )
        self.patience = Patience(config.baud_rate, latency_timer_ms=0)

    def run(self, seconds: float) -> Iterator[tuple[Job, Outcome]]:
        """Every job and its outcome within so much simulated time."""
        until_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < until_ns:
            job = self.schedule.next(self.now_ns)
            if job is None:
                self.now_ns = max(self.schedule.due_ns, self.now_ns + 1)
                continue
            outcome = self._exchange(job)
            self.now_ns = outcome.ended_ns + self._host_ns
            self.schedule.done(job, outcome.answers, outcome.begin_ns, outcome.ended_ns)
            self.schedule.heard(outcome.answers)
            yield job, outcome

    def _exchange(self, job: Job) -> Outcome:
        read = reader(job.instruction)
        expectation = read.expectation
        begin_ns = self.now_ns
        sent_ns = begin_ns + self.patience.wire_ns(len(job.instruction))
        deadline_ns = sent_ns + self.patience.limit_ns(expectation)
        came = self.bus.exchange(begin_ns, job.instruction, deadline_ns - begin_ns)
        chunks: list[tuple[int, bytes]] = []
        data = b""
        answers = read.read(data)
        for at_ns, part in came:
            chunks.append((at_ns, part))
            data += part
            if len(data) >= expectation.total_bytes:
                answers = read.read(data)
                if not answers.missing:
                    break
        if data and answers.missing:
            answers = read.read(data)
        if expectation.ids and not answers.missing:
            self.patience.completed(expectation, chunks[-1][0] - sent_ns)
            ended_ns = chunks[-1][0]
        else:
            ended_ns = deadline_ns
        return Outcome(
            job.purpose,
            job.instruction,
            expectation,
            begin_ns,
            sent_ns,
            chunks,
            answers,
            deadline_ns,
            ended_ns,
            0,
            self.config.baud_rate,
        )
