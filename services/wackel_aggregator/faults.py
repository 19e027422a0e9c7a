"""The memory of faults: debounced, healed, unknown, inhibited.

Words and rules as in AUTOSAR's Diagnostic Event Manager: a fault is pending until it has been
reported for the ``debounce_s`` of its code, then confirmed; it is healed once it has been gone for
``heal_s``, and stays in memory. Silence heals nothing: while its source cannot speak, a fault is
unknown. A source repeats its active faults once a second, so one that can speak and has not named
a fault for ``window_s`` no longer finds it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from msgspec.structs import replace

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
        record: What health shows of it; replaced by another when that changes.
        boot: Of the process that reported it last.
        reported_ns: Monotonic; when it was reported last.
        began_ns: Monotonic; when it began to be reported, for the debounce.
        gone_ns: Monotonic; when its source reported it healed; ``None`` while it is active.
        known: Whether it has entered the memory; before that it has no status to change from.
    """

    record: FaultRecord
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
    def key(self) -> "Key":
        """Under which it is in memory."""
        return self.record.code, self.record.component, self.record.source


Key = tuple[str, str, str]  # code, component, source


class FaultMemory:
    """All faults by code, component and source.

    Attributes:
        changed: Whether the set has changed since the owner last took it; the owner clears it.
    """

    def __init__(self, log: TransitionLog) -> None:
        self.changed = False
        self._log = log
        self._active: dict[Key, Fault] = {}  # all but the healed ones
        self._healed: dict[Key, Fault] = {}
        # Most of a long memory is old when something is news.
        self._healed_records: list[FaultRecord] | None = []

    def restore(self, record: FaultRecord, now: Instant) -> None:
        """Takes over a fault that an earlier run has saved; an active one is unknown for now."""
        fault = Fault(record, 0, now.monotonic_ns, now.monotonic_ns, known=True)
        if record.status == "healed":
            self._keep_healed(fault)
        else:
            self._active[fault.key] = fault
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
        fault = self.find(*key)
        if fault is None:
            self._make_room(now)
            fault = self._active[key] = Fault(_new_record(report, source), 0, 0, 0)
        fault.boot = report.boot
        fault.reported_ns = now.monotonic_ns
        fault.gone_ns = None
        fault.record = _updated(fault.record, report, service, now)
        match fault.record.status:
            case "healed":
                self._begin(fault, now)
            case "unknown" if speaks and fault.record.occurrences:
                self._enter(fault, "confirmed", now)  # the same occurrence: its source was away
            case "unknown" if speaks:
                self._begin(fault, now)

    def heal(self, code: str, component: str, source: str, now: Instant) -> None:
        """A source no longer finds a fault; nothing if it is not in memory, or healing already."""
        fault = self._active.get((code, component, source))
        if fault is not None and fault.gone_ns is None:
            fault.gone_ns = now.monotonic_ns
            fault.record = replace(fault.record, last=now.utc_ns)

    def find(self, code: str, component: str, source: str) -> Fault | None:
        """What is in memory of a source's fault."""
        key = (code, component, source)
        return self._active.get(key) or self._healed.get(key)

    def settle(self, voice_of: Callable[[Fault], Voice | None], now: Instant) -> None:
        """Moves on what time, and who can speak, decide."""
        for fault in list(self._active.values()):
            self._settle(fault, voice_of(fault), now)
        if len(self._healed) > MAX_HEALED:
            for fault in self._by_age()[:-MAX_HEALED]:
                self.clear(fault, now)
        self._inhibit()

    def matching(self, code: str, component: str) -> list[Fault]:
        """Faults of a code and component; an empty text matches all."""
        return [
            fault
            for fault in (*self._active.values(), *self._healed.values())
            if code in ("", fault.record.code) and component in ("", fault.record.component)
        ]

    def acknowledge(self, fault: Fault) -> None:
        """A person has seen it; nothing else changes."""
        if not fault.record.acknowledged:
            fault.record = replace(fault.record, acknowledged=True)
            self._healed_records = None
            self.changed = True

    def clear(self, fault: Fault, now: Instant) -> None:
        """Forgets it. If it is still there, its source will report it again."""
        self._active.pop(fault.key, None)
        self._healed.pop(fault.key, None)
        self._healed_records = None
        self._log.add(_subject(fault.record), fault.record.status, "", now)
        self.changed = True

    def active(self) -> list[FaultRecord]:
        """All that are not healed, worst first."""
        return sorted((fault.record for fault in self._active.values()), key=_rank)

    def healed(self) -> list[FaultRecord]:
        """The healed ones that are still in memory."""
        if self._healed_records is None:
            records = (fault.record for fault in self._healed.values())
            self._healed_records = sorted(records, key=_rank)
        return self._healed_records

    def _begin(self, fault: Fault, now: Instant) -> None:
        fault.began_ns = now.monotonic_ns
        if fault.code.debounce_s:
            self._enter(fault, "pending", now)
        else:
            self._confirm(fault, now)

    def _confirm(self, fault: Fault, now: Instant) -> None:
        occurrences = fault.record.occurrences + 1
        fault.record = replace(fault.record, occurrences=occurrences, freeze_frame=None)
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
        fault.record = replace(fault.record, status=status)
        if status == "healed":
            fault.record = replace(fault.record, inhibited_by="")
            del self._active[fault.key]
            self._keep_healed(fault)
        elif before == "healed":
            fault.record = replace(fault.record, acknowledged=False)
            del self._healed[fault.key]
            self._healed_records = None
            self._active[fault.key] = fault
        self.changed = True
        self._log.add(_subject(fault.record), before, status, now)

    def _keep_healed(self, fault: Fault) -> None:
        self._healed[fault.key] = fault
        self._healed_records = None

    def _make_room(self, now: Instant) -> None:
        if len(self._active) + len(self._healed) < MAX_FAULTS:
            return
        if not self._healed:
            raise Rejected(f"there are {MAX_FAULTS} active faults already")
        self.clear(self._by_age()[0], now)

    def _by_age(self) -> list[Fault]:
        """The healed ones in the order in which they may be forgotten."""
        return sorted(
            self._healed.values(), key=lambda f: (not f.record.acknowledged, f.record.last)
        )

    def _inhibit(self) -> None:
        """Marks the faults that follow from a confirmed one; the table's first is the root."""
        active = self._active.values()
        confirmed = [fault.record for fault in active if fault.record.status == "confirmed"]
        roots = [r for code in EXPLAINS for r in confirmed if r.code == code]
        for fault in active:
            by = next((r for r in roots if _explains(r, fault.record)), None)
            inhibited_by = f"{by.component}/{by.code}" if by else ""
            if fault.record.inhibited_by != inhibited_by:
                fault.record = replace(fault.record, inhibited_by=inhibited_by)
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
        first=0,
        last=0,
    )


def _updated(record: FaultRecord, report: FaultReport, service: str, now: Instant) -> FaultRecord:
    confirmed_with = record.freeze_frame or record.evidence
    later = record.occurrences and report.evidence != confirmed_with
    return replace(
        record,
        message=report.message,
        remedy=report.remedy,
        confidence=report.confidence,
        suspects=report.suspects,
        evidence=report.evidence,
        freeze_frame=confirmed_with if later else None,
        service=service or record.service,
        first=report.since if record.status == "healed" else record.first,
        last=now.utc_ns,  # one that is repeated has its old stamp
    )


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
