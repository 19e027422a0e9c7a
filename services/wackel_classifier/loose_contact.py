"""Failures over time: a loose contact (thesis, 3.5 and 3.6), its place, and what else they mean.

The thesis looks at a window of N reads: the share that failed, and how evenly the failures lie.
Both follow from the first failure, the last and their number, so nothing is ever rescanned.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass
from enum import IntEnum
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
        position: Of the servo, or of the servo that the cable leads to; 0 for the bus.
        confidence: Posterior probability with equal priors for causes and, among those, places.
        others: Explanations whose probability is at least a tenth of the likeliest one's.
        second: Position of the servo that a second bad cable leads to, if there are two.
    """

    cause: Cause
    position: int
    confidence: float
    others: list[tuple[Cause, int]]
    second: int | None = None

    @property
    def places(self) -> tuple[int, ...]:
        """The one position, or both."""
        return (self.position,) if self.second is None else (self.position, self.second)


_MARKS = {
    # QUIET, DAMAGED, SPARK, TORN. A contact that opens leaves silence, a spark or half a packet;
    # what damages packets of one servo or of all does so in place.
    Cause.CONTACT: (0.50, 0.05, 0.30, 0.15),
    Cause.SERVO: (0.49, 0.49, 0.01, 0.01),
    Cause.BUS: (0.39, 0.59, 0.01, 0.01),
}
_RUN = {Cause.CONTACT: 0.85, Cause.SERVO: 0.1, Cause.BUS: 0.25}
"""How often the next servo is not heard either: mostly while a contact is open (until it closes,
servos behind it go on among themselves), but seldom where one answer is damaged on its way."""
_FIRST_BEHIND = 0.6
"""How often it is the first servo behind an open contact that fails first. The rest: the contact
opens when some behind it have already answered."""
SECOND_ODDS = math.log(20 / 1e-3)
"""By how much, as a logarithm of odds, a second bad cable must explain more: one of twenty may be
it, and seem so once in a thousand times."""
SECOND_EVENTS = 4
"""Failures at its own place that a second bad cable needs."""
_LEAST_ORDINARY = 0.003
"""Share of events that no explanation needs to provide for, at the least."""
_INSTRUCTION = 2.0
"""Noise destroys the instruction of a sync read about twice as often as one answer, being twice
as long; then the first servo asked is missing, and all others."""


def judge(events: Counter[Event], size: int, ordinary: float) -> Verdict | None:
    """The likeliest explanation of events in a chain; None without events.

    A naive Bayes classifier over cause and place. The likelihoods are those named above; they are
    rough, but every event adds to the evidence, and there are at least several.

    Args:
        events: With how often each occurred.
        size: Servos.
        ordinary: Share of the events that ordinary loss explains, which hits all servos alike.
    """
    if not events:
        return None
    ordinary = min(max(ordinary, _LEAST_ORDINARY), 0.9)
    scores: dict[tuple[Cause, int], float] = {}
    for position in range(size):
        for cause in (Cause.CONTACT, Cause.SERVO):
            scores[cause, position] = -math.log(size) + _score(
                events, cause, position, size, ordinary
            )
    scores[Cause.BUS, 0] = _score(events, Cause.BUS, 0, size, ordinary)
    (cause, position), best = max(scores.items(), key=lambda item: item[1])
    weights = {key: math.exp(score - best) for key, score in scores.items()}
    others = [key for key, weight in weights.items() if weight >= 0.1 and key != (cause, position)]
    others.sort(key=lambda key: -weights[key])
    second = _second_contact(events, position, size, ordinary) if cause is Cause.CONTACT else None
    return Verdict(cause, position, 1.0 / sum(weights.values()), others, second)


def _second_contact(events: Counter[Event], one: int, size: int, ordinary: float) -> int | None:
    """Another bad cable without which the events cannot be understood."""
    alone = _score(events, Cause.CONTACT, one, size, ordinary)
    best, place = alone + SECOND_ODDS, None
    at = Counter[int]()
    for event, count in events.items():
        at[event.position] += count
    for other in range(size):
        if at[other] < SECOND_EVENTS or other == one:
            continue
        share = at[one] / (at[one] + at[other])
        score = 0.0
        for event, count in events.items():
            own = share * _likelihood(event, Cause.CONTACT, one, size)
            own += (1 - share) * _likelihood(event, Cause.CONTACT, other, size)
            background = _likelihood(event, Cause.BUS, 0, size)
            score += count * math.log((1 - ordinary) * own + ordinary * background)
        if score > best:
            best, place = score, other
    return place


def _score(
    events: Counter[Event], cause: Cause, position: int, size: int, ordinary: float
) -> float:
    score = 0.0
    for event, count in events.items():
        own = _likelihood(event, cause, position, size)
        background = _likelihood(event, Cause.BUS, 0, size)
        score += count * math.log((1 - ordinary) * own + ordinary * background)
    return score


def _likelihood(event: Event, cause: Cause, position: int, size: int) -> float:
    likelihood = _place(event, cause, position, size) * _MARKS[cause][event.mark]
    if event.run is not None:
        likelihood *= _RUN[cause] if event.run else 1 - _RUN[cause]
    return likelihood


def _place(event: Event, cause: Cause, position: int, size: int) -> float:
    """Probability that this servo is the one that fails first."""
    failed = event.position
    if cause is Cause.SERVO:
        return float(failed == position)
    if cause is Cause.BUS:
        return (1 + _INSTRUCTION * event.first) / (size + _INSTRUCTION)
    behind = size - position
    if failed < position:
        return 0.0
    if event.alone:
        return 1 / behind  # any of those behind
    if failed == position:
        return _FIRST_BEHIND if behind > 1 else 1.0
    return (1 - _FIRST_BEHIND) / (behind - 1)
