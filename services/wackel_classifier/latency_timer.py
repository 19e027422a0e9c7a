"""A USB latency timer that is not set: the adapter holds answers back until it has run out."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from statistics import median

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_protocols.dynamixel2.expectation import SLOWEST_NS
from wackel_schemas import component

SAMPLES = 12
SERVOS = 3
"""One slow servo is not the adapter, and neither is a host that delivers some answers late: of the
latest answers most must have been held back, of so many servos (all, if there are fewer) and of
most of those asked."""
HELD_SHARE = 0.7
"""Share of answers that a latency timer of 4 ms makes later than any servo needs, and one of 16 ms
four times as late; a longer one more of them."""
HELD_MOST_NS = SLOWEST_NS + 16_000_000
"""A timer that nobody set runs for 16 ms; what comes later is another's doing, mostly the host's.
"""


@dataclass(frozen=True)
class Lateness:
    """What is compared: answers so late with a host so late.

    Attributes:
        answer_ns: An answer held back comes later than that.
        host_ns: A host that oversleeps by so much may have made it so.
    """

    answer_ns: int
    host_ns: int


LATENESSES = (Lateness(SLOWEST_NS, SLOWEST_NS // 2), Lateness(4 * SLOWEST_NS, SLOWEST_NS))
"""Of a timer of 4 ms and of 16 ms. A host that is a little late in many of its reads (waking a
processor from deep sleep takes some 600 µs) leaves nothing to say of the first; it does not make
answers as late as the second does, for which a third of what it would take counts against it:
how often it does that is seen too rarely to be counted."""
SOUND_SHARE = 0.05
SOUND_SHARE_MOST = 0.6
SOUND_MEMORY = 100
"""The share for a sound adapter and a busy host: at least, at most, and the answers over which it
is followed. A host that is late more often than that is named itself."""
BUSY_FACTOR = 4.0
BUSY_MOST = 0.1
"""Several times as many answers as a busy host makes late elsewhere may be its own doing (some
fifty reads tell whether it does); beyond the greatest share nothing is said of the adapter."""
HELD_CERTAIN = -log(1e-9)
SOUND_CERTAIN = -log(1e-6)
"""How improbable by chance the evidence must be (Wald's sequential test of the two shares, begun
anew wherever it falls below zero): as for a servo; a verdict is taken back more easily."""
SPACING_NS = 20_000_000
LEAST_NS = 300_000_000
"""A host that is late is so for some time slices: answers closer together are one piece of
evidence, of which each tells its part, and all of it must extend over so long. (The first of some
answers alone would not do: it is the host's wake-up that makes it late.)"""


class LatencyTimer:
    """Whether the adapter of a chain holds answers back.

    Attributes:
        since: Stamp from which on it is known to; 0: it does not.
    """

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._recent: deque[tuple[int, int]] = deque(maxlen=SAMPLES)  # position, delay
        self._tests = [_Test(lateness, min(SERVOS, len(chain))) for lateness in LATENESSES]
        self._begin_ns: int | None = None  # of the answers that are one piece of evidence
        self.since = 0

    def answer(
        self,
        position: int,
        delay_ns: int,
        busy: Sequence[float],
        now_ns: int,
        *,
        at_least: bool = False,
    ) -> None:
        """One servo was asked alone and has answered.

        Args:
            position: In the chain.
            delay_ns: What it took.
            busy: Share of such answers that the host makes late, for each of :data:`LATENESSES`.
            now_ns: Classifier's time.
            at_least: It took longer: nobody listened any more.
        """
        self._piece(busy, now_ns)
        self._recent.append((position, delay_ns))
        for test in self._tests:
            if test.is_held(delay_ns) or not at_least:
                test.add(delay_ns)

    def _piece(self, busy: Sequence[float], now_ns: int) -> None:
        """Weighs the present piece of evidence if another one begins."""
        if self._begin_ns is not None:
            if now_ns - self._begin_ns < SPACING_NS:
                return
            for test, share in zip(self._tests, busy, strict=True):
                test.weigh(share, self._begin_ns, now_ns, self._recent)
        self._begin_ns = now_ns

    def finding(self, stamp: int) -> Finding | None:
        """The verdict."""
        if not any(test.holds for test in self._tests):
            self.since = 0
            return None
        self.since = self.since or stamp
        typical_ms = median(delay for _, delay in self._recent) / 1e6  # at least
        # As the first test counts them, whichever has decided.
        late, chain = self._tests[0].late(self._recent), self._chain
        return Finding(
            "latency_timer",
            component.adapter(chain.bus),
            0.9 if len(chain) > 1 else 0.6,
            self.since,
            f"{len(late)} of {SAMPLES} answers of {len(set(late))} servos come later than "
            f"any servo needs: typically {typical_ms:.1f} ms",
            {"delay_ms": round(typical_ms, 2), "late": len(late)},
            [] if len(chain) > 1 else [chain.servo(0)],
        )


class _Test:
    """Whether answers are held back by so much.

    Args:
        lateness: By how much.
        least: Servos of which some must be.

    Attributes:
        holds: The verdict.
    """

    def __init__(self, lateness: Lateness, least: int) -> None:
        self.holds = False
        self._count = self._held = 0  # answers of the present piece of evidence
        self._answer_ns = lateness.answer_ns
        self._least = least
        self._evidence = 0.0  # that the verdict is wrong
        self._since_ns = 0
        self._held_share = 0.0

    def add(self, delay_ns: int) -> None:
        """An answer to the present piece of evidence."""
        self._count += 1
        self._held += self.is_held(delay_ns)

    def weigh(
        self, busy: float, begin_ns: int, now_ns: int, recent: deque[tuple[int, int]]
    ) -> None:
        """The piece of evidence that began then is complete."""
        if not self._count:
            return
        share = self._held / self._count
        self._count = self._held = 0
        if busy >= BUSY_MOST and not self.holds:
            return  # a verdict may end all the same: no host makes an answer come in time
        if not self._evidence:
            self._since_ns = begin_ns
        sound = max(SOUND_SHARE, self._held_share) + BUSY_FACTOR * busy
        sound = min(sound, SOUND_SHARE_MOST)
        if not self.holds:
            self._held_share += (share - self._held_share) / SOUND_MEMORY
        odds = share * log(HELD_SHARE / sound)
        odds += (1.0 - share) * log((1.0 - HELD_SHARE) / (1.0 - sound))
        if self.holds:
            self._evidence = max(0.0, self._evidence - odds)
            if self._evidence >= SOUND_CERTAIN:
                self.holds, self._evidence = False, 0.0
        else:
            self._evidence = min(max(0.0, self._evidence + odds), HELD_CERTAIN)
            lasting = now_ns - self._since_ns >= LEAST_NS
            if self._evidence >= HELD_CERTAIN and lasting and self._is_shared(recent):
                self.holds, self._evidence = True, 0.0

    def is_held(self, delay_ns: int) -> bool:
        """Whether an adapter may have held an answer back: so late, no later than any does."""
        return self._answer_ns < delay_ns <= HELD_MOST_NS

    def late(self, recent: deque[tuple[int, int]]) -> list[int]:
        """Positions of those whose answers were held back, once for each answer."""
        return [position for position, delay in recent if self.is_held(delay)]

    def _is_shared(self, recent: deque[tuple[int, int]]) -> bool:
        late, asked = self.late(recent), {position for position, _ in recent}
        who = set(late)
        shared = len(who) >= self._least and 2 * len(who) > len(asked)
        return shared and 2 * len(late) > len(recent)
