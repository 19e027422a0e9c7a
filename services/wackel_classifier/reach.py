"""Who can be reached: told from request order, follow-up pings, cable order and power side.

A servo that is silent in a sync read silences everybody behind it in request order, so only who had
its turn counts as missed. A break of a cable takes away everybody behind it in cable order; a
silent servo nobody but itself.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_schemas import component

GONE_NS = 500_000_000
"""How long a servo must be without an answer to count as gone. Longer than the interruptions of a
loose contact, which last milliseconds to tens of them, and than a servo's restart after one of
these, some 0.4 s; short enough to name a break well within a second."""
RESOLVE_NS = 700_000_000
"""How long to wait until the servos behind a missing one have been asked on their own. Who asks
them is the gateway in mode poll; in the other modes nobody may, and then it stays open."""
SAME_NS = 1_000_000_000
"""Servos that fall silent within this time may have one cause, and so may come back together: the
master notices by and by, as it asks them on their own."""
DARK_NS = 100_000_000
"""Servos that are silent for so long start anew: the interruption itself is mostly over by then."""
UNHEARD_NS = 1_000_000_000
"""How long no intact answer may come from a servo that is asked before that is told whatever the
reason, for a robot whose servos do not answer is not healthy: longer than to name the reason takes.
"""
START_NS = 450_000_000
"""How long the others may need when one of those with a common cause is back: a restart, 0.4 s."""
NEVER_NS = 1 << 62
BACK_ANSWERS = 3
"""Answers in a row after which a servo that was gone is back: one may slip through."""
CERTAIN = -math.log(1e-10)
"""Of the probability of losing so many answers in a row: ten million requests an hour (2000 packets
a second), and one silent servo wrongly named in a thousand hours."""
CERTAIN_JAMMED = -math.log(1e-4)
"""The same while a jammer is there, which is seldom and destroys many answers."""


@dataclass(slots=True)
class _Servo:
    """Attributes: times in ns of the classifier's clock.

    ``misses`` requests in a row in which it had its turn and was silent, from ``missed_ns`` (stamp
    ``since``) to ``latest_ns``; ``evidence`` minus the logarithm of the probability of losing so
    many answers;
    ``back`` answers in a row while gone.
    """

    missed_ns: int = 0
    latest_ns: int = 0
    since: int = 0
    misses: int = 0
    evidence: float = 0.0
    gone: bool = False
    back: int = 0


class Interruption(NamedTuple):
    """A connection that was gone and is back.

    Attributes:
        cable: Position of the servo that it leads to; None if it is not known.
        whole: Whether nobody answered meanwhile.
        lasted_ns: From the first miss to the first answer.
    """

    cable: int | None
    whole: bool
    lasted_ns: int


class Reach:
    """Follows each servo of a chain.

    Attributes:
        waiting: The servos that are without an answer, a bit for each position.
        unheard: Those and all others that were asked and from whom no intact answer came, be it
            damaged or for want of a turn.
        due_ns: When time alone may change the findings next, classifier's time; set by
            :meth:`findings`.
        interrupted: A cable was, and has just come back; reset by the reader.
    """

    interrupted: Interruption | None = None

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._servos = [_Servo() for _ in range(len(chain))]
        self._answered_ns = [-NEVER_NS] * len(chain)
        self._anew_ns = [-NEVER_NS] * len(chain)  # when it began anew with others
        self._unheard = [(0, 0)] * len(chain)  # since when: classifier's time, stamp
        self.waiting = self.unheard = 0
        self.due_ns = NEVER_NS
        self._newly_gone: list[int] = []
        self._cut = len(chain)  # the first servo behind a break; the chain's length if none

    def gone(self, position: int) -> bool:
        """Whether a servo counts as unreachable."""
        return self._servos[position].gone

    def heard(self, positions: Iterable[int], at_ns: int) -> None:
        """Servos have answered that were not without an answer before."""
        answered_ns = self._answered_ns
        for position in positions:
            answered_ns[position] = max(answered_ns[position], at_ns)
            if self.unheard:
                self.unheard &= ~(1 << position)

    def asked(self, position: int, now_ns: int, stamp: int) -> None:
        """A servo was asked, and no intact answer came, whoever is to blame."""
        if not self.unheard >> position & 1:
            self.unheard |= 1 << position
            self._unheard[position] = now_ns, stamp

    def answered(self, position: int, now_ns: int) -> None:
        """A servo has answered."""
        servo = self._servos[position]
        self._answered_ns[position] = now_ns
        self.unheard &= ~(1 << position)
        if not servo.misses:
            return
        if not servo.gone:
            if servo.misses > 1:
                self._renew(position, now_ns)
            self._clear(position)
        elif position >= self._cut:
            # The cable is connected again, or never was the cause: all behind it begin anew.
            self._come_back(self._cut, self._cut, now_ns - servo.missed_ns)
            self._begin_anew(range(self._cut, len(self._servos)), now_ns)
            self._cut = len(self._servos)
        elif fed := self._fed_together(servo.missed_ns):
            self._come_back(fed, fed, now_ns - servo.missed_ns)
            self._begin_anew(range(fed), now_ns)
        else:
            servo.back += 1
            if servo.back >= BACK_ANSWERS:
                self._clear(position)

    def _come_back(self, cable: int | None, head: int, lasted_ns: int) -> None:
        self.interrupted = Interruption(cable, head == 0, lasted_ns)

    def _renew(self, back: int, now_ns: int) -> None:
        """One of those that fell silent at this time is back: the others may be, too."""
        missed_ns = self._servos[back].missed_ns
        silent = [
            place
            for place, servo in enumerate(self._servos)
            if servo.misses and not servo.gone and abs(servo.missed_ns - missed_ns) < SAME_NS
        ]
        head = silent[0]
        if sum(self._servos[place].evidence for place in silent) >= CERTAIN:
            # Too many misses to be ordinary: an interruption, if all from one servo on were silent.
            if not any(
                answered_ns > missed_ns
                for place, answered_ns in enumerate(self._answered_ns[head:], start=head)
                if place != back
            ):
                # The one before may have been silent, too, but not have been asked.
                exact = not head or self._answered_ns[head - 1] > missed_ns
                self._come_back(head if exact else None, head, now_ns - missed_ns)
            elif self._chain.power == "far":
                self._come_back(self._fed_together(missed_ns), head + 1, now_ns - missed_ns)
        for place in silent:
            if place != back:
                self._clear(place)

    def _fed_together(self, missed_ns: int) -> int | None:
        """Position of the cable through which all those that fell silent at a time get supply.

        From the far end supply comes through every cable to the servos before it: an interruption
        has them start anew, all up to one servo, while those behind it answer.
        """
        if self._chain.power != "far":
            return None
        count = 0
        for servo in self._servos:
            if not servo.misses or abs(servo.missed_ns - missed_ns) >= SAME_NS:
                break
            if servo.latest_ns - servo.missed_ns < DARK_NS:
                return None
            count += 1
        passed = max(self._answered_ns[count:], default=0) > missed_ns
        return count if count and passed else None

    def take_newly_gone(self) -> list[int]:
        """Positions that have become unreachable since this was last asked."""
        gone, self._newly_gone = self._newly_gone, []
        return gone

    def _clear(self, position: int) -> None:
        servo = self._servos[position]
        servo.misses, servo.evidence = 0, 0.0
        servo.gone = False
        self.waiting &= ~(1 << position)

    def _begin_anew(self, positions: Iterable[int], now_ns: int) -> None:
        """One of those with a common cause is back."""
        for position in positions:
            self._clear(position)
            self._anew_ns[position] = now_ns

    def missed(self, position: int, now_ns: int, stamp: int, chance: float) -> None:
        """A servo had its turn and was not heard.

        Args:
            position: In the chain.
            now_ns: Classifier's time.
            stamp: Of the transaction.
            chance: Share of such answers that are lost at present, of whatever cause.
        """
        self.asked(position, now_ns, stamp)
        servo = self._servos[position]
        servo.back = 0
        if not servo.misses:
            servo.missed_ns, servo.since = now_ns, stamp
            self.waiting |= 1 << position
        servo.misses += 1
        servo.latest_ns = now_ns
        servo.evidence -= math.log(min(max(chance, 1e-6), 0.99))

    def findings(self, now_ns: int, *, jammed: bool) -> list[Finding]:
        """What the servos that are gone have in common; ``jammed`` by a permanent jammer."""
        self.due_ns = NEVER_NS
        if not (self.waiting or self.unheard):
            return []
        servos = self._servos
        certain = CERTAIN_JAMMED if jammed else CERTAIN
        head = len(servos)
        while head and self._is_missing(head - 1, now_ns):
            head -= 1
        # One that was never asked on its own cannot be the first of those cut off.
        while head < len(servos) and not servos[head].misses:
            head += 1
        behind = servos[head:]
        # All of them at once by chance is as unlikely as one so many times.
        cut_off = sum(servo.evidence for servo in behind) >= certain
        open_still = False
        for place, servo in enumerate(servos):
            if not servo.misses or servo.gone:
                continue
            alone = servo.evidence >= certain and self._is_missing(place, now_ns)
            if alone or (cut_off and place >= head):
                servo.gone = True
                self._newly_gone.append(place)
            else:
                open_still = True
        if open_still:
            lasting = (self._latest_ns(place) + GONE_NS for place in range(len(servos)))
            self.due_ns = min((due_ns for due_ns in lasting if due_ns > now_ns), default=NEVER_NS)
        self._cut = head if cut_off else len(servos)
        gone = [place for place in range(head) if servos[place].gone]
        named = [place for place in gone if self._is_passed(place)]
        findings = [self._silent(place) for place in named]
        if len(named) < len(gone):
            self.due_ns = now_ns  # any answer of one behind it tells
        if cut_off:
            unasked = sum(not servo.misses for servo in behind)
            # The one before may turn out to be missing, too.
            open_ends = unasked or (head and servos[head - 1].misses and not servos[head - 1].gone)
            resolved_ns = behind[0].missed_ns + RESOLVE_NS
            if not open_ends or now_ns >= resolved_ns:
                findings.append(self._cut_off(head, unasked))
                named += range(head, len(servos))
            else:
                self.due_ns = min(self.due_ns, resolved_ns)
        return findings + [
            self._without_reason(place)
            for place in range(len(servos))
            if place not in named and self._is_unheard(place, now_ns)
        ]

    def _is_unheard(self, place: int, now_ns: int) -> bool:
        if not self.unheard >> place & 1 or now_ns - self._anew_ns[place] < START_NS:
            return False
        return now_ns - self._unheard[place][0] >= UNHEARD_NS

    def _is_passed(self, place: int) -> bool:
        """Whether a servo behind this one has answered since it fell silent."""
        return max(self._answered_ns[place + 1 :], default=0) > self._servos[place].missed_ns

    def _is_missing(self, place: int, now_ns: int) -> bool:
        return self._servos[place].gone or now_ns - self._latest_ns(place) >= GONE_NS

    def _latest_ns(self, place: int) -> int:
        """Since when a servo may be missing."""
        return max(self._answered_ns[place], self._anew_ns[place])

    def _silent(self, place: int) -> Finding:
        servo = self._servos[place]
        suspects = []
        if self._chain.power == "far" and place + 1 < len(self._chain):
            # Its supply comes through the cable behind it, whose data line may still be good.
            suspects.append(self._chain.cable(place + 1))
        return Finding(
            "servo_silent",
            self._chain.servo(place),
            0.97,
            servo.since,
            f"no answer to {servo.misses} requests in a row, while servos behind it answer",
            {"misses": servo.misses},
            suspects,
        )

    def _without_reason(self, place: int) -> Finding:
        _, stamp = self._unheard[place]
        misses = self._servos[place].misses
        return Finding(
            "servo_unheard",
            self._chain.servo(place),
            1.0,
            stamp,
            f"it was asked for {UNHEARD_NS / 1e9:.0f} s without an intact answer"
            + (f", {misses} times in vain by itself" if misses else ""),
            {"misses": misses},
        )

    def _cut_off(self, head: int, unasked: int) -> Finding:
        chain, servo = self._chain, self._servos[head]
        count = len(chain) - head
        values: dict[str, float | int | str] = {
            "misses": servo.misses,
            "servos_missing": count,
            "servos_not_asked": unasked,
        }
        if head == 0:
            suspects = [component.supply(chain.bus)]
            suspects += chain.cables() if chain.power == "far" else [chain.cable(0)]
            if count == 1 or unasked == count - 1:
                suspects.append(chain.servo(0))
            return Finding(
                "lost_signal",
                component.bus(chain.bus),
                0.99,
                servo.since,
                f"none of {count} servos answers, after {servo.misses} requests to the first",
                values,
                suspects,
            )
        alone = count == 1 or unasked == count - 1
        text = "only the last servo is" if count == 1 else f"the last {count} servos are"
        return Finding(
            "cable_break",
            chain.cable(head),
            0.6 if alone else 0.98,
            servo.since,
            f"{text} missing, all {head} before it answer"
            + (
                f"; {unasked} of the missing had no chance to answer behind the silent one"
                if unasked
                else ""
            ),
            values,
            [chain.servo(head)] if alone else [],
        )
