"""Publishes what a mode finds on its bus: transactions, state, statistics, the adapter's fault."""

from time import monotonic_ns

from wackel_gateway.commands import Refused
from wackel_gateway.decode import Decoder
from wackel_gateway.outcome import Outcome
from wackel_gateway.roster import Roster
from wackel_gateway.statistics import Counters
from wackel_node.absence import Absence
from wackel_node.config import BusConfig
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_schemas import component, keys
from wackel_schemas.bus import BusState, BusStatistics, Transaction
from wackel_schemas.fault import FaultReport

_PERIOD_S = 1.0
_QUIET_PERIODS = 3  # control software that restarts is back before that


class Reporter:
    """The publishing side of a gateway.

    Attributes:
        statistics: The counters that are published once a second.
        roster: The servos.
        decoder: What turns answers into state.
    """

    def __init__(self, node: Node, bus: str, config: BusConfig, roster: Roster) -> None:
        self._node = node
        self.roster = roster
        self.decoder = Decoder(roster)
        self.statistics = BusStatistics(
            stamp=node.clock.now_ns(),
            mode=config.mode,
            port=config.port,
            connected=False,
            baud_rate=config.baud_rate,
        )
        self._counters = Counters(self.statistics, config.ids(), monotonic_ns())
        self._fault = Absence("adapter_unplugged", component.adapter(bus), config.port)
        self._quiet = Absence("bus_quiet", component.bus(bus), config.port)
        self._quiet_periods = 0
        self._heard = 0
        self._transactions = node.publisher(keys.TRANSACTION, bus=bus)
        self._states = node.publisher(keys.STATE, bus=bus)
        self._statistics = node.publisher(keys.STATISTICS, bus=bus)
        self._faults = node.publisher(keys.FAULT, source=f"gateway-{bus}")
        node.every(_PERIOD_S, self._once_a_period)

    def publish(self, outcome: Outcome) -> Transaction:
        """One transaction and what the servos said in it."""
        # One right after the other: Zenoh then sends both in one go.
        transaction = self.transaction(outcome)
        self.state(outcome)
        return transaction

    def transaction(self, outcome: Outcome) -> Transaction:
        """The bytes and their times."""
        self._counters.count(outcome)
        transaction = outcome.message(self._node.clock.stamp_ns(0))
        self._transactions.put(transaction)
        return transaction

    def state(self, outcome: Outcome) -> None:
        """What the servos said, if they said anything of themselves."""
        servos = self.decoder.states(outcome.instruction, outcome.answers)
        if servos:
            # The values are of the time at which the request had reached all servos.
            stamp = self._node.clock.stamp_ns(outcome.sent_ns)
            self._states.put(
                BusState(
                    stamp=stamp,
                    servos=servos,
                    late_s=outcome.late_ns / 1e9,
                    asked_again=outcome.asked_again,
                )
            )

    def cycle(self, took_ns: int) -> None:
        """A cycle's reads took so long."""
        self._counters.cycle(took_ns)

    def refused(self, what: str, refusal: Refused) -> None:
        """A command or request was not carried out: counted, and logged once for each reason."""
        if refusal.reason not in self.statistics.rejected:
            logger.warning("%s refused: %s", what, refusal)
        self._counters.refused(refusal.reason)

    def connected(self, baud_rate: int, latency_timer_ms: int | None) -> None:
        """The port is open."""
        statistics = self.statistics
        if self._fault.active:
            statistics.reconnects += 1
        statistics.connected = True
        statistics.baud_rate = baud_rate
        statistics.latency_timer_ms = latency_timer_ms
        logger.info("%s open at %d bit/s", statistics.port, baud_rate)
        self._report(self._fault.back(self._node.clock.now_ns()))

    def lost(self, reason: str) -> None:
        """The port is not there."""
        self.statistics.connected = False
        self._report(self._fault.lost(reason, self._node.clock.now_ns()))

    def _report(self, report: FaultReport | None) -> None:
        if report is None:
            return
        if not report.repeated:
            logger.warning("%s: %s", report.status, report.message)
        self._faults.put(report)

    def _once_a_period(self) -> None:
        stamp = self._node.clock.now_ns()
        self._statistics.put(self._counters.period(stamp, monotonic_ns()))
        self._report(self._fault.again(stamp))
        if self.statistics.mode != "poll":
            self._look_for_a_master(stamp)

    def _look_for_a_master(self, stamp: int) -> None:
        """Where others are to ask and nobody does, silence must not pass for health."""
        statistics = self.statistics
        idle = statistics.connected and statistics.transactions == self._heard
        self._heard = statistics.transactions
        self._quiet_periods = self._quiet_periods + 1 if idle else 0
        if not idle:
            self._report(self._quiet.back(stamp))
        elif self._quiet.active:
            self._report(self._quiet.again(stamp))
        elif self._quiet_periods >= _QUIET_PERIODS:
            self._report(self._quiet.lost("no traffic", stamp))
