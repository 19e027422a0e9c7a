"""Failures over time: a loose contact (thesis, 3.5 and 3.6), its place, and what else they mean.

The thesis looks at a window of N reads: the share that failed, and how evenly the failures lie.
Both follow from the first failure, the last and their number, so nothing is ever rescanned.
"""

import math
from collections import Counter, defaultdict, deque
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import combinations
from operator import itemgetter
from typing import NamedTuple


def evenness(samples: int, distances: int, span: int) -> float:
    """(ē − 1)/(ê − 1): 1 where failures lie as far apart as they can, 0 where they lie in one lump.

    Args:
        samples: N, the window's length.
        distances: How many distances between successive failures there are.
        span: Their sum, which is the distance from the first failure to the last.

    Source: thesis, 3.6, with its worked example (N = 12, distances 4, 1, 3, 1, 1: ē = 2, ê = 2.75,
    result 0.571). There ê = (N − 1)/(n − 1) is 11/4 = 2.75, so n is the number of distances, 5; the
    text prints 6 − 1 in its place, which would be 2.2. The printed result decides.
    """
    if distances < 2:
        return 0.0
    mean, greatest = span / distances, (samples - 1) / (distances - 1)
    return min(1.0, (mean - 1) / (greatest - 1)) if greatest > 1 else 0.0


class FailureWindow:
    """The failed ones among the last ``samples`` samples, which are numbered without gaps."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self._failed: deque[int] = deque()
        self._squares = 0  # sum of squared distances

    def __len__(self) -> int:
        return len(self._failed)

    def fail(self, sample: int) -> None:
        """A sample has failed; samples come in order, one may be named again."""
        if self._failed:
            if sample <= self._failed[-1]:
                return
            self._squares += (sample - self._failed[-1]) ** 2
        self._failed.append(sample)

    def expire(self, sample: int) -> None:
        """Forgets what lies a window's length before ``sample``."""
        failed = self._failed
        while failed and failed[0] <= sample - self._samples:
            first = failed.popleft()
            self._squares -= (failed[0] - first) ** 2 if failed else 0

    @property
    def rate(self) -> float:
        """n/N."""
        return len(self._failed) / self._samples

    @property
    def evenness(self) -> float:
        """See :func:`evenness`."""
        if not self._failed:
            return 0.0
        span = self._failed[-1] - self._failed[0]
        return evenness(self._samples, len(self._failed) - 1, span)

    @property
    def bursts(self) -> bool:
        """Whether failures come in bursts.

        Distances of independent failures vary by as much as their mean (coefficient of variation
        1); half as much again is a burst.
        """
        count = len(self._failed) - 1
        if count < 3:
            return False
        mean = (self._failed[-1] - self._failed[0]) / count
        return self._squares / count - mean**2 > (1.5 * mean) ** 2


class Mark(IntEnum):
    """What a failure left on the wire.

    ``QUIET`` nothing, ``DAMAGED`` as many bytes as the answer has, ``SPARK`` bytes of nobody,
    ``TORN`` the beginning or the end of a packet.
    """

    QUIET = 0
    DAMAGED = 1
    SPARK = 2
    TORN = 3


class Event(NamedTuple):
    """One answer that failed, of a servo that answered again afterwards.

    Attributes:
        position: Of the servo in the chain.
        mark: What was on the wire.
        run: The next in the request was not heard either; None if nobody was asked after it.
        alone: It was asked alone.
        first: It was the first of several that were asked, and nobody was heard at all.
    """

    position: int
    mark: Mark
    run: bool | None
    alone: bool
    first: bool


class Cause(IntEnum):
    """What explains a set of events."""

    CONTACT = 0
    SERVO = 1
    BUS = 2


@dataclass(slots=True)
class Verdict:
    """The likeliest explanation.

    Attributes:
        cause: A contact in a cable, one servo, or the whole bus.
        places: Positions of the servos, or of those that the bad cables lead to; 0 for the bus.
        confidence: Posterior probability of the cause at the first of these places.
        others: Further explanations whose posterior probability is at least a tenth.
        possible: Those of at least a hundredth.
    """

    cause: Cause
    places: tuple[int, ...]
    confidence: float
    others: list[tuple[Cause, int]]
    possible: list[tuple[Cause, int]]

    def with_doubts_of(self, earlier: "Verdict") -> "Verdict":
        """The same with what was told before, named or not, and is not refuted."""
        told = [(earlier.cause, place) for place in earlier.places] + earlier.others
        kept = [key for key in self.possible if key in self.others or key in told]
        return replace(self, others=kept)


_MARKS = {
    # QUIET, DAMAGED, SPARK, TORN. A contact is open for longer than an answer takes, so it mostly
    # leaves silence, else half a packet or a spark; what damages packets of one servo or of all
    # does so in place.
    Cause.CONTACT: (0.75, 0.05, 0.10, 0.10),
    Cause.SERVO: (0.49, 0.49, 0.01, 0.01),
    Cause.BUS: (0.39, 0.59, 0.01, 0.01),
}
_RUN = {Cause.CONTACT: 0.85, Cause.SERVO: 0.1, Cause.BUS: 0.25}
"""How often the next servo is not heard either: mostly while a contact is open (until it closes,
servos behind it go on among themselves), but seldom where one answer is damaged on its way."""
_FIRST_BEHIND = 0.6
"""How often it is the first servo behind an open contact that fails first. The rest: the contact
opens when some behind it have already answered, which depends on how long it stays open beside how
long the answers take. So this is only where the estimate from the events themselves begins."""
_FIRST_WEIGHT = 4.0
"""How many events that beginning is worth."""
_FIRST_LEAST = 0.2
"""A contact is open for milliseconds, the answers of a long chain take some of them."""
_TWO_CONTACTS = 0.05
"""How probable two bad cables are where there is one: seldom, but they share age and movement."""
SECOND_EVENTS = 2
"""Failures at its own place that each of two bad cables needs."""
_MOST_PEAKS = 6
"""Places with the most failures, among which two bad cables are looked for."""
_WORTH_TELLING = 0.1
"""Probability from which another explanation is told."""
_REFUTED = 0.01
"""Probability below which one that has been told is dropped."""
_LEAST_ORDINARY = 0.003
"""Share of events that no explanation needs to provide for, at the least."""
_ALWAYS_PASSING = 2
"""So many events are no contact's even if most others are."""
_INSTRUCTION = 2.0
"""Noise destroys the instruction of a sync read about twice as often as one answer, being twice
as long; then the first servo asked is missing, and all others."""


def judge(events: Counter[Event], size: int, ordinary: float) -> Verdict | None:
    """The likeliest explanation of events in a chain; None without events.

    A naive Bayes classifier over cause and place. The likelihoods are those named above; they are
    rough, but every event adds to the evidence, and there are at least several. Two bad cables are
    one of the explanations: each has a peak of its own, and only the one nearer to the adapter
    explains what fails between them.

    Args:
        events: With how often each occurred.
        size: Servos.
        ordinary: Share of the events that ordinary loss explains at most; it hits all servos alike.
    """
    if not events:
        return None
    ordinary = min(max(min(ordinary, _passing(events)), _LEAST_ORDINARY), 0.9)
    tally = _Tally(events, size, ordinary)
    each = -math.log(size)
    scores: dict[tuple[Cause, tuple[int, ...]], float] = {(Cause.BUS, (0,)): tally.bus()}
    for place in range(size):
        scores[Cause.CONTACT, (place,)] = each + tally.contacts((place,))
        if place in tally.failed:
            scores[Cause.SERVO, (place,)] = each + tally.servo(place)
    peaks = [place for place in range(size) if tally.at[place] >= SECOND_EVENTS]
    peaks = sorted(sorted(peaks, key=lambda place: -tally.at[place])[:_MOST_PEAKS])
    if len(peaks) > 1:
        pair = math.log(_TWO_CONTACTS * 2 / (size * (size - 1)))
        for both in combinations(peaks, 2):
            scores[Cause.CONTACT, both] = pair + tally.contacts(both)
    (cause, places), best = max(scores.items(), key=itemgetter(1))
    weights = {key: math.exp(score - best) for key, score in scores.items()}
    total = sum(weights.values())
    single: defaultdict[tuple[Cause, int], float] = defaultdict(float)
    for (why, where), weight in weights.items():
        for place in where:
            single[why, place] += weight / total
    possible = [
        key
        for key, probability in sorted(single.items(), key=itemgetter(1), reverse=True)
        if probability >= _REFUTED and not (key[0] is cause and key[1] in places)
    ]
    others = [key for key in possible if single[key] >= _WORTH_TELLING]
    places = tuple(sorted(places, key=lambda place: -single[cause, place]))
    return Verdict(cause, places, single[cause, places[0]], others, possible)


def _passing(events: Counter[Event]) -> float:
    """Share of the events that are no contact's: too many of them let the next servo be heard."""
    heard = sum(count for event, count in events.items() if event.run is False)
    told = sum(count for event, count in events.items() if event.run is not None)
    of_contacts = 1 - _RUN[Cause.CONTACT]
    share = ((heard + 1) / (told + 2) - of_contacts) / (1 - _RUN[Cause.BUS] - of_contacts)
    return max(share, _ALWAYS_PASSING / events.total())


class _Tally:
    """Events of one window, to be explained in several ways.

    Attributes:
        at: How many failed at each position, without those that were asked alone.
        failed: Positions at which any failed.
    """

    def __init__(self, events: Counter[Event], size: int, ordinary: float) -> None:
        self._size = size
        self._ordinary = ordinary
        self.at = [0] * size
        self.failed = {event.position for event in events}
        self._events: list[tuple[Event, int, float]] = []
        for event, count in events.items():
            background = _trace(event, Cause.BUS)
            background *= (1 + _INSTRUCTION * event.first) / (size + _INSTRUCTION)
            self._events.append((event, count, background))
            if not event.alone:
                self.at[event.position] += count

    def bus(self) -> float:
        """Logarithm of the likelihood that all servos fail alike."""
        return sum(count * math.log(background) for _, count, background in self._events)

    def servo(self, position: int) -> float:
        """The same of one servo's fault."""
        place = [float(other == position) for other in range(self._size)]
        return self._score(Cause.SERVO, place, place)

    def contacts(self, positions: tuple[int, ...]) -> float:
        """The same of bad cables that lead to these positions, in ascending order."""
        size, at = self._size, self.at
        behind = size - positions[0]
        group = sum(at[positions[0] :])
        # A peak at each of them, the rest alike; ordinary servos share what is left.
        own = _FIRST_WEIGHT * _FIRST_BEHIND / len(positions)
        peaks = [(at[place] + own) / (group + _FIRST_WEIGHT) for place in positions]
        scale = max(1.0, _FIRST_LEAST / sum(peaks))
        peaks = [peak * scale for peak in peaks]
        left = behind - len(positions)
        if not left:
            peaks = [peak / sum(peaks) for peak in peaks]
        place = [0.0] * positions[0] + [(1 - sum(peaks)) / left if left else 0.0] * behind
        alone = [0.0] * size
        for position, peak in zip(positions, peaks, strict=True):
            place[position] = peak
            # Who is asked alone may be any of those behind.
            share = peak / sum(peaks) / (size - position)
            for other in range(position, size):
                alone[other] += share
        return self._score(Cause.CONTACT, place, alone)

    def _score(self, cause: Cause, place: list[float], alone: list[float]) -> float:
        score, ordinary = 0.0, self._ordinary
        for event, count, background in self._events:
            own = (alone if event.alone else place)[event.position]
            if own:
                own *= (1 - ordinary) * _trace(event, cause)
            score += count * math.log(own + ordinary * background)
        return score


def _trace(event: Event, cause: Cause) -> float:
    """Probability of what a failure has left on the wire."""
    likelihood = _MARKS[cause][event.mark]
    if event.run is not None:
        likelihood *= _RUN[cause] if event.run else 1 - _RUN[cause]
    return likelihood
