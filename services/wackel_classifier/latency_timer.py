"""A USB latency timer that is not set: the adapter holds answers back until it has run out."""

from collections import deque
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
"""Share of answers that a latency timer of 4 ms makes that late; a longer one more of them."""
HELD_MOST_NS = SLOWEST_NS + 16_000_000
"""A timer that nobody set runs for 16 ms; what comes later is another's doing, mostly the host's.
"""
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
        self._least = min(SERVOS, len(chain))
        self._recent: deque[tuple[int, int]] = deque(maxlen=SAMPLES)  # position, delay
        self._holds = False
        self.since = 0
        self._evidence = 0.0  # that the verdict is wrong
        self._since_ns = 0
        self._begin_ns = 0  # of the answers that are one piece of evidence
        self._count = self._held = 0  # of these
        self._held_share = 0.0

    def answer(self, position: int, delay_ns: int, busy: float, now_ns: int) -> None:
        """One servo was asked alone and has answered.

        Args:
            position: In the chain.
            delay_ns: What it took.
            busy: Share of such answers that the host makes late.
            now_ns: Classifier's time.
        """
        if busy >= BUSY_MOST:
            return
        if self._count and now_ns - self._begin_ns >= SPACING_NS:
            self._weigh(self._held / self._count, BUSY_FACTOR * busy, now_ns)
            self._count = self._held = 0
        if not self._count:
            self._begin_ns = now_ns
        self._recent.append((position, delay_ns))
        self._count += 1
        self._held += _is_held(delay_ns)

    def finding(self, stamp: int) -> Finding | None:
        """The verdict."""
        if not self._holds:
            self.since = 0
            return None
        self.since = self.since or stamp
        typical_ms = median(delay for _, delay in self._recent) / 1e6  # at least
        late, chain = self._late(), self._chain
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

    def _weigh(self, share: float, busy: float, now_ns: int) -> None:
        """A piece of evidence, in which this share of the answers was held back."""
        if not self._evidence:
            self._since_ns = self._begin_ns
        sound = min(max(SOUND_SHARE, self._held_share) + busy, SOUND_SHARE_MOST)
        if not self._holds:
            self._held_share += (share - self._held_share) / SOUND_MEMORY
        odds = share * log(HELD_SHARE / sound)
        odds += (1.0 - share) * log((1.0 - HELD_SHARE) / (1.0 - sound))
        if self._holds:
            self._evidence = max(0.0, self._evidence - odds)
            if self._evidence >= SOUND_CERTAIN:
                self._holds, self._evidence = False, 0.0
        else:
            self._evidence = min(max(0.0, self._evidence + odds), HELD_CERTAIN)
            lasting = now_ns - self._since_ns >= LEAST_NS
            if self._evidence >= HELD_CERTAIN and lasting and self._is_shared():
                self._holds, self._evidence = True, 0.0

    def _late(self) -> list[int]:
        """Positions of those whose answers were held back, once for each answer."""
        return [position for position, delay in self._recent if _is_held(delay)]

    def _is_shared(self) -> bool:
        late, asked = self._late(), {position for position, _ in self._recent}
        who = set(late)
        shared = len(who) >= self._least and 2 * len(who) > len(asked)
        return shared and 2 * len(late) > len(self._recent)


def _is_held(delay_ns: int) -> bool:
    """Whether an adapter may have held an answer back: later than any servo needs, no later."""
    return SLOWEST_NS < delay_ns <= HELD_MOST_NS
