"""Merges fault reports and signs of life into one health. No clock, no files, no Zenoh."""

import contextlib
from collections.abc import Collection

from wackel_aggregator.faults import Fault, FaultMemory, Voice
from wackel_aggregator.services import MOST_NAME, Service, ServiceBook
from wackel_aggregator.soundness import sound
from wackel_aggregator.transitions import TransitionLog
from wackel_node.clock import Instant
from wackel_schemas import component
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message
from wackel_schemas.health import (
    FaultRecord,
    Health,
    HealthReply,
    HealthRequest,
    Heartbeat,
    Level,
)
from wackel_schemas.wire import Rejected

SOURCE = "aggregator"

_S = 1_000_000_000
_PUBLISH_S = 1.0
# A source repeats its active faults once a second; one without heartbeat is judged by that.
_REPEAT_LATE_S = 2.5
_OWN_BOOT = 1  # of this run; restored faults have 0

# A known fault is worse than not knowing, not knowing is worse than a warning.
_RANK: dict[Level, int] = {"ok": 0, "warning": 1, "unknown": 2, "fault": 3}
_LEVEL: dict[str, Level] = {"info": "ok", "warning": "warning", "fault": "fault"}
_SERVICE_FAULTS = {"dead": "service_dead", "crashed": "service_crashed", "hung": "service_hung"}
_CAPABILITIES = sorted({name for code in FAULT_CODES.values() for name in code.disables})
# On a robot that does without this service nobody can tell.
_JUDGES = {"can_localise": "odometry/main", "can_drive": "diagnoser/main"}


class Aggregator:
    """One robot's health.

    Every method takes the moment at which it happens. None publishes: the owner calls
    :meth:`tick` after it has handed in what there is, and a few times a second.
    """

    def __init__(
        self,
        needed: Collection[str],
        saved: Health | None,
        now: Instant,
        wanted: Collection[str] = (),
    ) -> None:
        """Starts with what an earlier run saved.

        Args:
            needed: Services (``gateway/main``) without which health is unknown.
            saved: The latest health of an earlier run; ``None`` to start empty.
            now: When.
            wanted: Services that should run as well; without one, health is a warning.
        """
        self._log = TransitionLog(saved.transitions if saved is not None else ())
        self._services = ServiceBook(needed, self._log, now, wanted)
        self._faults = FaultMemory(self._log)
        self._own: set[tuple[str, str]] = set()  # code and component of own active faults
        self._started_ns = now.monotonic_ns
        self._published_ns: int | None = None
        self._saved = -1  # number of the next transition when health was last to be saved
        for fault in saved.faults if saved is not None else ():
            self._faults.restore(fault, now)

    def report(self, report: FaultReport, source: str, now: Instant) -> None:
        """A fault report of a source, the second chunk of its key.

        Raises:
            Rejected: It makes no sense.
        """
        if source == SOURCE:
            raise Rejected(f"{SOURCE} is this service's own name as a source")
        if len(source) > MOST_NAME:
            raise Rejected(f"a source's name has at most {MOST_NAME} characters")
        report = sound(report)
        service = self._services.named(report.boot)
        fault = self._faults.find(report.code, report.component, source)
        known = service or (fault.record.service if fault is not None else "")
        speaks = not known or self._services.voice(known, now) is not None
        self._faults.report(report, source, service, speaks, now)

    def heartbeat(self, name: str, beat: Heartbeat, now: Instant) -> None:
        """A heartbeat of ``<service>/<instance>``.

        Raises:
            Rejected: It makes no sense.
        """
        before = self._services.heartbeat(name, beat, now)
        if before is None:
            return
        missed = beat.lost + beat.overrun - before.lost - before.overrun
        if missed > 0:
            values = {"lost": beat.lost, "overrun": beat.overrun, "received": beat.received}
            summary = f"{missed} messages missed within {beat.period_s:g} s"
            self._find("messages_lost", name, now, Evidence(summary=summary, values={**values}))
        else:
            self._heal("messages_lost", name, now)
        refused = beat.rejected - before.rejected
        if refused > 0:
            summary = f"{refused} messages refused within {beat.period_s:g} s"
            values = {"refused": beat.rejected, "received": beat.received}
            evidence = Evidence(summary=summary, values={**values})
            self._find("messages_refused", name, now, evidence, beat.rejection)
        else:
            self._heal("messages_refused", name, now)

    def alive(self, name: str, alive: bool, now: Instant) -> None:
        """The liveliness token of ``<service>/<instance>`` has come or gone.

        Raises:
            Rejected: It makes no sense.
        """
        self._services.alive(name, alive, now)

    def tick(self, now: Instant) -> Health | None:
        """Moves on what time decides; the health to publish if it changed or a second is over."""
        self._services.settle(now)
        for service in self._services:
            self._judge(service, now)
        self._faults.settle(lambda fault: self._voice(fault, now), now)
        changed = self._services.changed or self._faults.changed
        due = self._published_ns is None or now.monotonic_ns - self._published_ns >= _PUBLISH_S * _S
        if not (changed or due):
            return None
        self._services.changed = self._faults.changed = False
        self._published_ns = now.monotonic_ns
        return self.health(now)

    def health(self, now: Instant) -> Health:
        """The merged state."""
        active = self._faults.active()
        level, summary = self._sum_up(active)
        return Health(
            stamp=now.utc_ns,
            level=level,
            summary=summary,
            capabilities=self._capabilities(active),
            faults=active + self._faults.healed(),
            services=self._services.health(),
            transitions=list(self._log.latest),
        )

    def request(self, request: HealthRequest, now: Instant) -> HealthReply:
        """Answers a person or a program."""
        faults = self._faults.matching(request.code, request.component)
        asked = f"{request.code} {request.component}".strip()
        ok = bool(faults) or not asked
        match request.operation:
            case "get":
                ok, text = True, "health as it is now"
            case _ if not ok:
                text = f"no fault {asked} in memory"
            case "acknowledge":
                for fault in faults:
                    self._faults.acknowledge(fault)
                self._saved = -1
                text = f"{len(faults)} acknowledged"
            case "clear":
                # What is unknown may be cleared too: its source may never come back.
                over = [f for f in faults if f.record.status in ("healed", "unknown")]
                for fault in over:
                    self._faults.clear(fault, now)
                left = len(faults) - len(over)
                ok = bool(over) or not faults
                text = f"{len(over)} cleared" + (f", {left} still active" if left else "")
        return HealthReply(stamp=now.utc_ns, ok=ok, text=text, health=self.health(now))

    def unsaved(self) -> bool:
        """Whether the latest health must outlive a restart; to be asked once of each.

        It must if it tells changes since the last one that had to.
        """
        before, self._saved = self._saved, self._log.next_number
        return before != self._saved

    def _judge(self, service: Service, now: Instant) -> None:
        """Silence from a service is a fault of its own."""
        found = _SERVICE_FAULTS.get(service.status)
        for code in _SERVICE_FAULTS.values():
            if code == found:
                if (code, component.service(service.name)) not in self._own:
                    summary = f"{service.name} is {service.status}: {service.reason}"
                    self._find(code, service.name, now, Evidence(summary=summary), service.reason)
            elif service.status != "starting":
                self._heal(code, service.name, now)
        if found or service.status == "stopped":
            self._heal("messages_lost", service.name, now)
            self._heal("messages_refused", service.name, now)

    def _find(
        self, code: str, service: str, now: Instant, evidence: Evidence, reason: str = ""
    ) -> None:
        place = component.service(service)
        report = FaultReport(
            stamp=now.utc_ns,
            boot=_OWN_BOOT,
            code=code,
            component=place,
            status="active",
            confidence=1.0,
            message=message(code, place, reason=reason),
            remedy=FAULT_CODES[code].remedy,
            evidence=evidence,
            since=now.utc_ns,
        )
        # A memory full of active faults has no room for one that the services show anyway.
        with contextlib.suppress(Rejected):
            self._faults.report(report, SOURCE, "", True, now)
            self._own.add((code, place))

    def _heal(self, code: str, service: str, now: Instant) -> None:
        place = component.service(service)
        self._faults.heal(code, place, SOURCE, now)
        self._own.discard((code, place))

    def _voice(self, fault: Fault, now: Instant) -> Voice | None:
        record = fault.record
        if record.source == SOURCE:
            found = (record.code, record.component) in self._own
            return Voice(_OWN_BOOT, now.monotonic_ns if found else self._started_ns)
        if record.service:
            return self._services.voice(record.service, now)
        silent = now.monotonic_ns - fault.reported_ns > _REPEAT_LATE_S * _S
        return None if silent else Voice(fault.boot, now.monotonic_ns)

    def _sum_up(self, active: list[FaultRecord]) -> tuple[Level, str]:
        """The worst of all, and a sentence for it."""
        found: list[tuple[Level, str]] = []
        needed = self._services.needed
        waited_for = [s for s in self._services if s.name in needed and s.status != "ready"]
        for record in active:
            if record.status == "unknown":
                if record.severity == "info":
                    continue  # it would not count even if it did hold
                found.append(
                    ("unknown", f"It is not known whether this still holds: {record.message}")
                )
            elif record.status == "confirmed" and not record.inhibited_by:
                found.append((self._level(record), record.message))
        found += [
            ("unknown", f"The service {service.name} is {service.status}.")
            for service in waited_for
        ]
        if not found:
            ready = sum(service.status == "ready" for service in self._services)
            are = "service" if ready == 1 else "services"
            return "ok", f"All well: {ready} {are} ready, no fault."
        level, sentence = max(found, key=lambda f: _RANK[f[0]])
        more = sum(_RANK[other] > 0 for other, _ in found) - 1
        return level, sentence + (f" ({more} more)" if more > 0 else "")

    def _level(self, record: FaultRecord) -> Level:
        """A service that is silent makes health unknown, if it is needed; it breaks no robot."""
        if record.code in _SERVICE_FAULTS.values() and record.source == SOURCE:
            name = record.component.removeprefix("service/")
            return "unknown" if name in self._services.needed else "warning"
        return _LEVEL[record.severity]

    def _capabilities(self, active: list[FaultRecord]) -> dict[str, bool]:
        """What the robot can still do; what is not known is absent."""
        lost: set[str] = set()
        unknown: set[str] = set()
        for record in active:
            disabled = FAULT_CODES[record.code].disables if record.code in FAULT_CODES else ()
            if record.status == "confirmed":
                lost.update(disabled)
            elif record.status == "unknown":
                unknown.update(disabled)
        needed = self._services.needed
        blind = not needed or any(s.name in needed and s.status != "ready" for s in self._services)
        return {
            name: name not in lost
            for name in _CAPABILITIES
            if _JUDGES.get(name) in (None, *needed)
            and (name in lost or not (blind or name in unknown))
        }
