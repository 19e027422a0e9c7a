"""The classifier of one bus: one transaction in, fault reports out.

A transaction that is as it should be is parsed, counted, and that is all, also while something else
is wrong; what follows from it for each servo is made up for when it matters. Only what is news is
looked at closely and concluded from at once; what time alone brings is concluded every 50 ms. Time
is the stamps of the transactions, so a recording gives the same reports as the robot.
"""

from wackel_classifier.adapter_lag import HELD_NS, AdapterLag
from wackel_classifier.alerts import CRC_ERROR, Alerts
from wackel_classifier.chain import Chain
from wackel_classifier.duplicates import Duplicates
from wackel_classifier.explanations import explain
from wackel_classifier.findings import Book, Finding
from wackel_classifier.frozen import Frozen
from wackel_classifier.host_lag import SPOILS_NS
from wackel_classifier.jammers import Jammers
from wackel_classifier.lags import LATE_NS
from wackel_classifier.loose_contact import Event, Mark
from wackel_classifier.losses import Losses
from wackel_classifier.reach import Reach
from wackel_classifier.requests import Field, Request, Requests
from wackel_classifier.strangers import Strangers
from wackel_classifier.supply import Supply
from wackel_classifier.symptoms import BITS_PER_BYTE, Outcome, Sign, Symptoms, examine
from wackel_classifier.timing import Timing
from wackel_node.config import BusConfig, ClassifierConfig
from wackel_protocols.dynamixel2.answers import Answers, Status
from wackel_protocols.dynamixel2.packet import (
    ALERT,
    MAX_ID,
    PREFIX_BYTES,
    STATUS_BYTES,
    Instruction,
    InstructionPacket,
)
from wackel_schemas.bus import Transaction
from wackel_schemas.fault import FaultReport

LONGEST_PAUSE_NS = 10_000_000_000
"""A longer pause, or a step of the clock, counts as so much: windows survive both."""
UNWATCHED_NS = 1_000_000_000
"""In so long a pause the adapter may have been connected with another chain."""
JAMMED_LOSS = 0.6
JAMMED_SINGLE_LOSS = 0.1
"""Share of answers that a permanent jammer destroys of reads of many and of single ones (thesis,
2.5.5: 55 % of a broadcast ping, 4.8 % of direct pings), rounded up."""
CONCLUDE_NS = 50_000_000
"""How often time alone is looked at: a tenth of the shortest period that anything waits for."""
LEAST_SLOT_NS = 5_000_000
"""Shortest sampling period, whatever the configuration says."""
TICK_SLOTS = 10
"""What changes slowly (usual response times) is worked out every so many slots."""
_SYNC_WRITE = bytes((Instruction.SYNC_WRITE,))


class BusClassifier:
    """Diagnoses one bus.

    Args:
        bus: Its name.
        config: Servos in cable order, and where supply enters.
        limits: Thresholds.
    """

    def __init__(self, bus: str, config: BusConfig, limits: ClassifierConfig) -> None:
        chain = self._chain = Chain(bus, config)
        self._requests = Requests(chain, config.servos)
        models = self._requests.models
        series = [model.series for model in models]
        self._reach = Reach(chain)
        self._jammers = Jammers(bus)
        self._losses = Losses(chain, limits)
        self._timing = Timing(chain, config.return_delay_us)
        self._adapter_lag = AdapterLag(bus)
        self._alerts = Alerts(chain, series)
        self._supply = Supply(chain, config.nominal_voltage)
        self._frozen = Frozen(chain, models)
        self._strangers = Strangers(chain)
        self._duplicates = Duplicates(chain)
        self._book = Book()
        self._stamp: int | None = None
        self._now_ns = 0
        slot_ns = int(1e9 / limits.loose_contact.sample_hz)
        self._slot_ns = min(max(slot_ns, LEAST_SLOT_NS), LONGEST_PAUSE_NS)
        self._slot_end_ns = self._slot_ns
        self._slot = 0
        self._conclude_ns = 0  # the next conclusion, if nothing happens before
        self._attention = 0  # whose answers are news; bits as in Request.concerns
        self._counting: list[Request] = []  # those with clean answers that are not yet made up for
        self._goals_due = True  # goals are looked at once a slot
        self._disturbers: set[str] = set()  # components whose traces are no fault of others
        self._jammed_ns = -1  # when a permanent jammer was last there
        self._incomplete = False  # whether the last transaction missed an answer
        self._late = False  # whether it had an answer to an earlier one
        self._missed: list[int] = []  # positions, in the last transaction that missed any
        self._heard: Transaction | None = None  # the last in which servos spoke, or should have
        self._devices: set[int] = set()  # ids outside the chain that somebody asks on purpose

    def active(self) -> list[FaultReport]:
        """The faults that are active, in the order in which they began."""
        return self._book.active()

    def step(self, transaction: Transaction) -> list[FaultReport]:
        """Takes in the next transaction.

        Returns:
            Faults that begin, change their suspects, or are healed; usually none. Their boot and
            seq are 0: who publishes them numbers them.
        """
        stamp = transaction.stamp
        if self._stamp is not None:
            pause_ns = min(max(stamp - self._stamp, 0), LONGEST_PAUSE_NS)
            self._now_ns += pause_ns
            if pause_ns >= UNWATCHED_NS:
                self._timing.unwatched()
        self._stamp = stamp
        instruction = transaction.instruction
        request = self._requests.find(instruction, transaction.expected)
        if request is None:
            request = self._new_request(instruction, transaction.expected)
        data = transaction.received()
        self._timing.host.waits += request.many
        quiet = True
        if data or transaction.expected:
            self._heard = transaction
            answers = request.reader.read(data)
            if transaction.late_ns >= HELD_NS and data and answers.clean:
                self._adapter_lag.late(transaction, self._now_ns, incomplete=self._incomplete)
            if (
                answers.segments is None
                and not request.concerns & self._attention
                and not request.has_new_errors(data, self._alerts.alerting)
            ):
                if not request.clean:
                    self._counting.append(request)
                request.clean += 1
                request.clean_ns = self._now_ns
                self._incomplete = self._late = False
                if request.has_contents(self._slot):
                    quiet = not self._contents(transaction, request, answers)
            else:
                quiet = not self._look(transaction, request, answers, data)
        elif self._goals_due and instruction[PREFIX_BYTES : PREFIX_BYTES + 1] == _SYNC_WRITE:
            self._goals_due = not self._frozen.command(instruction)
        lag_ns = transaction.host_lag_ns
        if lag_ns >= SPOILS_NS:
            self._timing.host.overslept(lag_ns, self._now_ns, stamp, many=request.many)
            quiet = quiet and lag_ns < LATE_NS
        if self._now_ns >= self._slot_end_ns:
            self._end_slot()
        elif quiet and self._now_ns < self._conclude_ns:
            return []
        return self._conclude(transaction)

    def _absolve(self, findings: list[Finding]) -> None:
        """What jammers and doubled ids did until they were known is no fault of a cable's."""
        if findings or self._disturbers:
            for finding in findings:
                if finding.component not in self._disturbers:
                    self._losses.explained(finding.since)
            self._disturbers = {finding.component for finding in findings}

    def _new_request(self, instruction: bytes, expected: list[int]) -> Request:
        if self._requests.full:
            self._make_up()
            self._requests.forget()
        request = self._requests.make(instruction, expected)
        if not request.expectation.broadcast_ping:
            # Strangers may name any number; only so many are ids.
            others = (i for i in expected if i not in self._chain.position)
            self._devices.update(i for i in others if 0 <= i <= MAX_ID)
        return request

    # A closer look.

    def _look(
        self, transaction: Transaction, request: Request, answers: Answers, data: bytes
    ) -> bool:
        """At a transaction that is not as it should be, or that somebody waits for.

        Returns:
            Whether there may be something to conclude at once: a jammer goes on as it was.
        """
        self._make_up()
        stamp, now_ns = transaction.stamp, self._now_ns
        window_ns = transaction.ended_ns - transaction.sent_ns
        capacity = window_ns * transaction.baud_rate // (BITS_PER_BYTE * 1_000_000_000)
        symptoms = examine(request.expectation, answers, data, capacity)
        before = self._jammers.findings()
        if answers.clean:
            self._jammers.clean()
        else:
            self._jammers.step(symptoms, stamp)
        news = bool(answers.unexpected) or before != self._jammers.findings()
        jammed = self._jammers.permanent is not None or symptoms.sign is Sign.SATURATED
        late_ids = [s.id for s in answers.unexpected if self._is_late(s.id, request)]
        late = bool(late_ids)
        self._adapter_lag.look(
            transaction,
            data,
            now_ns,
            late=late,
            incomplete=self._incomplete,
            present=not all(map(self._reach.gone, request.positions)),
        )
        self._hear_late(late_ids, stamp)
        # Bytes of nobody are a jammer's, or of answers that come late and collide with others.
        known = jammed or late or self._late or self._jammers.rhythmic is not None
        self._late = late
        missed, new, wrecked = self._hear(request, symptoms, stamp, jammed=jammed, known=known)
        news = news or new
        if jammed:
            self._jammed_ns = now_ns
            self._losses.reset()
        self._foreign(transaction, request, answers, symptoms, explained=known or wrecked)
        self._missed = missed or self._missed
        self._incomplete = bool(answers.missing)
        if not answers.clean or request.has_new_errors(data, self._alerts.alerting):
            self._error_bytes(request, answers, stamp)
            if answers.clean:
                news = True
                request.learn_errors(data)
        news |= self._contents(transaction, request, answers)
        return news or not (answers.clean or jammed or symptoms.rhythmic)

    def _hear(
        self,
        request: Request,
        symptoms: Symptoms,
        stamp: int,
        *,
        jammed: bool,
        known: bool,
    ) -> tuple[list[int], bool, bool]:
        """Who was heard in a transaction and who was not.

        Args:
            request: Whose answers they are.
            symptoms: Of the transaction.
            stamp: Of the transaction.
            jammed: Whether answers were destroyed by a permanent jammer.
            known: Whether it is known whose the bytes of nobody are.

        Returns:
            Positions of those that were silent, whether there is news of any servo, and whether one
            more answer of a servo has come as a wreck.
        """
        now_ns, reach, duplicates = self._now_ns, self._reach, self._duplicates
        waiting = reach.waiting | self._losses.waiting
        heard: list[int] = []
        missed: list[int] = []
        news = wrecked = False
        outcomes = symptoms.outcomes
        for place, outcome in enumerate(outcomes):
            position = request.places[place]
            if position is None:
                continue
            if outcome is Outcome.ANSWERED:
                duplicates.intact(position, values=request.has_motion)
                if waiting >> position & 1:
                    news = True
                    reach.heard(heard, now_ns)
                    self._answered(position, stamp)
                else:
                    heard.append(position)
                continue
            # Those that follow one that was not heard share its fate.
            first = not place or outcomes[place - 1] is Outcome.ANSWERED
            event, again = None, False
            if first and not jammed and outcome is not Outcome.UNTESTED:
                event = _event(position, place, symptoms, known=known)
                if event.mark is Mark.QUIET:
                    duplicates.silent(position)
                elif event.mark is not Mark.TORN and not request.expectation.broadcast_ping:
                    again = duplicates.wreck(position, stamp)
                    wrecked = wrecked or again
            if outcome is Outcome.SILENT and not again:
                reach.missed(position, now_ns, stamp, self._chance(request))
                missed.append(position)
            else:
                reach.asked(position, now_ns, stamp)
            if outcome is Outcome.UNTESTED:
                continue
            news = True
            if event is not None and not again:
                spoken = outcome is Outcome.LOST or event.mark is Mark.DAMAGED
                # What collides once a stalled adapter goes on is damaged by no cable.
                if not (spoken and self._adapter_lag.excuses(now_ns)):
                    self._losses.failed(event, stamp, spoken=spoken)
        reach.heard(heard, now_ns)
        self._losses.succeeded(heard)
        return missed, news, wrecked

    def _error_bytes(self, request: Request, answers: Answers, stamp: int) -> None:
        alerting = self._alerts.alerting
        for status in answers.statuses:
            position = self._chain.position.get(status.id)
            if position is not None and (status.error or alerting >> position & 1):
                self._alerts.error_byte(position, status.error, self._now_ns, stamp)
                if status.error & ~ALERT == CRC_ERROR:
                    event = Event(position, Mark.DAMAGED, None, len(request.expected) == 1, False)
                    self._losses.failed(event, stamp, spoken=True)

    def _chance(self, request: Request) -> float:
        """Probability that an answer does not come although the servo sends it."""
        if self._jammers.permanent is None:
            return self._losses.share
        return JAMMED_LOSS if request.single is None else JAMMED_SINGLE_LOSS

    def _hear_late(self, late_ids: list[int], stamp: int) -> None:
        """Servos have answered earlier requests, after which the host had given up."""
        for servo_id in late_ids:
            position = self._chain.position[servo_id]
            self._answered(position, stamp)
            if position in self._missed:
                self._timing.late_answer(position, self._now_ns, stamp)

    def _is_late(self, servo_id: int, request: Request) -> bool:
        """Whether an answer that is one too many is that to an earlier request."""
        return servo_id in self._chain.position and (
            servo_id not in request.asked or self._incomplete
        )

    def _answered(self, position: int, stamp: int) -> None:
        """One that was waited for has answered."""
        gone = self._reach.gone(position)
        now_ns = self._now_ns
        held = self._adapter_lag.excuses(now_ns)  # it was connected all the time
        self._reach.answered(position, now_ns)
        interruption, self._reach.interrupted = self._reach.interrupted, None
        # What began while a jammer was there is its doing.
        began_ns = now_ns - (interruption.lasted_ns if interruption is not None else 0)
        if interruption is not None and not held and began_ns > self._jammed_ns:
            self._losses.interrupted(interruption, stamp)
        self._losses.recovered(position, stamp, passing=not (gone or held))
        self._losses.succeeded((position,))

    def _foreign(
        self,
        transaction: Transaction,
        request: Request,
        answers: Answers,
        symptoms: Symptoms,
        *,
        explained: bool,
    ) -> None:
        """What nobody asked for; ``explained`` if it is known who sends bytes of nobody."""
        stamp, now_ns = transaction.stamp, self._now_ns
        for status in answers.unexpected:
            late = status.id in self._devices or self._is_late(status.id, request)
            if self._chain.ids and not late:
                self._strangers.servo(status.id, now_ns, stamp)
        if any(isinstance(s.packet, InstructionPacket) for s in answers.segments or ()):
            self._strangers.master(now_ns, stamp)
        if explained or symptoms.rhythmic or answers.unexpected:
            return
        if symptoms.stray or symptoms.broken:
            self._strangers.unexplained(now_ns, stamp)
        # Bytes that come after something was missing may be what was missing.
        if symptoms.stray and not self._incomplete:
            self._losses.stray(now_ns, stamp)

    def _contents(self, transaction: Transaction, request: Request, answers: Answers) -> bool:
        """What intact answers say; whether that is news."""
        stamp, now_ns = transaction.stamp, self._now_ns
        times = transaction.response_times
        single = request.single
        on_time = transaction.host_lag_ns < SPOILS_NS
        if single is not None and times and answers.clean and on_time:
            size = STATUS_BYTES + len(answers.statuses[0].parameters)
            self._timing.response(single, times[-1].ns, size, transaction.baud_rate, now_ns, stamp)
        look_at_motion = request.is_motion_due(self._slot)
        if look_at_motion:
            request.slot = self._slot
        elif not request.has_fields:
            return False
        news = False
        for status in answers.statuses:
            asked = request.asked.get(status.id)
            if asked is None or asked.position is None:
                continue
            for field in asked.fields:
                news |= self._register(asked.position, field, status, stamp)
            if look_at_motion and asked.motion is not None:
                start, end = asked.motion
                if len(status.parameters) >= end:
                    velocity = asked.velocity_of(status.parameters)
                    self._frozen.values(
                        asked.position, status.parameters[start:end], velocity, now_ns, stamp
                    )
        return news

    def _register(self, position: int, field: Field, status: Status, stamp: int) -> bool:
        """A watched register was read; whether it says that a servo is in trouble, or no longer."""
        data = status.parameters[field.start : field.end]
        register = field.register
        if len(data) != register.length:
            return False
        raw = register.decode(data)
        match register.name:
            case "return_delay_time":
                self._timing.register(position, raw, stamp)
            case "hardware_error_status":
                return self._alerts.hardware_error(position, raw, self._now_ns, stamp)
            case "present_input_voltage":
                self._supply.voltage(position, register.to_si(raw), self._now_ns, stamp)
            case "torque_enable":
                self._frozen.torque(position, bool(raw))
        return False

    # Slots.

    def _make_up(self) -> None:
        """For the clean answers that were only counted."""
        for request in self._counting:
            self._losses.succeeded(request.positions, request.clean)
            self._reach.heard(request.positions, request.clean_ns)
            request.clean = 0
        self._counting.clear()

    def _end_slot(self) -> None:
        self._make_up()
        self._losses.end_slot()
        self._slot += 1
        if self._slot % TICK_SLOTS == 0:
            self._timing.tick()
        self._slot_end_ns = self._now_ns + self._slot_ns
        self._goals_due = True

    def _conclude(self, transaction: Transaction) -> list[FaultReport]:
        """What has changed with this transaction; of one that nobody answers, nothing is seen."""
        now_ns, stamp = self._now_ns, transaction.stamp
        jammers, reach = self._jammers, self._reach
        if reach.waiting or reach.unheard:
            self._make_up()
        findings = jammers.findings() + self._duplicates.findings()
        self._absolve(findings)
        findings += reach.findings(now_ns, jammed=jammers.permanent is not None)
        for position in reach.take_newly_gone():
            self._alerts.gone(position)
            self._supply.gone(position)
            self._timing.gone(position)
            self._frozen.gone(position)
        if jammers.permanent is None:
            findings += self._losses.findings(now_ns, stalls=self._adapter_lag.stalls)
        findings += self._timing.findings(now_ns, stamp)
        findings += self._adapter_lag.findings(now_ns)
        findings += self._alerts.findings(now_ns, self._supply.settled_ns)
        alerts = self._alerts
        findings += self._supply.findings(alerts.complaining(), alerts.undervoltage(), stamp)
        findings += self._frozen.findings(self._alerts)
        if findings:
            self._strangers.explained()
        findings += self._strangers.findings(now_ns)
        if findings:
            findings = explain(findings, self._chain, stamp)
        reports = self._book.update(stamp, findings, self._heard or transaction)
        self._conclude_ns = min(now_ns + CONCLUDE_NS, reach.due_ns)
        self._attention = reach.waiting | reach.unheard | self._losses.waiting
        self._attention |= self._duplicates.suspected
        if jammers.suspicious:
            self._attention |= 1 << len(self._chain)
        return reports


def _event(position: int, place: int, symptoms: Symptoms, *, known: bool) -> Event:
    """A failure as the statistics see it; ``place`` is the servo's in the request.

    Bytes of nobody that are ``known`` to be another's are no trace of it.
    """
    outcomes = symptoms.outcomes
    mark = Mark.DAMAGED if outcomes[place] is Outcome.DAMAGED else Mark.QUIET
    if not known and all(outcome is Outcome.ANSWERED for outcome in outcomes[:place]):
        # Bytes of nobody belong to the first failure.
        if symptoms.stray:
            mark = Mark.SPARK
        elif symptoms.broken:
            mark = Mark.TORN
    run = None
    if place + 1 < len(outcomes):
        behind = outcomes[place + 1]
        # Behind one that was lost others have spoken, also where that cannot be checked.
        lost = outcomes[place] is Outcome.LOST
        run = behind is Outcome.LOST if lost else behind is not Outcome.ANSWERED
    alone = len(outcomes) == 1
    return Event(position, mark, run, alone, not alone and Outcome.ANSWERED not in outcomes)
