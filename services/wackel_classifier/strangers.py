"""What should not be on the bus at all: unknown servos, doubled ids, another master."""

from dataclasses import dataclass

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_protocols.dynamixel2.packet import MAX_ID
from wackel_schemas import component

TIMES = 3
"""Answers that nobody expected, of one id, before it counts: a late answer comes once."""
FORGET_NS = 10_000_000_000
UNEXPLAINED = 20
"""Transactions with foreign bytes and without any explanation before that is told; single ones are
of no use to anybody, and a fault that stays makes so many soon."""


@dataclass(slots=True)
class _Seen:
    times: int
    last_ns: int
    since: int


class Strangers:
    """Counts them, by id and by kind."""

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._servos: dict[int, _Seen] = {}
        self._masters = _Seen(0, 0, 0)
        self._unexplained = _Seen(0, 0, 0)

    def servo(self, servo_id: int, now_ns: int, stamp: int) -> None:
        """An answer of an id that is not configured, or a second answer to one request."""
        if servo_id > MAX_ID:
            return  # a fast answer that came late: it carries the broadcast id
        seen = self._servos.setdefault(servo_id, _Seen(0, now_ns, stamp))
        _again(seen, now_ns, stamp)

    def master(self, now_ns: int, stamp: int) -> None:
        """An instruction packet that the host did not send, or its own echo."""
        _again(self._masters, now_ns, stamp)

    def unexplained(self, now_ns: int, stamp: int) -> None:
        """A transaction with foreign bytes that nothing explains."""
        _again(self._unexplained, now_ns, stamp)

    def explained(self) -> None:
        """There is an explanation now."""
        self._unexplained.times = 0

    def findings(self, now_ns: int) -> list[Finding]:
        """What has been seen often enough."""
        chain, findings = self._chain, []
        for servo_id, seen in list(self._servos.items()):
            if now_ns - seen.last_ns > FORGET_NS:
                del self._servos[servo_id]
            elif seen.times >= TIMES:
                known = servo_id in chain.position
                findings.append(
                    Finding(
                        "duplicate_id" if known else "unexpected_servo",
                        component.servo(chain.bus, servo_id),
                        0.9,
                        seen.since,
                        f"id {servo_id} answered twice to one request, {seen.times} times"
                        if known
                        else f"{seen.times} answers of id {servo_id}, which is not configured",
                        {"answers": seen.times},
                    )
                )
        for seen, what, least in (
            (self._masters, "instruction packets that are not the host's own", TIMES),
            (self._unexplained, "transactions with bytes that fit no known fault", UNEXPLAINED),
        ):
            if seen.times and now_ns - seen.last_ns > FORGET_NS:
                seen.times = 0
            elif seen.times >= least:
                findings.append(
                    Finding(
                        "unclassified",
                        component.bus(chain.bus),
                        0.5,
                        seen.since,
                        f"{seen.times} {what}",
                        {"times": seen.times},
                    )
                )
        return findings


def _again(seen: _Seen, now_ns: int, stamp: int) -> None:
    if not seen.times or now_ns - seen.last_ns > FORGET_NS:
        seen.times, seen.since = 0, stamp
    seen.times += 1
    seen.last_ns = now_ns
