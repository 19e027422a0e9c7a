"""Response times: a slow servo, a wrong Return Delay Time, the USB latency timer, a late host.

Only requests to one servo measure that servo: in a sync read many answers reach the operating
system in one burst. What a servo needs is compared with its peers on the same bus at the same time,
so baud rate, adapter and host drop out.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from math import ceil, log
from statistics import median, median_low

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_classifier.symptoms import BITS_PER_BYTE
from wackel_protocols.dynamixel2.expectation import SLOWEST_NS
from wackel_schemas import component

SAMPLES = 16
"""Response times kept of each servo."""
LATE_IN_ROW = 3
"""Least number of late answers in a row that makes a servo slow."""
BY_CHANCE = 1e-9
"""How improbable a row of late answers must be by chance: some 10^5 single requests an hour are
made, so this is one false alarm in ten thousand hours."""
LATE_SHARE = 0.001
LATE_SHARE_START = 0.01
LATE_MEMORY = 100
LATE_MEMORY_START = 10
"""A busy host makes any answer late now and then without noticing it, once in a thousand requests
where it is quiet. The share is followed over so many requests, from a cautious start that soon
gives way."""
LATE_ANSWER_NS = 150_000_000
"""Late answers within this time count once: a master that does not wait long enough makes many."""
LEAST_LATE_NS = 60_000
"""What can be told apart from the scatter of a quiet host."""
SCATTER = 8.0
"""How many median deviations late is: five standard deviations of a normal distribution."""
DRIFT_NS = 30_000
"""A slow change that is told: half of what is late at once. Page's test (CUSUM) for a shift by this
adds up what exceeds half of it."""
DRIFT_LEAST = 16
"""So many answers at least, some five seconds, whatever the scatter: what comes and goes is no
drift."""
DRIFT_BASELINE = 64
"""Answers of a servo that tell how it differs from its peers when it is sound."""
DRIFT_PEERS = 9
"""The latest answers on time of all servos, whose median a servo is compared with: the host's own
changes befall all of them alike."""
DRIFT_SCATTER_NS = 5_000
"""At least; firmware loops (thesis, figure 2.7)."""
LATENCY_SAMPLES = 12
LATENCY_SERVOS = 3
"""One slow servo is not the adapter, and neither is a host that delivers some answers late: of the
latest answers most must have been held back, of so many servos (all, if there are fewer) and of
most of those asked."""
LATENCY_LATE = 0.7
"""Share of answers that a latency timer of 4 ms makes that late; a longer one more of them."""
HELD_MOST_NS = SLOWEST_NS + 16_000_000
"""A timer that nobody set runs for 16 ms; what comes later is another's doing, mostly the host's.
"""
SOUND_LATE = 0.05
SOUND_LATE_MOST = 0.6
SOUND_MEMORY = 100
"""The share for a sound adapter and a busy host: at least, at most, and the answers over which it
is followed. A host that is late more often than that is named itself."""
LATENCY_CERTAIN = -log(1e-9)
SOUND_CERTAIN = -log(1e-6)
"""How improbable by chance the evidence must be (Wald's sequential test of the two shares, begun
anew wherever it falls below zero): as for a servo; a verdict is taken back more easily."""
LATENCY_SPACING_NS = 20_000_000
LATENCY_LEAST_NS = 300_000_000
"""A host that is late is so for some time slices: answers closer together are one piece of
evidence, of which each tells its part, and all of it must extend over so long. (The first of some
answers alone would not do: it is the host's wake-up that makes it late.)"""
HOST_BUSY_LAG_NS = SLOWEST_NS // 2
HOST_WAITS = 100
HOST_WAITS_START = 10
HOST_BUSY_START = 0.05
HOST_BUSY_MOST = 0.1
HOST_BUSY_FACTOR = 4.0
"""What makes an answer later than any servo needs. How often the host does is told by the share of
the reads of many in which it overslept by so much, and by the share of the single answers that come
later than any adapter holds them: both over so many, from a cautious start. Several times as many
of the single answers may be its own doing (some fifty reads tell whether it does); beyond the
greatest share nothing is said of the adapter."""
HOST_LATE_NS = 5_000_000
"""Oversleeping that costs a whole cycle at 200 Hz."""
HOST_LATE_TIMES = 3
HOST_WINDOW_NS = 10_000_000_000
HOST_SPOILS_NS = 200_000
"""Response times measured by a host that was late by so much say nothing about the servo."""
REGISTER_UNIT_NS = 2_000
"""Of Return Delay Time (e-manual)."""


@dataclass(slots=True)
class _Drift:
    """How a servo's answers move against its peers'.

    Attributes: ``first`` differences, and ``usual_ns`` their median once they are complete;
    ``excess_ns`` the test's sum, above zero since ``since``; ``moved_ns`` sum and ``count`` of the
    differences since then.
    """

    first: list[float] = field(default_factory=list)
    usual_ns: float = 0.0
    excess_ns: float = 0.0
    since: int = 0
    moved_ns: float = 0.0
    count: int = 0

    def add(self, difference_ns: float, limit_ns: float, stamp: int) -> None:
        """Takes in a difference from the peers."""
        if len(self.first) < DRIFT_BASELINE:
            self.first.append(difference_ns)
            if len(self.first) == DRIFT_BASELINE:
                self.usual_ns = median(self.first)
            return
        moved_ns = max(-LEAST_LATE_NS, min(difference_ns - self.usual_ns, LEAST_LATE_NS))
        if not self.excess_ns:
            self.since, self.moved_ns, self.count = stamp, 0.0, 0
        self.moved_ns += moved_ns
        self.count += 1
        excess_ns = self.excess_ns + min(moved_ns, DRIFT_NS) - DRIFT_NS / 2
        # What exceeds the limit is not saved up: a repair shall show.
        self.excess_ns = max(0.0, min(excess_ns, limit_ns + LEAST_LATE_NS))


class _Share:
    """How often something happens, of late."""

    def __init__(self) -> None:
        self.value = HOST_BUSY_START
        self._memory = HOST_WAITS_START

    def happened(self) -> None:
        """Once."""
        self.value += 1.0 / self._memory

    def had_chances(self, count: int) -> None:
        """It could have happened so often."""
        self.value *= (1.0 - 1.0 / self._memory) ** count
        self._memory = min(self._memory + count, HOST_WAITS)


@dataclass(slots=True)
class _Servo:
    """Attributes: ``delays`` the latest; ``late`` answers in a row that came late although another
    servo's just before had not, less those where it had, since ``late_since``; ``on_time`` answers
    in a row after these; ``register`` Return Delay Time, since ``register_since``;
    ``after_time_out`` answers that came when nobody listened, the last at ``after_time_out_ns``.
    """

    delays: deque[int] = field(default_factory=lambda: deque(maxlen=SAMPLES))
    late: int = 0
    late_since: int = 0
    on_time: int = 0
    register: int | None = None
    register_since: int = 0
    after_time_out: int = 0
    after_time_out_ns: int = -LATE_ANSWER_NS
    drift: _Drift = field(default_factory=_Drift)

    def own(self, delay: int) -> int:
        """A delay without the part that the servo was told to wait."""
        return delay if self.register is None else delay - self.register * REGISTER_UNIT_NS

    def clear(self) -> None:
        """It is not slow, or what was seen says nothing about it."""
        self.late = self.on_time = 0


class Timing:
    """Follows response times and Return Delay Time registers.

    Attributes:
        waits: Reads of many servos, in which the host's own lateness shows, since the last of one;
            counted by the owner.
    """

    def __init__(self, chain: Chain, return_delay_us: int | None) -> None:
        self._chain = chain
        self._configured = None if return_delay_us is None else return_delay_us // 2
        self._servos = [_Servo() for _ in range(len(chain))]
        self._usual_ns = 0.0
        self._scatter_ns = 0.0
        self._drift_limit_ns = _drift_limit_ns(0.0)
        self._late_share = LATE_SHARE_START
        self._late_memory = LATE_MEMORY_START
        self._late_in_row = _row(LATE_SHARE_START)
        self._latest: tuple[int, bool] = (-1, False)  # position, whether it was late
        self._peers: deque[int] = deque(maxlen=DRIFT_PEERS)
        self._other_late = False  # whether the latest answer of another servo than that was late
        self._adapter = _Adapter(len(chain))
        self._latency_since = 0
        self.waits = 0
        self._overslept = _Share()
        self._beyond = _Share()
        self._host: deque[tuple[int, int, int]] = deque(maxlen=HOST_LATE_TIMES)

    def response(  # noqa: PLR0917
        self,
        position: int,
        response_ns: int,
        answer_bytes: int,
        baud_rate: int,
        now_ns: int,
        stamp: int,
    ) -> None:
        """One servo was asked alone and has answered.

        Args:
            position: In the chain.
            response_ns: From the end of the instruction to the end of the answer.
            answer_bytes: Its length.
            baud_rate: Bit/s.
            now_ns: Classifier's time.
            stamp: Of the transaction.
        """
        delay = response_ns - answer_bytes * BITS_PER_BYTE * 1_000_000_000 // max(baud_rate, 1)
        self._ask_adapter(position, delay, now_ns)
        if self._latency_since:
            return  # what is measured through such an adapter tells nothing about single servos
        servo = self._servos[position]
        servo.delays.append(delay)
        own = servo.own(delay)
        late = bool(self._usual_ns) and own > self._usual_ns + self._margin()
        self._judge(position, late, stamp)
        if not late and self._usual_ns:
            self._peers.append(own)
            servo.drift.add(own - median(self._peers), self._drift_limit_ns, stamp)
        if servo.late < LATE_IN_ROW:  # what is slow by itself says nothing of the host
            self._late_share += (late - self._late_share) / self._late_memory
            self._late_memory = min(self._late_memory + 1, LATE_MEMORY)

    def _judge(self, position: int, late: bool, stamp: int) -> None:
        latest, was_late = self._latest
        if latest != position:
            self._other_late = was_late
        self._latest = position, late
        servo = self._servos[position]
        if not late:
            servo.on_time += 1
            if servo.late < self._late_in_row or servo.on_time >= LATE_IN_ROW:
                servo.clear()
        elif self._other_late:  # it may be the host or the adapter, for all alike
            if 0 < servo.late < self._late_in_row:
                servo.late -= 1
        else:
            servo.on_time = 0
            if not servo.late:
                servo.late_since = stamp
            servo.late += 1

    def late_answer(self, position: int, now_ns: int, stamp: int) -> None:
        """A servo has answered when the host no longer listened."""
        self._ask_adapter(position, SLOWEST_NS + 1, now_ns)
        servo = self._servos[position]
        servo.after_time_out += 1
        if now_ns - servo.after_time_out_ns >= LATE_ANSWER_NS and not self._latency_since:
            servo.after_time_out_ns = now_ns
            self._judge(position, True, stamp)

    def register(self, position: int, value: int, stamp: int) -> None:
        """Return Delay Time was read."""
        servo = self._servos[position]
        if servo.register != value:
            servo.register = value
            servo.register_since = stamp
            # What was measured with another delay tells nothing about this one.
            servo.clear()
            servo.delays.clear()
            servo.drift = _Drift()

    def host_lag(self, lag_ns: int, now_ns: int, stamp: int) -> None:
        """The host was late by so much, at least :data:`HOST_SPOILS_NS`."""
        if lag_ns >= HOST_BUSY_LAG_NS:
            self._overslept.happened()
        if lag_ns >= HOST_LATE_NS:
            self._host.append((now_ns, lag_ns, stamp))

    def gone(self, position: int) -> None:
        """A servo is out of reach."""
        self._servos[position].clear()

    def tick(self) -> None:
        """Works out what is usual; call some times a second."""
        if self._latency_since:
            return
        known = [(s, [s.own(delay) for delay in s.delays]) for s in self._servos if s.delays]
        if not known:
            return
        typical = [median(delays) for _, delays in known]
        # Of two, the quicker one is usual.
        self._usual_ns = max(1.0, median_low(typical))
        self._scatter_ns = median(
            abs(delay - middle)
            for (_, delays), middle in zip(known, typical, strict=True)
            for delay in delays
        )
        self._drift_limit_ns = _drift_limit_ns(self._scatter_ns)
        self._late_in_row = _row(self._late_share)

    def findings(self, now_ns: int, stamp: int) -> list[Finding]:
        """What is slow, and why."""
        findings = self._host_findings(now_ns)
        wrong = self._wrong_registers()
        findings += wrong
        latency = self._latency(stamp)
        if latency is not None:
            return [*findings, latency]
        explained = {finding.component for finding in wrong}
        slow = [place for place, servo in enumerate(self._servos) if servo.late]
        if not self._most(slow):
            findings += [
                self._slow(place)
                for place in slow
                if self._servos[place].late >= self._late_in_row
                and self._chain.servo(place) not in explained
            ]
        limit_ns = self._drift_limit_ns
        drifting = [p for p, servo in enumerate(self._servos) if servo.drift.excess_ns >= limit_ns]
        if not self._most(drifting):
            explained.update(finding.component for finding in findings)
            findings += [
                self._drifting(place)
                for place in drifting
                if self._chain.servo(place) not in explained
            ]
        return findings

    def _most(self, places: list[int]) -> bool:
        """Whether most of the servos are concerned: then it is none of them."""
        return 2 * len(places) > max(2, len(self._chain))

    def _margin(self) -> float:
        return max(LEAST_LATE_NS, SCATTER * self._scatter_ns)

    def _ask_adapter(self, position: int, delay: int, now_ns: int) -> None:
        """What a delay says of the adapter, unless the host is too busy to tell."""
        self._overslept.had_chances(self.waits)
        self.waits = 0
        self._beyond.had_chances(1)
        if delay > HELD_MOST_NS:
            self._beyond.happened()
        busy = max(self._overslept.value, self._beyond.value)
        if busy < HOST_BUSY_MOST:
            self._adapter.answer(position, delay, HOST_BUSY_FACTOR * busy, now_ns)

    def _slow(self, position: int) -> Finding:
        servo = self._servos[position]
        values: dict[str, float | int | str] = {
            "late_in_row": servo.late,
            "usual_us": round(self._usual_ns / 1e3, 1),
        }
        summary = f"{servo.late} answers in a row came late"
        if servo.delays:
            recent = median(list(servo.delays)[-LATE_IN_ROW:])
            values["delay_us"] = round(recent / 1e3, 1)
            summary += f": {recent / 1e3:.0f} µs, its peers need {self._usual_ns / 1e3:.0f} µs"
        if servo.after_time_out:
            values["after_time_out"] = servo.after_time_out
        if servo.register is not None:
            values["return_delay_register"] = servo.register
        return Finding(
            "slow_servo", self._chain.servo(position), 0.9, servo.late_since, summary, values
        )

    def _drifting(self, position: int) -> Finding:
        drift = self._servos[position].drift
        moved_us = drift.moved_ns / max(drift.count, 1) / 1e3
        return Finding(
            "slow_servo",
            self._chain.servo(position),
            0.8,
            drift.since,
            f"its answers have drifted: {drift.count} of them came {moved_us:.0f} µs later than its"
            " first ones, against its peers",
            {"drift_us": round(moved_us, 1), "answers": drift.count},
        )

    def _wrong_registers(self) -> list[Finding]:
        right = self._configured
        if right is None:
            known = [servo.register for servo in self._servos if servo.register is not None]
            if len(known) < 3:
                return []
            right, votes = Counter(known).most_common(1)[0]
            if votes * 3 < len(known) * 2:
                return []
        return [
            Finding(
                "return_delay",
                self._chain.servo(position),
                0.99,
                servo.register_since,
                f"register Return Delay Time holds {servo.register} ({2 * servo.register} µs), "
                f"it should hold {right} ({2 * right} µs)",
                {"return_delay_register": servo.register, "expected_register": right},
            )
            for position, servo in enumerate(self._servos)
            if servo.register is not None and servo.register != right
        ]

    def _latency(self, stamp: int) -> Finding | None:
        adapter = self._adapter
        if not adapter.holds:
            self._latency_since = 0
            return None
        if not self._latency_since:
            self._latency_since = stamp
            for servo in self._servos:
                servo.clear()
        typical = adapter.typical_ns() / 1e6  # at least, if answers came too late
        late = adapter.late()
        return Finding(
            "latency_timer",
            component.adapter(self._chain.bus),
            0.9 if len(self._chain) > 1 else 0.6,
            self._latency_since,
            f"{len(late)} of {LATENCY_SAMPLES} answers of {len(set(late))} servos come later than "
            f"any servo needs: typically {typical:.1f} ms",
            {"delay_ms": round(typical, 2), "late": len(late)},
            [] if len(self._chain) > 1 else [self._chain.servo(0)],
        )

    def _host_findings(self, now_ns: int) -> list[Finding]:
        host = self._host
        while host and now_ns - host[0][0] > HOST_WINDOW_NS:
            host.popleft()
        if len(host) < HOST_LATE_TIMES:
            return []
        longest = max(lag for _, lag, _ in host) / 1e6
        return [
            Finding(
                "host_lag",
                component.bus(self._chain.bus),
                0.95,
                host[0][2],
                f"the host overslept by up to {longest:.1f} ms, {len(host)} times within "
                f"{HOST_WINDOW_NS / 1e9:.0f} s",
                {"longest_ms": round(longest, 2)},
            )
        ]


class _Adapter:
    """Whether the adapter holds answers back.

    Attributes:
        holds: The verdict.
    """

    holds = False

    def __init__(self, servos: int) -> None:
        self._least = min(LATENCY_SERVOS, servos)
        self._recent: deque[tuple[int, int]] = deque(maxlen=LATENCY_SAMPLES)  # position, delay
        self._evidence = 0.0  # that the verdict is wrong
        self._since_ns = 0
        self._begin_ns = 0  # of the answers that are one piece of evidence
        self._count = self._held = 0  # of these
        self._held_share = 0.0

    def answer(self, position: int, delay: int, host_share: float, now_ns: int) -> None:
        """An answer; ``host_share`` of them may be late because the host was late just now."""
        if self._count and now_ns - self._begin_ns >= LATENCY_SPACING_NS:
            self._weigh(self._held / self._count, host_share, now_ns)
            self._count = self._held = 0
        if not self._count:
            self._begin_ns = now_ns
        self._recent.append((position, delay))
        self._count += 1
        self._held += _is_held(delay)

    def _weigh(self, share: float, host_share: float, now_ns: int) -> None:
        """A piece of evidence, in which this share of the answers was held back."""
        if not self._evidence:
            self._since_ns = self._begin_ns
        sound = min(max(SOUND_LATE, self._held_share) + host_share, SOUND_LATE_MOST)
        if not self.holds:
            self._held_share += (share - self._held_share) / SOUND_MEMORY
        odds = share * log(LATENCY_LATE / sound)
        odds += (1.0 - share) * log((1.0 - LATENCY_LATE) / (1.0 - sound))
        if self.holds:
            self._evidence = max(0.0, self._evidence - odds)
            if self._evidence >= SOUND_CERTAIN:
                self.holds, self._evidence = False, 0.0
        else:
            self._evidence = min(max(0.0, self._evidence + odds), LATENCY_CERTAIN)
            lasting = now_ns - self._since_ns >= LATENCY_LEAST_NS
            if self._evidence >= LATENCY_CERTAIN and lasting and self._is_shared():
                self.holds, self._evidence = True, 0.0

    def late(self) -> list[int]:
        """Positions of those whose answers were held back, once for each answer."""
        return [position for position, delay in self._recent if _is_held(delay)]

    def typical_ns(self) -> float:
        """Median of the latest."""
        return median(delay for _, delay in self._recent)

    def _is_shared(self) -> bool:
        late = set(self.late())
        asked = {position for position, _ in self._recent}
        shared = len(late) >= self._least and 2 * len(late) > len(asked)
        return shared and 2 * len(self.late()) > len(self._recent)


def _is_held(delay: int) -> bool:
    """Whether an adapter may have held an answer back: later than any servo needs, no later."""
    return SLOWEST_NS < delay <= HELD_MOST_NS


def _drift_limit_ns(scatter_ns: float) -> float:
    """Where chance alone gets once in 1 / :data:`BY_CHANCE` answers (Wald's approximation)."""
    deviation_ns = max(DRIFT_SCATTER_NS, 1.5 * scatter_ns)  # of a normal distribution
    by_chance_ns = -log(BY_CHANCE) * deviation_ns**2 / DRIFT_NS
    return max(by_chance_ns, DRIFT_LEAST * DRIFT_NS / 2)


def _row(share: float) -> int:
    """How many late answers in a row chance does not explain where such a share is late."""
    return max(LATE_IN_ROW, ceil(log(BY_CHANCE) / log(min(max(share, LATE_SHARE), 0.5))))
