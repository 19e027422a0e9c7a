"""Losses of all servos of a bus over time, and what they mean together.

A failure counts once its servo has answered again: before that it may be a break, which is another
matter (see ``reach``). Sequential tests decide whether there are more failures than are ordinary;
their places and traces decide why.
"""

import math
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import replace

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_classifier.loose_contact import Cause, Event, FailureWindow, Mark, Verdict, judge
from wackel_classifier.loss import LossTest, threshold, wilson
from wackel_classifier.reach import SAME_NS, Interruption
from wackel_node.config import ClassifierConfig
from wackel_schemas import component

COUNTED_IN_ROW = 2
"""Failures in a row of one servo that count in its rate: more of them are the same disturbance. For
cause and place only the first counts, since the others are asked because it failed."""
SPARKS = 2
"""Transactions with bytes of nobody that are told, and that together with as many failures convict
a contact at once: neither loss nor noise makes bytes, but one discharge may come from outside."""
STRAY_NS = 5_000_000_000
"""How long stray bytes are told after the last of them."""
STRAY_WAIT_NS = 3_000_000_000
"""How long they wait for an explanation: nine of ten contacts that throw any are named by then."""
RECONNECTS = 2
RECONNECTS_ALL = 3
"""So often a connection must be interrupted and come back within three windows to be loose; more
often where all servos are concerned and for long, since somebody may switch the supply off and on.
A spark counts for one."""
SPARK_WAIT_S = 0.5
"""How long a spark waits until it speaks for a contact that was interrupted: jammers and doubled
ids, which may have made it, are known by then."""
BY_HAND_NS = 1_500_000_000
"""Who unplugs a cable or switches the supply off and on takes longer, with the 0.4 s that servos
need to start anew."""
RESTART_NS = 500_000_000
"""Servos that had no supply start anew within 0.4 s, one by one, and fail until they are up."""
LIKELY = 0.9
"""Probability that a verdict needs without a statistical test."""
SURE = 0.95
"""Probability that another verdict needs to replace one that has been told."""
RETURNS = 4
"""A disconnection is one lump of failures, a moving cable may make many in one movement: what was
lost and was back so often is loose, however close together."""
CUTS = 4
CUTS_HOLD = 2
"""So often within a window must all from one servo on be silent while those before it answer, to be
told at once and to go on being told. Loss does not do that, only a servo that does not understand
an instruction: at one in ten thousand, and 1000 requests in a window, that is 0.1 for all servos
together, and four times at the same one of ten once in some hundred thousand hours."""
HIDDEN_STALLS = 2
"""Failures that are an adapter's doing, by how often it has shown that it stalls. One that loses
all that it held back leaves nothing but silence, or a wreck where that collides with what is asked
next: of those that stop for 30 ms, every third in the first seconds, while little is known of the
bus, and every tenth later. It does not let pass what comes from before the same servo each time."""
REJUDGE = 20
"""One in so many events must be new for another verdict: fewer hardly change it."""
MOST_EVENTS = 2000
"""Events kept; a window of 10 s in which every second answer of a fast bus fails has no more that
tell anything new."""
LONGEST_WINDOW = 20_000
"""Samples; bounds memory whatever the configuration says."""
_DAMAGED = math.log(0.9 / 0.5)
_LOST = math.log(0.1 / 0.5)
"""What one failure says for damage against loss: noise damages nine of ten and loses the rest; a
bad line that loses answers damages about half of them."""
DAMAGE_ODDS = math.log(100)
LOSS_ODDS = math.log(10)
"""Logarithms of the odds at which each name is used; damage is the narrower one."""
NAME_EVENTS = 30
"""With so many failures the likelier name is used whatever the odds."""


class Losses:
    """Counts, tests and explains failures.

    Args:
        chain: Of the bus.
        limits: Ordinary loss, designed false alarms, the thesis's window and thresholds.

    Attributes:
        waiting: The servos whose failures wait for an answer, a bit for each position.
    """

    def __init__(self, chain: Chain, limits: ClassifierConfig) -> None:
        self._chain = chain
        self._limits = limits.loose_contact
        self._ordinary = limits.ordinary_loss
        contact = limits.loose_contact
        self._samples = int(min(max(contact.window_s * contact.sample_hz, 10), LONGEST_WINDOW))
        size = len(chain)
        updates = contact.sample_hz * 3600 * (size + 1)
        limit = threshold(updates, limits.false_alarms_per_hour)
        self._tests = [LossTest(self._ordinary, limit) for _ in range(size + 1)]  # last: all
        self._slot = 0
        self._successes = [0] * size
        self._failures = [0] * size
        self._history: deque[tuple[list[int], list[int]]] = deque()
        self._window_successes = [0] * size
        self._window_failures = [0] * size
        self._pending: list[list[Event]] = [[] for _ in range(size)]
        self.waiting = 0
        self._events: deque[tuple[int, int, Event]] = deque()
        self._counts: Counter[Event] = Counter()
        self._windows = [FailureWindow(self._samples) for _ in range(size)]
        self._sparks = 0
        self._cuts = [0] * size  # by position, how often all from it on were silent for a moment
        self._contact = False
        self._verdict: Verdict | None = None
        self._unjudged = 0  # events that came or went since the verdict
        self._code: str | None = None  # what failures of a servo or of the bus are called
        self._told = False  # whether the verdict has become a finding
        self._loose_since: dict[str, int] = {}  # contacts that are told, and from when on
        self._strays: deque[int] = deque(maxlen=SPARKS)
        self._interruptions: deque[tuple[int, int, Interruption]] = deque(maxlen=16)
        self._since = 0
        self._stray_since = 0
        self._stray_since_ns = 0

    @property
    def share(self) -> float:
        """Share of answers that this bus loses at present; at least what is ordinary."""
        failures = sum(self._window_failures) + sum(self._failures)
        if not failures:
            return self._ordinary
        answers = failures + sum(self._window_successes) + sum(self._successes)
        return max(self._ordinary, wilson(failures, answers)[1])

    def succeeded(self, positions: Iterable[int], count: int = 1) -> None:
        """Servos have answered so many requests."""
        successes = self._successes
        for position in positions:
            successes[position] += count

    def failed(self, event: Event, stamp: int, *, spoken: bool) -> None:
        """A servo has not answered, or not intact; ``spoken``: it has certainly tried to."""
        if spoken:
            self._commit(event, stamp)
            return
        if not (self._successes[event.position] or self._window_successes[event.position]):
            return  # it has yet to come up, or the adapter has
        if self.waiting & ((1 << event.position) - 1):
            return  # what silences one nearer to the adapter may silence it, too
        pending = self._pending[event.position]
        if len(pending) < COUNTED_IN_ROW:
            pending.append(event)
            self.waiting |= 1 << event.position

    def recovered(self, position: int, stamp: int, *, passing: bool) -> None:
        """A servo has answered after failures; ``passing`` unless these were a break."""
        pending = self._pending[position]
        if passing and pending:
            self._commit(pending[0], stamp)
            self._failures[position] += len(pending) - 1
        pending.clear()
        self.waiting &= ~(1 << position)

    def stray(self, now_ns: int, stamp: int) -> None:
        """Bytes of nobody in a transaction."""
        if not self._strays or now_ns - self._strays[-1] > STRAY_NS:
            self._stray_since = stamp
            self._stray_since_ns = now_ns
        self._strays.append(now_ns)

    def interrupted(self, interruption: Interruption, stamp: int) -> None:
        """A cable was interrupted and has come back."""
        latest = self._interruptions[-1][1] if self._interruptions else None
        # Servos that start anew come back one by one.
        if self._chain.power != "far" or latest is None or stamp - latest >= SAME_NS:
            self._interruptions.append((self._slot, stamp, interruption))
        for position, pending in enumerate(self._pending):
            if position != interruption.cable:
                pending.clear()  # nobody's own failure
                self.waiting &= ~(1 << position)

    def reset(self) -> None:
        """What was counted has another cause: a jammer destroys answers at random."""
        self._drop_pending()
        self._successes = [0] * len(self._chain)
        self._failures = [0] * len(self._chain)

    def explained(self, since: int) -> None:
        """What failed from a stamp on has another cause, which was not known until now."""
        events, self._events = self._events, deque()
        self._counts.clear()
        self._sparks, self._cuts = 0, [0] * len(self._cuts)
        for slot, stamp, event in events:
            if stamp < since:
                self._remember(slot, stamp, event)
        self._drop_pending()

    def _drop_pending(self) -> None:
        for pending in self._pending:
            pending.clear()
        self.waiting = 0
        self._strays.clear()

    def end_slot(self) -> None:
        """The current sample of the thesis's window is over."""
        successes, failures = self._successes, self._failures
        if any(successes) or any(failures):
            for test, failed, succeeded in zip(self._tests, failures, successes, strict=False):
                if failed or test.sum:  # successes alone leave it at zero
                    test.add(failed, succeeded)
            self._tests[-1].add(sum(failures), sum(successes))
        self._history.append((successes, failures))
        self._add(successes, failures, 1)
        if len(self._history) > self._samples:
            self._add(*self._history.popleft(), -1)
        self._successes = [0] * len(successes)
        self._failures = [0] * len(successes)
        self._slot += 1
        self._forget()

    def findings(self, now_ns: int, *, stalls: int) -> list[Finding]:
        """What the failures mean.

        Args:
            now_ns: Classifier's time.
            stalls: How often of late the adapter has shown that it held answers back.
        """
        reconnecting = self._reconnecting()
        findings = self._explain(stalls)
        if reconnecting is not None:
            placed = [finding for finding in findings if finding.code == reconnecting.code]
            if reconnecting.confidence >= LIKELY or not placed:
                findings = [reconnecting, *self._besides(reconnecting, findings)]
        self._told = bool(findings)
        self._loose_since = {
            each.component: each.since for each in findings if each.code == "loose_contact"
        }
        while self._strays and now_ns - self._strays[-1] > STRAY_NS:
            self._strays.clear()
        if len(self._strays) == SPARKS and now_ns - self._stray_since_ns >= STRAY_WAIT_NS:
            findings.append(
                Finding(
                    "stray_data",
                    component.bus(self._chain.bus),
                    0.9,
                    self._stray_since,
                    "bytes came that belong to no packet and stand in no packet's place",
                )
            )
        return findings

    def _besides(self, reconnecting: Finding, findings: list[Finding]) -> list[Finding]:
        """What a window without an interruption tells of other places, and what was told before.

        Else its failures are the interruptions' own; a contact that was interrupted goes on to
        flicker in its place, not in another one.
        """
        recent = self._interruptions[-1][0] > self._slot - self._samples
        known = self._loose_since
        return [
            replace(finding, since=known.get(finding.component, self._events[0][1]))
            for finding in findings
            if finding.component != reconnecting.component
            and finding.confidence >= SURE
            and (finding.component in known or not recent)
        ]

    def _commit(self, event: Event, stamp: int) -> None:
        position = event.position
        self._failures[position] += 1
        self._windows[position].fail(self._slot)
        self._remember(self._slot, stamp, event)
        if len(self._events) > MOST_EVENTS:
            self._drop()

    def _remember(self, slot: int, stamp: int, event: Event) -> None:
        self._events.append((slot, stamp, event))
        self._counts[event] += 1
        self._sparks += event.mark is Mark.SPARK
        self._cuts[event.position] += _is_cut(event)
        self._unjudged += 1

    def _drop(self) -> None:
        _, _, event = self._events.popleft()
        self._counts[event] -= 1
        if not self._counts[event]:
            del self._counts[event]
        self._sparks -= event.mark is Mark.SPARK
        self._cuts[event.position] -= _is_cut(event)
        self._unjudged += 1

    def _add(self, successes: list[int], failures: list[int], sign: int) -> None:
        for position, (succeeded, failed) in enumerate(zip(successes, failures, strict=True)):
            self._window_successes[position] += sign * succeeded
            self._window_failures[position] += sign * failed

    def _forget(self) -> None:
        oldest = self._slot - self._samples
        while self._events and self._events[0][0] <= oldest:
            self._drop()
        for window in self._windows:
            window.expire(self._slot)
        oldest = self._slot - 3 * self._samples
        while self._interruptions and self._interruptions[0][0] <= oldest:
            self._interruptions.popleft()
        # An alarm ends when the window holds no more failures than are ordinary.
        for position, test in enumerate(self._tests):
            if test.alarmed:
                whole = position == len(self._chain)
                failures = len(self._events) if whole else self._window_failures[position]
                successes = (
                    sum(self._window_successes) if whole else self._window_successes[position]
                )
                expected = self._ordinary * successes
                if failures <= expected + 2 * math.sqrt(expected) + 1:
                    test.reset()

    def _sparked(self) -> bool:
        """Whether there were bytes of nobody that nothing has explained since."""
        if not self._sparks:
            return False
        latest = self._slot - SPARK_WAIT_S * self._limits.sample_hz
        return any(slot <= latest and each.mark is Mark.SPARK for slot, _, each in self._events)

    def _flickered(self, cable: int) -> bool:
        """Whether a cable failed besides its interruptions, and what follows from these."""
        return any(
            event.position == cable
            and _is_cut(event)
            and not any(0 <= stamp - back < RESTART_NS for _, back, _ in self._interruptions)
            for _, stamp, event in self._events
        )

    def _reconnecting(self) -> Finding | None:
        """A break that comes and goes."""
        if not self._interruptions:
            return None
        told = [interruption for _, _, interruption in self._interruptions]
        far = self._chain.power == "far"
        cables = Counter(i.cable for i in told if not i.whole and i.cable is not None)
        cable, count = cables.most_common(1)[0] if cables else (0, 0)
        if far and count < RECONNECTS:
            cable = 0  # whose supply failed is known only if it is the same ones again
        if far or not cables:
            count = len(told)  # all of them may be of one cable, wherever that is
        brief = [i for i in told if i.lasted_ns <= BY_HAND_NS]
        by_hand = all(i.whole for i in told) and len(brief) < RECONNECTS
        signs = self._sparked() or self._flickered(cable)
        moving = any(not i.whole for i in brief) and signs
        if count + bool(moving) < (RECONNECTS_ALL if by_hand else RECONNECTS):
            return None
        since = self._interruptions[0][1]
        if not self._told:
            self._since = since
        summary = f"the connection was gone and came back {count} times"
        if count < RECONNECTS:
            summary = "the connection was gone for a moment, and sparked or flickered besides"
        confidence = 0.9 if cable and count >= RECONNECTS else 0.8
        chain = self._chain
        suspects = [chain.servo(cable)] if cable == len(chain) - 1 else []
        if cable == 1 and far:
            suspects = [chain.servo(0)]
        found = self._loose(cable, confidence, suspects, summary, {"reconnects": count})
        return replace(found, since=self._loose_since.get(found.component, since))

    def _explain(self, stalls: int) -> list[Finding]:
        recurring = max(self._cuts, default=0) >= (CUTS_HOLD if self._contact else CUTS)
        alarmed = recurring or any(test.alarmed for test in self._tests)
        sparks = len(self._strays) if len(self._events) >= SPARKS else 0
        sparking = sparks >= (1 if self._contact else SPARKS)
        of_adapter = not recurring and len(self._events) <= HIDDEN_STALLS * stalls
        if of_adapter or not (alarmed or sparking):
            self._contact = self._told = False
            self._code = None
            return []
        if self._unjudged * REJUDGE > len(self._events):
            ordinary = self._ordinary * sum(self._window_successes) / max(1, len(self._events))
            self._verdict = self._settled(judge(self._counts, len(self._chain), ordinary))
            self._unjudged = 0
        verdict = self._verdict
        if verdict is None:
            return []
        if not self._told:
            self._since = self._events[0][1]
        found = None
        match verdict.cause:
            case Cause.CONTACT:
                return self._intermittent(verdict)
            case Cause.SERVO if alarmed:
                found = self._of_servo(verdict)
            case Cause.BUS if alarmed:
                found = self._of_bus(verdict)
        return [] if found is None else [found]

    def _settled(self, verdict: Verdict | None) -> Verdict | None:
        """The new verdict if it differs from the old one in more than its doubts."""
        old = self._verdict
        if old is None or verdict is None or not self._told:
            return verdict
        verdict = verdict.with_doubts_of(old)
        if old.cause is verdict.cause and set(verdict.places) == set(old.places):
            return old if set(old.others) == set(verdict.others) else verdict
        more = old.cause is verdict.cause and set(verdict.places) > set(old.places)
        return verdict if more or verdict.confidence >= SURE else old

    def _intermittent(self, verdict: Verdict) -> list[Finding]:
        by_time = any(self._comes_and_goes(place) for place in verdict.places)
        sparking = len(self._strays) >= SPARKS
        if not (by_time or self._contact or (sparking and verdict.confidence >= LIKELY)):
            return []
        self._contact = True
        window = self._windows[verdict.places[0]]
        kind = "in bursts" if window.bursts else "scattered"
        events = len(self._events)
        seconds = self._samples / self._limits.sample_hz
        summary = f"{events} failures {kind} within {seconds:.0f} s"
        if self._sparks:
            summary += f", {self._sparks} of them with bytes that belong to nobody"
        values: dict[str, float | int | str] = {
            "failures": events,
            "failure_rate": round(window.rate, 4),
            "evenness": round(window.evenness, 3),
            "pattern": kind,
            "sparks": self._sparks,
        }
        suspects = self._named(verdict.others)
        return [
            self._loose(place, verdict.confidence, suspects, summary, values)
            for place in verdict.places
        ]

    def _comes_and_goes(self, position: int) -> bool:
        """The thesis's criterion: neither seldom nor nearly always, and not in one lump."""
        window, limits = self._windows[position], self._limits
        spread = window.evenness >= limits.evenness or self._returned(position) >= RETURNS
        return spread and limits.rate_low <= window.rate <= limits.rate_high

    def _returned(self, position: int) -> int:
        """How often a servo has been missed and was back afterwards."""
        return sum(count for event, count in self._counts.items() if event.position == position)

    def _loose(
        self,
        position: int,
        confidence: float,
        suspects: list[str],
        summary: str,
        values: dict[str, float | int | str],
    ) -> Finding:
        chain = self._chain
        cable = chain.cable(position)
        if position == 0 and chain.power == "far":
            # Whichever cable opens, all before it lose power and all behind it the line.
            place, suspects = component.bus(chain.bus), chain.cables()
        elif position == 0:
            place = cable
            suspects = [*suspects, component.supply(chain.bus)]
        else:
            place = cable
        return Finding("loose_contact", place, confidence, self._since, summary, values, suspects)

    def _of_servo(self, verdict: Verdict) -> Finding | None:
        position = verdict.places[0]
        failures, successes = self._window_failures[position], self._window_successes[position]
        code = self._name_of("crc_errors")
        if code is None:
            return None
        return Finding(
            code,
            self._chain.servo(position),
            verdict.confidence,
            self._since,
            self._rate(failures, successes),
            self._rates(failures, successes),
            self._named(verdict.others),
        )

    def _of_bus(self, verdict: Verdict) -> Finding | None:
        failures, successes = sum(self._window_failures), sum(self._window_successes)
        code = self._name_of("noise")
        if code is None:
            return None
        return Finding(
            code,
            component.bus(self._chain.bus),
            verdict.confidence,
            self._since,
            self._rate(failures, successes) + ", of all servos alike",
            self._rates(failures, successes),
            self._named(verdict.others),
        )

    def _name_of(self, damage: str) -> str | None:
        """``damage`` if answers come damaged, ``packet_loss`` if they are lost; None: unclear."""
        odds, told = 0.0, 0
        for event, count in self._counts.items():
            # Silence of all behind it may be the instruction's loss; it says nothing.
            if event.mark is Mark.DAMAGED:
                odds += count * _DAMAGED
            elif not event.run:
                odds += count * _LOST
            else:
                continue
            told += count
        if odds >= DAMAGE_ODDS or (told >= NAME_EVENTS and odds > 0 and self._code is None):
            self._code = damage
        elif odds <= -LOSS_ODDS or (told >= NAME_EVENTS and self._code is None):
            self._code = "packet_loss"
        elif self._code not in (None, "packet_loss"):
            self._code = damage  # of a servo before, of the bus now
        return self._code

    def _rate(self, failures: int, successes: int) -> str:
        low, high = wilson(failures, failures + successes)
        return (
            f"{failures} of {failures + successes} answers lost or damaged, which is {low:.2%} to "
            f"{high:.2%} (95 %); ordinary is {self._ordinary:.2%}"
        )

    def _rates(self, failures: int, successes: int) -> dict[str, float | int | str]:
        low, high = wilson(failures, failures + successes)
        return {
            "failures": failures,
            "answers": failures + successes,
            "rate_low": round(low, 5),
            "rate_high": round(high, 5),
        }

    def _named(self, explanations: list[tuple[Cause, int]]) -> list[str]:
        return [self._name(cause, position) for cause, position in explanations]

    def _name(self, cause: Cause, position: int) -> str:
        match cause:
            case Cause.CONTACT:
                return self._chain.cable(position)
            case Cause.SERVO:
                return self._chain.servo(position)
            case Cause.BUS:
                return component.bus(self._chain.bus)


def _is_cut(event: Event) -> bool:
    """Whether all from this servo on were silent, but none before it."""
    heard_before = not (event.first or event.alone)
    return bool(event.run) and heard_before and event.mark is not Mark.DAMAGED
