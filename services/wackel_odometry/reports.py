"""From what is wrong now to fault reports: begun and healed."""

from dataclasses import dataclass, field

from msgspec.structs import replace

from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message


@dataclass(frozen=True)
class Complaint:
    """Something that is wrong now.

    Attributes:
        code: A key of the fault codes.
        summary: What was seen and what was expected.
        values: The numbers behind it, by name with unit.
        words: What the text of the code needs beside the component.
    """

    code: str
    summary: str
    values: dict[str, float | int | str] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)


class Reports:
    """The faults of one service that are active."""

    def __init__(self) -> None:
        self._active: dict[tuple[str, str], FaultReport] = {}

    def update(self, component: str, found: list[Complaint], stamp: int) -> list[FaultReport]:
        """What has changed of a component.

        Args:
            component: Its path.
            found: All that is wrong with it now.
            stamp: Of the evidence, UTC ns.
        """
        codes = {complaint.code for complaint in found}
        gone = [key for key in self._active if key[0] == component and key[1] not in codes]
        changes = [
            replace(self._active.pop(key), stamp=stamp, status="healed", boot=0, seq=0)
            for key in gone
        ]
        return changes + self.begin(component, found, stamp)

    def begin(self, component: str, found: list[Complaint], stamp: int) -> list[FaultReport]:
        """As :meth:`update`, but nothing heals: more may be wrong than was looked for."""
        begun = []
        for complaint in found:
            key = component, complaint.code
            if key not in self._active:
                self._active[key] = _report(component, complaint, stamp)
                begun.append(self._active[key])
        return begun

    def active(self) -> list[FaultReport]:
        """The faults that are active, in the order in which they began."""
        return list(self._active.values())


def _report(component: str, complaint: Complaint, stamp: int) -> FaultReport:
    return FaultReport(
        stamp=stamp,
        code=complaint.code,
        component=component,
        status="active",
        confidence=0.95,
        message=message(complaint.code, component, **complaint.words),
        remedy=FAULT_CODES[complaint.code].remedy,
        evidence=Evidence(summary=complaint.summary, values=complaint.values),
        since=stamp,
    )
