"""Mode poll: the gateway is the master of the bus."""

from time import monotonic_ns

from wackel_gateway.command_timeouts import CommandTimeouts
from wackel_gateway.commands import Refused, writes
from wackel_gateway.exchange import Exchange
from wackel_gateway.gyro import BusGyro
from wackel_gateway.job import Job, Stage
from wackel_gateway.management import Management
from wackel_gateway.outbox import Outbox
from wackel_gateway.outcome import Outcome
from wackel_gateway.patience import Patience
from wackel_gateway.port import Port, PortLost
from wackel_gateway.processor_wait import ProcessorWait
from wackel_gateway.reporter import Reporter
from wackel_gateway.retry import keep_open
from wackel_gateway.roster import Member
from wackel_gateway.schedule import Schedule
from wackel_node.config import BusConfig
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_protocols.dynamixel2 import packet
from wackel_schemas import keys
from wackel_schemas.bus import BusCommand, BusReply, BusRequest, ServoGoal
from wackel_schemas.wire import Rejected

_LOOK_S = 0.2  # at a rate of few cycles a second, a port that is gone shall still show at once
_OF_A_CYCLE = (Stage.COMMAND, Stage.CYCLE, Stage.PLAIN, Stage.REST, Stage.DEVICE)


class Poller:
    """Runs the schedule on the port, as long as there is one."""

    def __init__(self, node: Node, bus: str, config: BusConfig, reporter: Reporter) -> None:
        self._node = node
        self._config = config
        self._reporter = reporter
        self._roster = reporter.roster
        gyros = [
            (BusGyro(gyro), node.publisher(keys.IMU, name=name))
            for name, gyro in node.config.gyros.items()
            if gyro.source == "bus" and gyro.bus == bus
        ]
        self._gyros = {
            packet.read(gyro.id, gyro.block.address, gyro.block.length): (gyro, publisher)
            for gyro, publisher in gyros
        }
        self._schedule = Schedule(
            self._roster,
            config.rate,
            [(gyro.id, gyro.block) for gyro, _ in gyros],
            fast=config.fast_sync_read,
            now_ns=monotonic_ns(),
        )
        self._processor_wait = ProcessorWait()
        self._timeouts = CommandTimeouts()
        self._exchange: Exchange | None = None
        self._outbox = Outbox(reporter.transaction, self._state)
        self._models: dict[int, int | None] = {}
        self._alerts = False  # whether any servo has ever set an error byte
        self._cycle = 0
        self._cycle_begin_ns = self._cycle_end_ns = 0
        node.subscribe(keys.COMMAND, lambda _, command: self._command(command), bus=bus)
        node.serve(keys.BUS_REQUEST, self._request, bus=bus)
        node.every(_LOOK_S, self._look)

    def run(self) -> None:
        """Until the node stops."""
        keep_open(self._node, self._config, self._reporter, self._poll)

    def _poll(self, port: Port) -> None:
        node, schedule, outbox = self._node, self._schedule, self._outbox
        patience = Patience(port.baud_rate, port.latency_timer_ms)
        exchange = self._exchange = Exchange(port, patience, lambda: node.stopping)
        schedule.restart(monotonic_ns())
        try:
            while not node.stopping:
                node.pump()
                now = monotonic_ns()
                if self._timeouts.due_ns is not None and now >= self._timeouts.due_ns:
                    self._take_back(now)
                job = schedule.next(now)
                if job is None:
                    outbox.release(now)
                    due_ns = min(schedule.due_ns, outbox.due_ns or schedule.due_ns)
                    node.pump(max(0.0, (due_ns - monotonic_ns()) / 1e9))
                    continue
                late = exchange.drain()
                waited_before_ns = self._processor_wait.total_ns() if len(job.ids) == 1 else 0
                exchange.send(job.purpose, job.instruction)
                # The time on the wire is used to publish what came before.
                outbox.release(monotonic_ns())
                if late is not None:
                    outbox.release_all()
                    self._reporter.publish(late)
                outcome = exchange.gather()
                outcome.asked_again = job.asks_again
                if outcome.late:
                    waited_ns = self._processor_wait.total_ns() - waited_before_ns
                    outcome.host_lag_ns = max(outcome.host_lag_ns, waited_ns)
                outbox.add(outcome)
                self._done(job, outcome)
            for write in self._stops(self._timeouts.all_back()):
                exchange.send("command", write)
                outbox.add(exchange.gather())
        finally:
            self._exchange = None
            outbox.release_all()

    def _state(self, outcome: Outcome) -> None:
        """Publishes it, and takes notice of alerts in it."""
        self._reporter.state(outcome)
        # Before the first error byte there is none that could end.
        self._alerts = self._alerts or outcome.answers.has_errors
        if self._alerts:
            self._schedule.heard(outcome.answers)
        if outcome.instruction in self._gyros and not outcome.answers.missing:
            self._sense(outcome)

    def _sense(self, outcome: Outcome) -> None:
        """A gyro has answered."""
        gyro, publisher = self._gyros[outcome.instruction]
        # As with servos, the values are of the time at which the request had arrived.
        stamp = self._node.clock.stamp_ns(outcome.sent_ns)
        try:
            (status,) = outcome.answers.statuses
            publisher.put(gyro.sample(status.parameters, stamp, outcome.late_ns / 1e9))
        except Refused as refusal:
            self._reporter.refused("gyro", refusal)

    def _look(self) -> None:
        if self._exchange is None:
            return
        self._exchange.port.wait(0)  # raises if it is gone
        self._reporter.statistics.fast_sync_read = self._schedule.fast
        self._reporter.statistics.overruns = self._exchange.port.overruns()

    def _done(self, job: Job, outcome: Outcome) -> None:
        self._schedule.done(job, outcome.answers, outcome.begin_ns, outcome.ended_ns)
        if job.stage is Stage.PING:
            self._identify(self._roster.members[job.ids[0]])
        elif job.stage in _OF_A_CYCLE:
            if self._schedule.cycles != self._cycle:
                if self._cycle:
                    self._reporter.cycle(self._cycle_end_ns - self._cycle_begin_ns)
                self._cycle = self._schedule.cycles
                self._cycle_begin_ns = outcome.begin_ns
            self._cycle_end_ns = outcome.ended_ns

    def _identify(self, member: Member) -> None:
        """Takes notice of a servo that is not what it was taken for."""
        if self._models.get(member.id) == member.model_number:
            return
        self._models[member.id] = member.model_number
        self._reporter.decoder.forget()
        if member.model_number != member.configured.number:
            logger.warning(
                "servo %d says it is model %d, configured is %s; its own word counts",
                member.id,
                member.model_number,
                member.configured.name,
            )

    def _command(self, command: BusCommand) -> None:
        if self._exchange is None:
            self._reporter.refused("command", Refused("port not open", self._config.port))
            return
        try:
            instructions = writes(command.goals, self._roster)
            self._timeouts.commanded(command, monotonic_ns())
        except Refused as refusal:
            self._reporter.refused("command", refusal)
            raise Rejected(str(refusal)) from refusal  # so that health tells it, too
        self._schedule.command(instructions)
        self._reporter.statistics.commands += 1

    def _take_back(self, now_ns: int) -> None:
        """Stops what nobody commands any more."""
        goals = self._timeouts.taken_back(now_ns)
        self._schedule.command(self._stops(goals))
        if not self._reporter.statistics.timed_out:  # the statistics count the others
            ids = sorted({goal.id for goal in goals})
            logger.warning("servos %s are stopped: no command has come in time", ids)
        self._reporter.statistics.timed_out = self._timeouts.count

    def _stops(self, goals: list[ServoGoal]) -> list[bytes]:
        try:
            return writes(goals, self._roster) if goals else []
        except Refused as refusal:  # a servo has turned out to be a model that has no such goal
            self._reporter.refused("command", refusal)
            return []

    def _request(self, request: BusRequest) -> BusReply:
        """Runs between two transactions: the node's handlers are only called there."""
        self._outbox.release_all()
        now = self._node.clock.now_ns()
        try:
            if self._exchange is None:
                raise Refused("port not open", self._config.port)
            management = Management(self._exchange, self._roster, self._reporter.publish)
            return management.carry_out(request, now)
        except Refused as refusal:
            self._reporter.refused("request", refusal)
            return BusReply(stamp=now, ok=False, text=str(refusal))
        except PortLost as lost:
            logger.warning("request: %s", lost)
            return BusReply(stamp=now, ok=False, text=str(lost))
