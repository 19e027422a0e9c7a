"""The diagnosis of a recording: the cores in one process, fed with what was recorded.

No clock and no Zenoh: two runs over one recording give the same reports, byte for byte.
"""

from collections.abc import Iterable, Iterator

from wackel_classifier.core import BusClassifier
from wackel_node.config import RobotConfig
from wackel_recording.reader import Entry
from wackel_schemas import wire
from wackel_schemas.bus import Transaction
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Heartbeat
from wackel_schemas.keys import ALIVE, FAULT, TRANSACTION, chunk_of, topic_of

CLASSIFIER = "classifier"
_ON_ITS_WAY_NS = 1_000_000_000


class Diagnosis:
    """One recording, diagnosed anew.

    Attributes:
        reports: What was concluded, each with the recorded time of arrival, ns, of the
            transaction that it follows from.
        live: What the live classifier concluded in the recording, without repetitions.
        heartbeats: The first heartbeat of each start of the live classifier.
        transactions: How many there were.
        skipped: For each key, how many of its messages were not used, and why the first was not.
        first_ns: Stamp of the first transaction; absent before it.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.reports: list[tuple[int, FaultReport]] = []
        self.live: list[FaultReport] = []
        self.heartbeats: dict[int, Heartbeat] = {}
        self.transactions = 0
        self.skipped: dict[str, tuple[int, str]] = {}
        self.first_ns: int | None = None
        self._begin_ns: int | None = None
        self._end_ns = 0
        self._classifiers = {
            name: BusClassifier(name, bus, config.classifier) for name, bus in config.buses.items()
        }

    @staticmethod
    def wants(key: str) -> bool:
        """Whether :meth:`run` uses messages of a key."""
        topic = topic_of(key)
        if topic is FAULT:
            return chunk_of(topic, key, "source") == CLASSIFIER
        if topic is ALIVE:
            return chunk_of(topic, key, "service") == CLASSIFIER
        return topic is TRANSACTION

    def run(self, entries: Iterable[Entry]) -> Iterator[FaultReport]:
        """Takes in all of them; yields each report as soon as it is concluded."""
        for key, arrived_ns, _, payload in entries:
            self._begin_ns = arrived_ns if self._begin_ns is None else self._begin_ns
            self._end_ns = arrived_ns
            topic = topic_of(key)
            try:
                if topic is TRANSACTION:
                    yield from self._diagnose(key, arrived_ns, wire.decode(payload, Transaction))
                elif topic is FAULT:
                    report = wire.decode(payload, FaultReport)
                    if not report.repeated:
                        self.live.append(report)
                elif topic is ALIVE:
                    heartbeat = wire.decode(payload, Heartbeat)
                    self.heartbeats.setdefault(heartbeat.boot, heartbeat)
            except wire.Rejected as error:
                self._skip(key, str(error))

    @property
    def span_ns(self) -> int:
        """From the arrival of the first message to that of the last."""
        return 0 if self._begin_ns is None else self._end_ns - self._begin_ns

    def reports_heard(self) -> list[FaultReport]:
        """The reports that a recorder could have heard from the live classifier.

        What was concluded at the very end may have been on its way when the recording ended: it
        counts only if the live report is there.
        """
        arrived = {(r.code, r.component, r.status, r.stamp) for r in self.live}
        return [
            r
            for at_ns, r in self.reports
            if at_ns < self._end_ns - _ON_ITS_WAY_NS
            or (r.code, r.component, r.status, r.stamp) in arrived
        ]

    def _diagnose(
        self, key: str, arrived_ns: int, transaction: Transaction
    ) -> Iterator[FaultReport]:
        self.transactions += 1
        if self.first_ns is None:
            self.first_ns = transaction.stamp
        classifier = self._classifiers.get(chunk_of(TRANSACTION, key, "bus"))
        if classifier is None:
            self._skip(key, "the configuration has no such bus")
            return
        for report in classifier.step(transaction):
            self.reports.append((arrived_ns, report))
            yield report

    def _skip(self, key: str, reason: str) -> None:
        count, first_reason = self.skipped.get(key, (0, reason))
        self.skipped[key] = (count + 1, first_reason)
