"""The memory of faults: debounced, healed, unknown, inhibited.

Words and rules as in AUTOSAR's Diagnostic Event Manager: a fault is pending until it has been
reported for the ``debounce_s`` of its code, then confirmed; it is healed once it has been gone for
``heal_s``, and stays in memory. Silence heals nothing: while its source cannot speak, a fault is
unknown. A source repeats its active faults once a second, so one that can speak and has not named
a fault for ``window_s`` no longer finds it.
"""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

from wackel_aggregator.transitions import TransitionLog
from wackel_node.clock import Instant
from wackel_schemas.fault import FaultReport
from wackel_schemas.fault_codes import EXPLAINS, FAULT_CODES, FaultCode
from wackel_schemas.health import FaultRecord, FaultStatus
from wackel_schemas.wire import Rejected

# Every servo of four chains of twenty with three faults each; beyond, a source talks nonsense.
MAX_FAULTS = 256
MAX_HEALED = 64

_S = 1_000_000_000
_ORDER: dict[FaultStatus, int] = {"confirmed": 0, "unknown": 1, "pending": 2, "healed": 3}
_SEVERITY = {"fault": 0, "warning": 1, "info": 2}
# A user's own source may report codes of its own; each report carries message and remedy.
_FOREIGN = FaultCode("{component}", "", "warning")


class Voice(NamedTuple):
    """A source that can speak.

    Attributes:
        boot: Of its process; what an earlier one said is unknown until this one repeats it. 0
            before its first heartbeat.
        since_ns: Monotonic; since when it has been able to find faults.
    """

    boot: int
    since_ns: int


@dataclass(slots=True)
class Fault:
    """One fault in memory.

    Attributes:
        record: What health shows of it.
        service: ``<service>/<instance>`` behind the source; empty if it is not known.
        boot: Of the process that reported it last.
        reported_ns: Monotonic; when it was reported last.
        began_ns: Monotonic; when it began to be reported, for the debounce.
        gone_ns: Monotonic; when its source reported it healed; ``None`` while it is active.
        known: Whether it has entered the memory; before that it has no status to change from.
    """

    record: FaultRecord
    service: str
    boot: int
    reported_ns: int
    began_ns: int
    gone_ns: int | None = None
    known: bool = False

    @property
    def code(self) -> FaultCode:
        """The entry in the table of codes."""
        return FAULT_CODES.get(self.record.code, _FOREIGN)

    @property
    def active(self) -> bool:
        """Whether it is not known to be healed."""
        return self.record.status != "healed"


Key = tuple[str, str, str]  # code, component, source


class FaultMemory:
    """All faults by code, component and source.

    Attributes:
        changed: Whether the set has changed since the owner last took it; the owner clears it.
    """

    def __init__(self, log: TransitionLog) -> None:
        self.changed = False
        self._log = log
        self._faults: dict[Key, Fault] = {}

    def __iter__(self) -> Iterator[Fault]:
        return iter(self._faults.values())

    def restore(self, record: FaultRecord, service: str, now: Instant) -> None:
        """Takes over a fault that an earlier run has saved; an active one is unknown for now."""
        fault = Fault(record, service, 0, now.monotonic_ns, now.monotonic_ns, known=True)
        self._faults[record.code, record.component, record.source] = fault
        if fault.active:
            self._enter(fault, "unknown", now)

    def report(
        self, report: FaultReport, source: str, service: str, speaks: bool, now: Instant
    ) -> None:
        """Takes in what a source says.

        Args:
            report: Active, repeated or healed.
            source: Who says it.
            service: Name of the process behind the source; empty if it is not known.
            speaks: Whether that process counts as alive; a straggling report of a dead one cannot
                revive its faults.
            now: When.

        Raises:
            Rejected: The report makes no sense, or there are more faults than can be.
        """
        if not 0 <= report.confidence <= 1:
            raise Rejected(f"confidence {report.confidence} is not within 0 … 1")
        if report.status == "healed":
            self.heal(report.code, report.component, source, now)
            return
        key = (report.code, report.component, source)
        fault = self._faults.get(key)
        if fault is None:
            self._make_room(now)
            fault = self._faults[key] = Fault(_new_record(report, source), service, 0, 0, 0)
        fault.service = service or fault.service
        fault.boot = report.boot
        fault.reported_ns = now.monotonic_ns
        fault.gone_ns = None
        _update(fault.record, report)
        match fault.record.status:
            case "healed":
                fault.record.acknowledged = False
                self._begin(fault, now)
            case "unknown" if speaks and fault.record.occurrences:
                self._enter(fault, "confirmed", now)  # the same occurrence: its source was away
            case "unknown" if speaks:
                self._begin(fault, now)

    def heal(self, code: str, component: str, source: str, now: Instant) -> None:
        """A source no longer finds a fault; nothing if it is not in memory, or healing already."""
        fault = self._faults.get((code, component, source))
        if fault is not None and fault.active and fault.gone_ns is None:
            fault.gone_ns = now.monotonic_ns

    def find(self, code: str, component: str, source: str) -> Fault | None:
        """What is in memory of a source's fault."""
        return self._faults.get((code, component, source))

    def settle(self, voice_of: Callable[[Fault], Voice | None], now: Instant) -> None:
        """Moves on what time, and who can speak, decide."""
        for fault in self._faults.values():
            if fault.active:
                self._settle(fault, voice_of(fault), now)
        self._forget(now)
        self._inhibit()

    def matching(self, code: str, component: str) -> list[Fault]:
        """Faults of a code and component; an empty text matches all."""
        return [
            fault
            for fault in self._faults.values()
            if code in ("", fault.record.code) and component in ("", fault.record.component)
        ]

    def acknowledge(self, fault: Fault) -> None:
        """A person has seen it; nothing else changes."""
        self.changed = self.changed or not fault.record.acknowledged
        fault.record.acknowledged = True

    def clear(self, fault: Fault, now: Instant) -> None:
        """Forgets it. If it is still there, its source will report it again."""
        record = fault.record
        del self._faults[record.code, record.component, record.source]
        self._log.add(_subject(record), record.status, "", now)
        self.changed = True

    def records(self) -> list[FaultRecord]:
        """A copy of all, worst first."""
        return sorted((copy(fault.record) for fault in self._faults.values()), key=_rank)

    def _begin(self, fault: Fault, now: Instant) -> None:
        fault.began_ns = now.monotonic_ns
        if fault.code.debounce_s:
            self._enter(fault, "pending", now)
        else:
            self._confirm(fault, now)

    def _confirm(self, fault: Fault, now: Instant) -> None:
        fault.record.occurrences += 1
        fault.record.freeze_frame = fault.record.evidence
        self._enter(fault, "confirmed", now)

    def _settle(self, fault: Fault, voice: Voice | None, now: Instant) -> None:
        code = fault.code
        if voice is None:
            fault.gone_ns = None
            self._enter(fault, "unknown", now)
            return
        if voice.boot and fault.boot != voice.boot:
            self._enter(fault, "unknown", now)
        if fault.gone_ns is not None:
            if now.monotonic_ns - fault.gone_ns >= code.heal_s * _S:
                self._enter(fault, "healed", now)
        elif now.monotonic_ns - max(fault.reported_ns, voice.since_ns) > code.window_s * _S:
            self._enter(fault, "healed", now)
        elif (
            fault.record.status == "pending"
            and now.monotonic_ns - fault.began_ns >= code.debounce_s * _S
        ):
            self._confirm(fault, now)

    def _enter(self, fault: Fault, status: FaultStatus, now: Instant) -> None:
        before = fault.record.status if fault.known else ""
        if status == before:
            return
        fault.known = True
        fault.record.status = status
        self.changed = True
        self._log.add(_subject(fault.record), before, status, now)

    def _make_room(self, now: Instant) -> None:
        if len(self._faults) < MAX_FAULTS:
            return
        healed = self._healed()
        if not healed:
            raise Rejected(f"there are {MAX_FAULTS} active faults already")
        self.clear(healed[0], now)

    def _forget(self, now: Instant) -> None:
        healed = self._healed()
        for fault in healed[: max(0, len(healed) - MAX_HEALED)]:
            self.clear(fault, now)

    def _healed(self) -> list[Fault]:
        """In the order in which they may be forgotten."""
        healed = [fault for fault in self._faults.values() if not fault.active]
        return sorted(healed, key=lambda f: (not f.record.acknowledged, f.record.last))

    def _inhibit(self) -> None:
        """Marks the faults that follow from a confirmed one; the table's first is the root."""
        confirmed = [f.record for f in self._faults.values() if f.record.status == "confirmed"]
        roots = [r for code in EXPLAINS for r in confirmed if r.code == code]
        for fault in self._faults.values():
            by = next((r for r in roots if fault.active and _explains(r, fault.record)), None)
            inhibited_by = f"{by.component}/{by.code}" if by else ""
            if fault.record.inhibited_by != inhibited_by:
                fault.record.inhibited_by = inhibited_by
                self.changed = True


def _explains(root: FaultRecord, record: FaultRecord) -> bool:
    if record.code not in EXPLAINS[root.code]:
        return False
    # What one servo has explains nothing of its neighbours; all else concerns its whole bus.
    kind, bus, *place = [*root.component.split("/"), ""]
    if place[:1] == ["servo"]:
        return root.component == record.component
    return record.component.split("/")[:2] == [kind, bus]


def _new_record(report: FaultReport, source: str) -> FaultRecord:
    return FaultRecord(
        code=report.code,
        component=report.component,
        source=source,
        severity=FAULT_CODES.get(report.code, _FOREIGN).severity,
        status="healed",
        message="",
        remedy="",
        confidence=0.0,
        first=report.since,
        last=report.stamp,
    )


def _update(record: FaultRecord, report: FaultReport) -> None:
    record.message = report.message
    record.remedy = report.remedy
    record.confidence = report.confidence
    record.suspects = report.suspects
    record.evidence = report.evidence
    record.last = report.stamp


def _subject(record: FaultRecord) -> str:
    return f"{record.code} {record.component}"


def _rank(record: FaultRecord) -> tuple[int, bool, int, str, str, str]:
    return (
        _ORDER[record.status],
        bool(record.inhibited_by),
        _SEVERITY[record.severity],
        record.component,
        record.code,
        record.source,
    )
