"""The fault of a service whose device is not there. Pure; times come in as stamps."""

from typing import Literal

from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message


class Absence:
    """Whether a device is missing, as reports: on a change, and again while it is.

    Args:
        code: Of the fault; its text has a reason.
        component: The device, as a path.
        place: Where it should be.

    Attributes:
        active: Whether it is missing.
    """

    def __init__(self, code: str, component: str, place: str) -> None:
        self._code = code
        self._component = component
        self._place = place
        self._since = 0
        self._reason = ""
        self.active = False

    def lost(self, reason: str, stamp: int) -> FaultReport | None:
        """It went away or cannot be opened; a report unless this is known already."""
        if self.active and reason == self._reason:
            return None
        if not self.active:
            self._since = stamp
        self.active = True
        self._reason = reason
        return self._report("active", stamp)

    def back(self, stamp: int) -> FaultReport | None:
        """It is there; a report if it was missing."""
        if not self.active:
            return None
        self.active = False
        return self._report("healed", stamp)

    def again(self, stamp: int) -> FaultReport | None:
        """What those who came later have to know."""
        if not self.active:
            return None
        report = self._report("active", stamp)
        report.repeated = True
        return report

    def _report(self, status: Literal["active", "healed"], stamp: int) -> FaultReport:
        summary = f"{self._place}: {self._reason}"
        return FaultReport(
            stamp=stamp,
            code=self._code,
            component=self._component,
            status=status,
            confidence=1.0,
            message=message(self._code, self._component, reason=self._reason),
            remedy=FAULT_CODES[self._code].remedy,
            evidence=Evidence(summary=summary),
            since=self._since,
        )
