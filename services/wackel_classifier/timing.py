"""Response times: servos that are slow, now or more and more, and why.

Only requests to one servo measure that servo: in a sync read many answers reach the operating
system in one burst. What a servo needs is compared with its peers on the same bus at the same time,
so baud rate, adapter and host drop out. An adapter (:mod:`wackel_classifier.latency_timer`) or a
host (:mod:`wackel_classifier.host_lag`) that is late is told from them, and so is the register of
a wrong Return Delay Time.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from math import ceil, log
from statistics import median, median_low

from wackel_classifier.chain import Chain
from wackel_classifier.drift import BY_CHANCE, Drift, drift_limit_ns
from wackel_classifier.findings import Finding
from wackel_classifier.host_lag import HostLag
from wackel_classifier.latency_timer import LatencyTimer
from wackel_classifier.symptoms import BITS_PER_BYTE
from wackel_protocols.dynamixel2.expectation import SLOWEST_NS

SAMPLES = 16
"""Response times kept of each servo."""
LATE_IN_ROW = 3
"""Least number of late answers in a row that makes a servo slow."""
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
PEERS = 9
"""The latest answers on time of all servos, whose median a servo's drift is compared with: the
host's own changes befall all of them alike."""
LEAST_VOTES = 3
"""Registers that must be known to tell what they should hold, where nobody has configured it."""
REGISTER_UNIT_NS = 2_000
"""Of Return Delay Time (e-manual)."""


@dataclass(slots=True)
class _Servo:
    """Attributes: ``delays`` the latest; ``late`` answers in a row that came late although another
    servo's just before had not, less those where it had, since ``late_since``; ``on_time`` answers
    in a row after these; ``register`` Return Delay Time, since ``register_since``, ``fresh`` while
    it must still be that; ``expected`` what it should hold instead;
    ``after_time_out`` answers that came when nobody listened, the last at ``after_time_out_ns``.
    """

    delays: deque[int] = field(default_factory=lambda: deque(maxlen=SAMPLES))
    late: int = 0
    late_since: int = 0
    on_time: int = 0
    register: int | None = None
    register_since: int = 0
    fresh: bool = False
    expected: int | None = None
    after_time_out: int = 0
    after_time_out_ns: int = -LATE_ANSWER_NS
    drift: Drift = field(default_factory=Drift)

    def own(self, delay: int) -> int:
        """A delay without the part that the servo was told to wait."""
        return delay if self.register is None else delay - self.register * REGISTER_UNIT_NS

    def clear(self) -> None:
        """It is not slow, or what was seen says nothing about it."""
        self.late = self.on_time = 0


class Timing:
    """Follows response times and Return Delay Time registers.

    Attributes:
        host: What is known of the host, which its owner tells.
    """

    def __init__(self, chain: Chain, return_delay_us: int | None) -> None:
        self._chain = chain
        self._configured = None if return_delay_us is None else return_delay_us // 2
        self._servos = [_Servo() for _ in range(len(chain))]
        self._usual_ns = 0.0
        self._scatter_ns = 0.0
        self._drift_limit_ns = drift_limit_ns(0.0)
        self._late_share = LATE_SHARE_START
        self._late_memory = LATE_MEMORY_START
        self._late_in_row = _row(LATE_SHARE_START)
        self._latest: tuple[int, bool] = (-1, False)  # position, whether it was late
        self._peers: deque[int] = deque(maxlen=PEERS)
        self._other_late = False  # whether the latest answer of another servo than that was late
        self._adapter = LatencyTimer(chain)
        self.host = HostLag(chain.bus)

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
        self._adapter.answer(position, delay, self.host.busy(delay), now_ns)
        if self._adapter.since:
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
        after_ns = SLOWEST_NS + 1
        busy = self.host.busy(after_ns)
        self._adapter.answer(position, after_ns, busy, now_ns, at_least=True)
        servo = self._servos[position]
        servo.after_time_out += 1
        if now_ns - servo.after_time_out_ns >= LATE_ANSWER_NS and not self._adapter.since:
            servo.after_time_out_ns = now_ns
            self._judge(position, True, stamp)

    def register(self, position: int, value: int, stamp: int) -> None:
        """Return Delay Time was read."""
        servo = self._servos[position]
        servo.fresh = True
        if servo.register != value:
            servo.register = value
            servo.register_since = stamp
            servo.expected = None
            # What was measured with another delay tells nothing about this one.
            servo.clear()
            servo.delays.clear()
            servo.drift = Drift()

    def unwatched(self) -> None:
        """Nothing was heard for so long that servos may have been exchanged, or set otherwise."""
        for servo in self._servos:
            servo.fresh = False

    def gone(self, position: int) -> None:
        """A servo is out of reach."""
        self._servos[position].clear()

    def tick(self) -> None:
        """Works out what is usual; call some times a second."""
        if self._adapter.since:
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
        self._drift_limit_ns = drift_limit_ns(self._scatter_ns)
        self._late_in_row = _row(self._late_share)

    def findings(self, now_ns: int, stamp: int) -> list[Finding]:
        """What is slow, and why."""
        wrong = self._wrong_registers()
        findings = [*self.host.findings(now_ns), *wrong]
        known = self._adapter.since
        latency = self._adapter.finding(stamp)
        if latency is not None:
            if not known:
                for servo in self._servos:
                    servo.clear()
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
        fresh = [servo for servo in self._servos if servo.fresh]
        if self._configured is not None or len(fresh) >= LEAST_VOTES:
            right = self._right_register([servo.register for servo in fresh])
            for servo in fresh:
                servo.expected = right if servo.register != right else None
        return [
            Finding(
                "return_delay",
                self._chain.servo(position),
                0.99,
                servo.register_since,
                f"register Return Delay Time holds {servo.register} ({2 * servo.register} µs), "
                f"it should hold {servo.expected} ({2 * servo.expected} µs)",
                {"return_delay_register": servo.register, "expected_register": servo.expected},
                words={"held": str(servo.register), "expected": str(servo.expected)},
            )
            for position, servo in enumerate(self._servos)
            if servo.register is not None and servo.expected is not None
        ]

    def _right_register(self, known: list[int | None]) -> int | None:
        """What registers should hold: as configured, or as most do; ``None`` if neither is so."""
        if self._configured is not None:
            return self._configured
        right, votes = Counter(known).most_common(1)[0]
        return right if votes * 3 >= len(known) * 2 else None


def _row(share: float) -> int:
    """How many late answers in a row chance does not explain where such a share is late."""
    return max(LATE_IN_ROW, ceil(log(BY_CHANCE) / log(min(max(share, LATE_SHARE), 0.5))))
