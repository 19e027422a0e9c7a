"""From what is wrong now to fault reports: begun, found to fit more than it seemed, and healed."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from msgspec.structs import replace

from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message


@dataclass(frozen=True)
class Finding:
    """Something that is wrong now.

    Attributes:
        code: A key of the fault codes.
        component: Its path.
        summary: What was seen and what was expected.
        values: The numbers behind it, by name with unit.
        words: What the text of the code needs beside the component.
        confidence: 0 … 1.
        suspects: What the evidence fits as well.
        since: Stamp of the first evidence.
    """

    code: str
    component: str
    summary: str
    since: int
    values: dict[str, float | int | str] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    confidence: float = 0.95
    suspects: tuple[str, ...] = ()


class Reports:
    """The faults that are active."""

    def __init__(self) -> None:
        self._active: dict[tuple[str, str], FaultReport] = {}

    def update(self, found: Iterable[Finding], stamp: int) -> list[FaultReport]:
        """What has changed, given all that is wrong now."""
        now = {(finding.component, finding.code): finding for finding in found}
        gone = [key for key in self._active if key not in now]
        changes = [
            replace(self._active.pop(key), stamp=stamp, status="healed", boot=0, seq=0)
            for key in gone
        ]
        for key, finding in now.items():
            known = self._active.get(key)
            if known is None:
                report = _report(finding, stamp)
            elif not set(finding.suspects) <= set(known.suspects):
                # Never fewer than before, or it would be told each time that one comes and goes.
                suspects = dict.fromkeys((*finding.suspects, *known.suspects))
                report = replace(_report(finding, stamp), since=known.since, suspects=[*suspects])
            else:
                continue
            self._active[key] = report
            changes.append(report)
        return changes

    @property
    def any_active(self) -> bool:
        """Whether there is one."""
        return bool(self._active)

    def active(self) -> list[FaultReport]:
        """In the order in which they began."""
        return list(self._active.values())


def _report(finding: Finding, stamp: int) -> FaultReport:
    return FaultReport(
        stamp=stamp,
        code=finding.code,
        component=finding.component,
        status="active",
        confidence=finding.confidence,
        message=message(finding.code, finding.component, **finding.words),
        remedy=FAULT_CODES[finding.code].remedy,
        evidence=Evidence(summary=finding.summary, values=finding.values),
        suspects=list(finding.suspects),
        since=finding.since,
    )
