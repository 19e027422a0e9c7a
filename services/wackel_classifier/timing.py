"""Response times: a slow servo, a wrong Return Delay Time, the USB latency timer, a late host.

Only requests to one servo measure that servo: in a sync read many answers reach the operating
system in one burst. What a servo needs is compared with its peers on the same bus at the same time,
so baud rate, adapter and host drop out.
"""

from collections import Counter, deque
from math import ceil, log
from statistics import median, median_low

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_classifier.symptoms import BITS_PER_BYTE
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
"""A busy host makes any answer late now and then without noticing it, once in a thousand requests
where it is quiet. The share is followed over so many requests, from a cautious start."""
LATE_ANSWER_NS = 150_000_000
"""Late answers within this time count once: a master that does not wait long enough makes many."""
LEAST_LATE_NS = 60_000
"""What can be told apart from the scatter of a quiet host."""
SCATTER = 8.0
"""How many median deviations late is: five standard deviations of a normal distribution."""
SLOWEST_NS = 1_200_000
"""No servo at work needs longer: Return Delay Time at most 508 µs, processing and USB frame some
600 µs more (thesis, 2.7: 672 µs with a delay of 500 µs; 1000 µs with a latency timer of 1 ms)."""
LATENCY_SAMPLES = 12
LATENCY_SHARE = 0.75
LATENCY_SERVOS = 3
"""At least three quarters of the latest answers must be that late, of at least three servos (all,
if there are fewer): one slow servo is not the adapter. Small buses need two of each."""
HOST_LATE_NS = 5_000_000
"""Oversleeping that costs a whole cycle at 200 Hz."""
HOST_LATE_TIMES = 3
HOST_WINDOW_NS = 10_000_000_000
HOST_SPOILS_NS = 200_000
"""Response times measured by a host that was late by so much say nothing about the servo."""
REGISTER_UNIT_NS = 2_000
"""Of Return Delay Time (e-manual)."""


class Timing:
    """Follows response times and Return Delay Time registers."""

    def __init__(self, chain: Chain, return_delay_us: int | None) -> None:
        self._chain = chain
        self._configured = None if return_delay_us is None else return_delay_us // 2
        size = len(chain)
        self._delays: list[deque[int]] = [deque(maxlen=SAMPLES) for _ in range(size)]
        self._late: list[int] = [0] * size
        self._late_since: list[int] = [0] * size
        self._registers: list[int | None] = [None] * size
        self._register_since: list[int] = [0] * size
        samples = min(LATENCY_SAMPLES, max(4, 2 * size))
        self._recent: deque[tuple[int, int]] = deque(maxlen=samples)  # position, delay
        self._usual_ns = 0.0
        self._scatter_ns = 0.0
        self._latency_since = 0
        self._host: deque[tuple[int, int, int]] = deque(maxlen=HOST_LATE_TIMES)
        self._late_share = LATE_SHARE_START
        self._late_in_row = _row(LATE_SHARE_START)
        self._late_answers = [0] * size
        self._late_answer_ns = [-LATE_ANSWER_NS] * size

    @property
    def suspicious(self) -> bool:
        """Whether anything is slower than it should be."""
        return bool(self._host or self._latency_since) or any(self._late)

    def response(
        self, position: int, response_ns: int, answer_bytes: int, baud_rate: int, stamp: int
    ) -> None:
        """One servo was asked alone and has answered.

        Args:
            position: In the chain.
            response_ns: From the end of the instruction to the end of the answer.
            answer_bytes: Its length.
            baud_rate: Bit/s.
            stamp: Of the transaction.
        """
        delay = response_ns - answer_bytes * BITS_PER_BYTE * 1_000_000_000 // max(baud_rate, 1)
        self._recent.append((position, delay))
        self._delays[position].append(delay)
        own = self._own(position, delay)
        late = bool(self._usual_ns) and own > self._usual_ns + self._margin()
        if late:
            if not self._late[position]:
                self._late_since[position] = stamp
            self._late[position] += 1
        else:
            self._late[position] = 0
        if self._late[position] < LATE_IN_ROW:  # what is slow by itself says nothing of the host
            self._late_share += (late - self._late_share) / LATE_MEMORY

    def late_answer(self, position: int, now_ns: int, stamp: int) -> None:
        """A servo has answered when the host no longer listened."""
        self._recent.append((position, SLOWEST_NS + 1))
        self._late_answers[position] += 1
        if now_ns - self._late_answer_ns[position] < LATE_ANSWER_NS:
            return
        self._late_answer_ns[position] = now_ns
        if not self._late[position]:
            self._late_since[position] = stamp
        self._late[position] += 1

    def register(self, position: int, value: int, stamp: int) -> None:
        """Return Delay Time was read."""
        if self._registers[position] != value:
            self._registers[position] = value
            self._register_since[position] = stamp
            # What was measured with another delay tells nothing about this one.
            self._late[position] = 0
            self._delays[position].clear()

    def host_lag(self, lag_ns: int, now_ns: int, stamp: int) -> None:
        """The host was late by so much."""
        if lag_ns >= HOST_LATE_NS:
            self._host.append((now_ns, lag_ns, stamp))

    def gone(self, position: int) -> None:
        """A servo is out of reach."""
        self._late[position] = 0

    def tick(self) -> None:
        """Works out what is usual; call some times a second."""
        typical = [
            median(self._own(position, delay) for delay in delays)
            for position, delays in enumerate(self._delays)
            if delays
        ]
        if not typical:
            return
        # Of two, the quicker one is usual.
        self._usual_ns = max(1.0, median_low(typical))
        deviations = [
            abs(self._own(position, delay) - middle)
            for (position, delays), middle in zip(
                ((p, d) for p, d in enumerate(self._delays) if d), typical, strict=True
            )
            for delay in delays
        ]
        self._scatter_ns = median(deviations)
        self._late_in_row = _row(self._late_share)

    def findings(self, now_ns: int, stamp: int) -> list[Finding]:
        """What is slow, and why."""
        findings = self._host_findings(now_ns)
        latency = self._latency(stamp)
        wrong = self._wrong_registers()
        findings += wrong
        if latency is not None:
            # What is measured through such an adapter tells nothing about single servos.
            self._late = [0] * len(self._chain)
            return [*findings, latency]
        if 2 * sum(count > 0 for count in self._late) > max(2, len(self._chain)):
            return findings  # whatever it is, most of them share it
        explained = {finding.component for finding in wrong}
        for position, count in enumerate(self._late):
            if count >= LATE_IN_ROW and self._chain.servo(position) not in explained:
                findings.append(self._slow(position, self._chain.servo(position)))
        return findings

    def _own(self, position: int, delay: int) -> int:
        """A delay without the part that the servo was told to wait."""
        register = self._registers[position]
        return delay if register is None else delay - register * REGISTER_UNIT_NS

    def _margin(self) -> float:
        return max(LEAST_LATE_NS, SCATTER * self._scatter_ns)

    def _slow(self, position: int, servo: str) -> Finding:
        delays = self._delays[position]
        values: dict[str, float | int | str] = {
            "late_in_row": self._late[position],
            "usual_us": round(self._usual_ns / 1e3, 1),
        }
        summary = f"{self._late[position]} answers in a row came late"
        if delays:
            recent = median(list(delays)[-LATE_IN_ROW:])
            values["delay_us"] = round(recent / 1e3, 1)
            summary += f": {recent / 1e3:.0f} µs, its peers need {self._usual_ns / 1e3:.0f} µs"
        if self._late_answers[position]:
            values["after_time_out"] = self._late_answers[position]
        register = self._registers[position]
        if register is not None:
            values["return_delay_register"] = register
        return Finding("slow_servo", servo, 0.9, self._late_since[position], summary, values)

    def _wrong_registers(self) -> list[Finding]:
        known = [value for value in self._registers if value is not None]
        right = self._configured
        if right is None:
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
                self._register_since[position],
                f"register Return Delay Time holds {value} ({2 * value} µs), "
                f"it should hold {right} ({2 * right} µs)",
                {"return_delay_register": value, "expected_register": right},
            )
            for position, value in enumerate(self._registers)
            if value is not None and value != right
        ]

    def _latency(self, stamp: int) -> Finding | None:
        recent = self._recent
        late = [position for position, delay in recent if delay > SLOWEST_NS]
        needed = min(LATENCY_SERVOS, len(self._chain))
        if (
            len(recent) < (recent.maxlen or 0)
            or len(late) < LATENCY_SHARE * len(recent)
            or len(set(late)) < needed
        ):
            if self._latency_since:
                for delays in self._delays:
                    delays.clear()
            self._latency_since = 0
            return None
        self._latency_since = self._latency_since or stamp
        typical = median(delay for _, delay in recent) / 1e6  # at least, if answers came too late
        return Finding(
            "latency_timer",
            component.adapter(self._chain.bus),
            0.9 if len(self._chain) > 1 else 0.6,
            self._latency_since,
            f"{len(late)} of {len(recent)} answers of {len(set(late))} servos come later than any "
            f"servo needs: typically {typical:.1f} ms",
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


def _row(share: float) -> int:
    """How many late answers in a row chance does not explain where such a share is late."""
    return max(LATE_IN_ROW, ceil(log(BY_CHANCE) / log(min(max(share, LATE_SHARE), 0.5))))
