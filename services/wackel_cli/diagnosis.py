"""The diagnosis of a recording: the cores in one process, fed with what was recorded.

No clock and no Zenoh: two runs over one recording give the same messages, byte for byte. Each core
gets what the live service had, in the same order; without a live service, what was recorded.
"""

from collections.abc import Callable, Iterable, Iterator

from wackel_cli.live_order import Input, LiveOrder, Restart
from wackel_cli.replayed import CLASSIFIER, DIAGNOSER, ODOMETRY, Replayed, ReplayedClassifier
from wackel_node.config import RobotConfig
from wackel_recording.reader import Entry
from wackel_schemas import wire
from wackel_schemas.bus import BusState, Transaction
from wackel_schemas.drive import Exclusions, Odometry
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Heartbeat
from wackel_schemas.inputs import Inputs
from wackel_schemas.keys import ALIVE, EXCLUSIONS, FAULT, INPUTS, Topic, chunk_of, topic_of
from wackel_schemas.message import Message

# The diagnoser before the odometry, which obeys it.
SOURCES = (CLASSIFIER, DIAGNOSER, ODOMETRY)
"""The services that are run anew, by the names under which they report faults."""
_ON_ITS_WAY_NS = 1_000_000_000
_LOOK_NS = 100_000_000  # of arrivals, between two looks at what is due


class Service:
    """One service, run anew.

    Attributes:
        core: What concludes.
        order: Its inputs.
        reports: What it concluded, with the recorded time of arrival, ns, of the message that it
            follows from.
        live: What the live one concluded in the recording, without repetitions.
        seen: Whether a live one was recorded.
        exclusions: How many it has said since its start.
    """

    def __init__(self, create: Callable[[], Replayed]) -> None:
        self._create = create
        self.core = create()
        self.order = LiveOrder()
        self.reports: list[tuple[int, FaultReport]] = []
        self.live: list[FaultReport] = []
        self.seen = False
        self.exclusions = 0

    def restart(self) -> None:
        """Forgets everything that it knew."""
        self.core = self._create()
        self.exclusions = 0

    def notes(self) -> list[str]:
        """Why it may conclude what the live one did not, in words."""
        order = self.order
        notes = []
        if order.unknown or order.lost_words:
            notes.append("knew what the recording has not: it began later, or lost messages")
        if order.restarts:
            notes.append(f"was started anew {order.restarts} times and had to forget")
        if order.passed_over:
            notes.append(f"never got {order.passed_over} messages of the recording")
        return notes


class Diagnosis:
    """One recording, diagnosed anew.

    Attributes:
        services: By the names in :data:`SOURCES`; those of a drive only if the robot has one.
        transactions: How many there were.
        odometry: The last one; absent where the robot has no wheels.
        skipped: For each key, how many of its messages were not used, and why the first was not.
        first_ns: Stamp of the first transaction or state; absent before it.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.services = {CLASSIFIER: Service(lambda: ReplayedClassifier(config))}
        drive = config.drive
        if drive is not None:
            from wackel_cli.replayed_drive import ReplayedDiagnoser, ReplayedOdometry

            self.services[DIAGNOSER] = Service(lambda: ReplayedDiagnoser(drive, config.gyros))
            self.services[ODOMETRY] = Service(lambda: ReplayedOdometry(drive, config.gyros))
        self.transactions = 0
        self.odometry: Odometry | None = None
        self.skipped: dict[str, tuple[int, str]] = {}
        self.first_ns: int | None = None
        self._readers: dict[str, list[Service]] = {}  # by key
        self._recorded_exclusions: set[tuple[int, int]] = set()
        self._begin_ns: int | None = None
        self._end_ns = 0
        self._looked_ns = 0

    def wants(self, key: str) -> bool:
        """Whether :meth:`run` uses messages of a key."""
        topic = topic_of(key)
        if topic is FAULT:
            return chunk_of(topic, key, "source") in self.services
        if topic is ALIVE or topic is INPUTS:
            return chunk_of(topic, key, "service") in self.services
        return topic is not None and bool(self._takers(topic))

    def run(self, entries: Iterable[Entry]) -> Iterator[FaultReport | Odometry]:
        """Takes in all of them; yields what follows from them as soon as it is concluded."""
        for key, arrived_ns, _, payload in entries:
            self._begin_ns = arrived_ns if self._begin_ns is None else self._begin_ns
            self._end_ns = arrived_ns
            told = False
            try:
                told = self._add(key, arrived_ns, payload)
            except wire.Rejected as error:
                self._skip(key, str(error))
            if told or arrived_ns - self._looked_ns >= _LOOK_NS:
                self._looked_ns = arrived_ns
                for name, service in self.services.items():
                    yield from self._conclude(name, service.order.due(arrived_ns))
        for name, service in self.services.items():
            yield from self._conclude(name, service.order.rest())

    @property
    def span_ns(self) -> int:
        """From the arrival of the first message to that of the last."""
        return 0 if self._begin_ns is None else self._end_ns - self._begin_ns

    def reports_heard(self, source: str) -> list[FaultReport]:
        """The reports that a recorder could have heard from a live source.

        What was concluded at the very end may have been on its way when the recording ended: it
        counts only if the live report is there.
        """
        service = self.services[source]
        arrived = {(r.code, r.component, r.status, r.stamp) for r in service.live}
        return [
            r
            for at_ns, r in service.reports
            if at_ns < self._end_ns - _ON_ITS_WAY_NS
            or (r.code, r.component, r.status, r.stamp) in arrived
        ]

    def _takers(self, topic: Topic[Message]) -> list[Service]:
        return [each for each in self.services.values() if topic in each.core.topics]

    def _add(self, key: str, arrived_ns: int, payload: bytes) -> bool:
        """Takes in what was recorded; says whether it tells the order of what came before.

        Raises:
            wire.Rejected: The message cannot be used.
        """
        topic = topic_of(key)
        if topic is None:
            return False
        message = wire.decode(payload, topic.message)
        match message:
            case Transaction():  # most are
                self.transactions += 1
            case Inputs():
                service = self.services[chunk_of(topic, key, "service")]
                service.seen = True
                service.order.word(message, arrived_ns)
                return True
            case FaultReport():
                service = self.services[chunk_of(topic, key, "source")]
                service.seen = True
                if not message.repeated:
                    service.live.append(message)
                return False
            case Heartbeat():
                self.services[chunk_of(topic, key, "service")].seen = True
                return False
            case Exclusions():
                # Those that are concluded anew count; this tells when they were taken in.
                self._recorded_exclusions.add((message.boot, message.seq))
                return False
        if self.first_ns is None and isinstance(message, Transaction | BusState):
            self.first_ns = message.stamp
        readers = self._readers.get(key)
        if readers is None:
            readers = self._readers[key] = self._takers(topic)
        item = Input(key, message, arrived_ns)
        for service in readers:
            service.order.add(item)
        return False

    def _conclude(
        self, name: str, items: Iterable[Input | Restart]
    ) -> Iterator[FaultReport | Odometry]:
        service = self.services[name]
        for item in items:
            if isinstance(item, Restart):
                service.restart()
                continue
            try:
                for message in service.core.take(item.key, item.message):
                    match message:
                        case FaultReport():
                            service.reports.append((item.arrived_ns, message))
                            yield message
                        case Odometry():
                            self.odometry = message
                            yield message
                        case Exclusions():
                            self._exclude(service, message, item.arrived_ns)
            except wire.Rejected as error:
                self._skip(item.key, str(error))

    def _exclude(self, diagnoser: Service, exclusions: Exclusions, arrived_ns: int) -> None:
        """Odometry obeys when the live one did; if that had none such, at once."""
        odometry = self.services[ODOMETRY]
        exclusions.boot, exclusions.seq = diagnoser.order.boot or 0, diagnoser.exclusions
        diagnoser.exclusions += 1
        live = odometry.order.boot is not None
        if live and (exclusions.boot, exclusions.seq) not in self._recorded_exclusions:
            odometry.core.take(EXCLUSIONS.key(), exclusions)
        else:
            odometry.order.add(Input(EXCLUSIONS.key(), exclusions, arrived_ns))

    def _skip(self, key: str, reason: str) -> None:
        count, first_reason = self.skipped.get(key, (0, reason))
        self.skipped[key] = (count + 1, first_reason)
