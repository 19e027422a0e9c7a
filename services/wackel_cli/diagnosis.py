"""The diagnosis of a recording: the cores in one process, fed with what was recorded.

No clock and no Zenoh: two runs over one recording give the same messages, byte for byte.
"""

from collections.abc import Iterable, Iterator

from wackel_classifier.core import BusClassifier
from wackel_node.config import RobotConfig
from wackel_recording.reader import Entry
from wackel_schemas import wire
from wackel_schemas.bus import BusState, Transaction
from wackel_schemas.drive import ImuSample, Odometry, TwistCommand
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Heartbeat
from wackel_schemas.keys import (
    ALIVE,
    FAULT,
    IMU,
    STATE,
    TRANSACTION,
    TWIST_COMMAND,
    chunk_of,
    topic_of,
)
from wackel_schemas.message import Message

CLASSIFIER, ODOMETRY, DIAGNOSER = "classifier", "odometry", "diagnoser"
SOURCES = (CLASSIFIER, ODOMETRY, DIAGNOSER)
"""The services that are run anew, by the names under which they report faults."""
_OF_DRIVE = (STATE, IMU, TWIST_COMMAND)
_ON_ITS_WAY_NS = 1_000_000_000


class Diagnosis:
    """One recording, diagnosed anew.

    Attributes:
        reports: What each source concluded, with the recorded time of arrival, ns, of the message
            that it follows from.
        live: What each live source concluded in the recording, without repetitions.
        heartbeats: The first heartbeat of each start of each live source.
        transactions: How many there were.
        odometry: The last one; absent where the robot has no wheels.
        skipped: For each key, how many of its messages were not used, and why the first was not.
        first_ns: Stamp of the first transaction or state; absent before it.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.reports: dict[str, list[tuple[int, FaultReport]]] = {name: [] for name in SOURCES}
        self.live: dict[str, list[FaultReport]] = {name: [] for name in SOURCES}
        self.heartbeats: dict[str, dict[int, Heartbeat]] = {name: {} for name in SOURCES}
        self.transactions = 0
        self.odometry: Odometry | None = None
        self.skipped: dict[str, tuple[int, str]] = {}
        self.first_ns: int | None = None
        self._begin_ns: int | None = None
        self._end_ns = 0
        self._classifiers = {
            name: BusClassifier(name, bus, config.classifier) for name, bus in config.buses.items()
        }
        self._drive = None
        if config.drive is not None:
            from wackel_cli.drive_diagnosis import DriveDiagnosis

            self._drive = DriveDiagnosis(config.drive, config.gyros)

    def wants(self, key: str) -> bool:
        """Whether :meth:`run` uses messages of a key."""
        topic = topic_of(key)
        if topic is FAULT:
            return chunk_of(topic, key, "source") in SOURCES
        if topic is ALIVE:
            return chunk_of(topic, key, "service") in SOURCES
        return topic is TRANSACTION or (topic in _OF_DRIVE and self._drive is not None)

    def run(self, entries: Iterable[Entry]) -> Iterator[FaultReport | Odometry]:
        """Takes in all of them; yields what follows from each as soon as it is concluded."""
        for key, arrived_ns, _, payload in entries:
            self._begin_ns = arrived_ns if self._begin_ns is None else self._begin_ns
            self._end_ns = arrived_ns
            try:
                for source, message in self._conclude(key, payload):
                    if isinstance(message, FaultReport):
                        self.reports[source].append((arrived_ns, message))
                        yield message
                    elif isinstance(message, Odometry):
                        self.odometry = message
                        yield message
            except wire.Rejected as error:
                self._skip(key, str(error))

    @property
    def span_ns(self) -> int:
        """From the arrival of the first message to that of the last."""
        return 0 if self._begin_ns is None else self._end_ns - self._begin_ns

    def reports_heard(self, source: str) -> list[FaultReport]:
        """The reports that a recorder could have heard from a live source.

        What was concluded at the very end may have been on its way when the recording ended: it
        counts only if the live report is there.
        """
        arrived = {(r.code, r.component, r.status, r.stamp) for r in self.live[source]}
        return [
            r
            for at_ns, r in self.reports[source]
            if at_ns < self._end_ns - _ON_ITS_WAY_NS
            or (r.code, r.component, r.status, r.stamp) in arrived
        ]

    def _conclude(self, key: str, payload: bytes) -> Iterator[tuple[str, Message]]:
        """What follows from a message, each with its source.

        Raises:
            wire.Rejected: The message cannot be used.
        """
        topic = topic_of(key)
        if topic is TRANSACTION:
            transaction = wire.decode(payload, Transaction)
            self.transactions += 1
            self._began(transaction.stamp)
            classifier = self._classifiers.get(chunk_of(topic, key, "bus"))
            if classifier is None:
                raise wire.Rejected("the configuration has no such bus")
            for report in classifier.step(transaction):
                yield CLASSIFIER, report
        elif topic is STATE and self._drive is not None:
            state = wire.decode(payload, BusState)
            self._began(state.stamp)
            yield from self._drive.bus_state(chunk_of(topic, key, "bus"), state)
        elif topic is IMU and self._drive is not None:
            sample = wire.decode(payload, ImuSample)
            yield from self._drive.imu(chunk_of(topic, key, "name"), sample)
        elif topic is TWIST_COMMAND and self._drive is not None:
            self._drive.command(wire.decode(payload, TwistCommand))
        elif topic is FAULT:
            report = wire.decode(payload, FaultReport)
            if not report.repeated:
                self.live[chunk_of(topic, key, "source")].append(report)
        elif topic is ALIVE:
            heartbeat = wire.decode(payload, Heartbeat)
            boots = self.heartbeats[chunk_of(topic, key, "service")]
            boots.setdefault(heartbeat.boot, heartbeat)

    def _began(self, stamp: int) -> None:
        if self.first_ns is None:
            self.first_ns = stamp

    def _skip(self, key: str, reason: str) -> None:
        count, first_reason = self.skipped.get(key, (0, reason))
        self.skipped[key] = (count + 1, first_reason)
