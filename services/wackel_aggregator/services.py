"""Who is alive: a status for each service, from its heartbeat and its liveliness token.

The token tells that the process is there, the heartbeat that its main loop turns; only together
they tell a hung service from a dead one.
"""

from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Literal

from wackel_aggregator.faults import Voice
from wackel_aggregator.transitions import TransitionLog
from wackel_node.clock import Instant
from wackel_schemas.health import Heartbeat, ServiceHealth
from wackel_schemas.wire import Rejected

Status = Literal["ready", "starting", "stopped", "crashed", "hung", "dead"]

_S = 1_000_000_000
# A time-out equal to the period flaps; half a period more than two lost heartbeats does not.
LATE_PERIODS = 2.5
MAX_PERIOD_S = 60.0
# A Raspberry Pi that boots needs some seconds to load Python for all services at once.
START_UP_S = 10.0
MAX_SERVICES = 64
MOST_NAME = 128  # characters
MOST_REASON = 2048
_PLAYED = ("gateway/", "imu/")
_PLAYS = "a recording is played in its place"
_HAS_PLAYED = "the recording in its place has come to its end"


@dataclass(slots=True)
class Service:
    """One ``<service>/<instance>``.

    Attributes:
        name: ``<service>/<instance>``.
        seen_ns: Monotonic; since when it has been expected or known.
        status, reason, since_ns, since_utc: The latest judgement and when it changed.
        token: Whether its liveliness token is there; ``None`` if nothing was heard of one.
        token_ns: Monotonic; when that was heard.
        beat: Its latest heartbeat; ``None`` if it has not sent any since it (re)appeared.
        beat_ns: Monotonic; when that came.
        earlier: Boots that came before the present one.
        doubled_ns: Monotonic; when an earlier boot was heard beside the present one.
    """

    name: str
    seen_ns: int
    status: Status = "starting"
    reason: str = ""
    since_ns: int = 0
    since_utc: int = 0
    token: bool | None = None
    token_ns: int = 0
    beat: Heartbeat | None = None
    beat_ns: int = 0
    earlier: deque[int] = field(default_factory=lambda: deque(maxlen=4))
    doubled_ns: int | None = None

    @property
    def boot(self) -> int:
        """Of the process that the latest heartbeat came from; 0 if there was none."""
        return self.beat.boot if self.beat is not None else 0

    def overdue(self, now_ns: int) -> bool:
        """Whether the next heartbeat should have come long ago."""
        return self.beat is not None and (
            now_ns - self.beat_ns > LATE_PERIODS * self.beat.period_s * _S
        )


class ServiceBook:
    """All services that were seen or are needed.

    Attributes:
        changed: Whether anything has changed since the owner last took it; the owner clears it.
    """

    def __init__(
        self,
        needed: Collection[str],
        log: TransitionLog,
        now: Instant,
        wanted: Collection[str] = (),
    ) -> None:
        self.changed = True
        self._log = log
        self._needed = frozenset(needed)
        self._expected = self._needed.union(wanted)
        self._services = {
            name: Service(name, now.monotonic_ns, since_utc=now.utc_ns)
            for name in sorted(self._expected)
        }

    def __iter__(self) -> Iterator[Service]:
        return iter(self._services.values())

    @property
    def needed(self) -> frozenset[str]:
        """Without which health is unknown; a recording that is played stands for the sensors."""
        if not self._is_played:
            return self._needed
        return frozenset(name for name in self._needed if not name.startswith(_PLAYED))

    @property
    def _is_played(self) -> bool:
        return any(
            name.startswith("playback/") and service.status == "ready"
            for name, service in self._services.items()
        )

    def heartbeat(self, name: str, beat: Heartbeat, now: Instant) -> Heartbeat | None:
        """Takes in a sign of life.

        Returns:
            The heartbeat before it of the same process; ``None`` if there was none.

        Raises:
            Rejected: The heartbeat makes no sense, or there are more services than can be.
        """
        if len(beat.reason) > MOST_REASON or len(beat.rejection) > MOST_REASON:
            raise Rejected(f"a reason has at most {MOST_REASON} characters")
        if not 0 < beat.period_s <= MAX_PERIOD_S:
            raise Rejected(f"period {beat.period_s} s is not within 0 … {MAX_PERIOD_S:g} s")
        service = self._service(name, now)
        before = service.beat
        if before is not None and beat.boot != before.boot:
            if beat.boot in service.earlier and not service.overdue(now.monotonic_ns):
                service.doubled_ns = now.monotonic_ns
                return None
            service.earlier.append(before.boot)
            before = None
        service.beat, service.beat_ns = beat, now.monotonic_ns
        return before

    def alive(self, name: str, alive: bool, now: Instant) -> None:
        """Takes in that a liveliness token has come or gone.

        Raises:
            Rejected: There are more services than can be.
        """
        service = self._service(name, now)
        service.token, service.token_ns = alive, now.monotonic_ns
        if alive and service.status in ("dead", "stopped", "crashed") and service.beat is not None:
            # Back again, and what was heard last was from before.
            service.earlier.append(service.beat.boot)
            service.beat = None
            service.seen_ns = now.monotonic_ns

    def settle(self, now: Instant) -> None:
        """Judges every service anew."""
        is_played = self._is_played
        for service in self._services.values():
            status, reason = _judge(service, now.monotonic_ns)
            if status in ("starting", "dead") and service.name.startswith(_PLAYED):
                if is_played:
                    status, reason = "stopped", _PLAYS
                elif service.reason in (_PLAYS, _HAS_PLAYED) and not service.token:
                    status, reason = "stopped", _HAS_PLAYED
            if status != service.status:
                self._log.add(service.name, service.status, status, now)
                service.since_ns, service.since_utc = now.monotonic_ns, now.utc_ns
            if (status, reason) != (service.status, service.reason):
                service.status, service.reason = status, reason
                self.changed = True

    def named(self, boot: int) -> str:
        """The service that a process belongs or belonged to; empty if it sent no heartbeat."""
        if boot:
            for service in self._services.values():
                if boot == service.boot or boot in service.earlier:
                    return service.name
        return ""

    def voice(self, name: str, now: Instant) -> Voice | None:
        """Since when a service has been able to report faults; ``None`` if it is silent."""
        service = self._services.get(name)
        if service is None or service.status not in ("ready", "starting"):
            return None
        starting = service.status == "starting"
        return Voice(service.boot, now.monotonic_ns if starting else service.since_ns)

    def health(self) -> list[ServiceHealth]:
        """All of them by name, as health shows them."""
        return [
            ServiceHealth(
                name=name,
                status=service.status,
                since=service.since_utc,
                reason=service.reason,
                lost=service.beat.lost if service.beat is not None else 0,
                overrun=service.beat.overrun if service.beat is not None else 0,
            )
            for name, service in sorted(self._services.items())
        ]

    def _service(self, name: str, now: Instant) -> Service:
        service = self._services.get(name)
        if service is None:
            if len(name) > MOST_NAME:
                raise Rejected(f"a service's name has at most {MOST_NAME} characters")
            self._make_room(now)
            service = Service(name, now.monotonic_ns, since_utc=now.utc_ns)
            service.since_ns = now.monotonic_ns
            self._services[name] = service
            self._log.add(name, "", service.status, now)
            self.changed = True
        return service

    def _make_room(self, now: Instant) -> None:
        if len(self._services) < MAX_SERVICES:
            return
        gone = [
            service
            for service in self._services.values()
            if service.status in ("stopped", "dead", "crashed")
            and service.name not in self._expected
        ]
        if not gone:
            raise Rejected(f"there are {MAX_SERVICES} services already")
        oldest = min(gone, key=lambda service: service.since_ns)
        del self._services[oldest.name]
        self._log.add(oldest.name, oldest.status, "", now)


def _judge(service: Service, now_ns: int) -> tuple[Status, str]:
    beat = service.beat
    if beat is None:
        if service.token is False:
            return "dead", "gone without a word"
        if now_ns - service.seen_ns < START_UP_S * _S:
            return "starting", ""
        if service.token:
            return "hung", f"no heartbeat within {START_UP_S:g} s"
        return "dead", f"not seen within {START_UP_S:g} s"
    if beat.state == "crashed":
        return "crashed", beat.reason
    if beat.state == "stopping":
        return "stopped", beat.reason
    # A heartbeat that was under way when the process died is no sign of life, one that comes half
    # a period later is.
    if service.token is False and service.beat_ns - service.token_ns < beat.period_s * _S / 2:
        return "dead", "gone without a word"
    if service.overdue(now_ns):
        if service.token:
            return "hung", f"no heartbeat within {LATE_PERIODS:g} periods"
        return "dead", "gone without a word"
    if service.doubled_ns is not None and (
        now_ns - service.doubled_ns <= LATE_PERIODS * beat.period_s * _S
    ):
        return beat.state, "two processes run under this name"
    return beat.state, beat.reason
