"""From what is found to what is reported: begin, change of place, healed."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from wackel_schemas.bus import Transaction
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message


@dataclass(slots=True)
class Finding:
    """A fault that is there now, as one of the diagnosing modules sees it.

    Attributes:
        code: A key of the fault codes.
        component: Path of what is faulty.
        confidence: 0 … 1.
        since: Stamp of the first evidence, UTC ns.
        summary: One line: what was seen, what was expected.
        values: The numbers behind it, by name with unit.
        suspects: Other components that the evidence fits as well, likeliest first.
        words: What the text of the code needs beside the component.
    """

    code: str
    component: str
    confidence: float
    since: int
    summary: str
    values: dict[str, float | int | str] = field(default_factory=dict)
    suspects: list[str] = field(default_factory=list)
    words: dict[str, str] = field(default_factory=dict)


class Book:
    """The faults of one bus that are active."""

    def __init__(self) -> None:
        self._active: dict[tuple[str, str], FaultReport] = {}

    def active(self) -> list[FaultReport]:
        """A report of each, in the order in which they began."""
        return list(self._active.values())

    def update(
        self, stamp: int, findings: Iterable[Finding], transaction: Transaction
    ) -> list[FaultReport]:
        """What has changed, the healed ones first.

        Args:
            stamp: Of the evidence that led to ``findings``, UTC ns.
            findings: All that are there now.
            transaction: The evidence.
        """
        now = {(finding.code, finding.component): finding for finding in findings}
        gone = [key for key in self._active if key not in now]
        changes = [_healed(self._active.pop(key), stamp, transaction) for key in gone]
        for key, finding in now.items():
            known = self._active.get(key)
            if known is None or known.suspects != finding.suspects:
                report = _report(finding, stamp, transaction)
                if known is not None:
                    report.since = known.since
                self._active[key] = report
                changes.append(report)
        return changes


def _report(finding: Finding, stamp: int, transaction: Transaction) -> FaultReport:
    return FaultReport(
        stamp=stamp,
        code=finding.code,
        component=finding.component,
        status="active",
        confidence=round(finding.confidence, 3),
        message=message(finding.code, finding.component, **finding.words),
        remedy=FAULT_CODES[finding.code].remedy,
        evidence=Evidence(summary=finding.summary, values=finding.values, transaction=transaction),
        since=min(finding.since, stamp),
        suspects=finding.suspects,
    )


def _healed(report: FaultReport, stamp: int, transaction: Transaction) -> FaultReport:
    return FaultReport(
        stamp=stamp,
        code=report.code,
        component=report.component,
        status="healed",
        confidence=report.confidence,
        message=report.message,
        remedy=report.remedy,
        evidence=Evidence(
            summary=f"No longer seen: {report.evidence.summary}",
            values=report.evidence.values,
            transaction=transaction,
        ),
        since=report.since,
        suspects=report.suspects,
    )
