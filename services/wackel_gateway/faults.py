"""The gateway's own fault: the adapter is not there. Pure; times come in as stamps."""

from typing import Literal

from wackel_schemas import component
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message

_CODE = "adapter_unplugged"


class AdapterFault:
    """Whether the adapter of one bus is missing, as reports: on a change, and again while it is.

    Attributes:
        active: Whether it is missing.
    """

    def __init__(self, bus: str, port: str) -> None:
        self._component = component.adapter(bus)
        self._port = port
        self._since = 0
        self._reason = ""
        self.active = False

    def lost(self, reason: str, stamp: int) -> FaultReport | None:
        """The port went away or cannot be opened; a report unless this is known already."""
        if self.active and reason == self._reason:
            return None
        if not self.active:
            self._since = stamp
        self.active = True
        self._reason = reason
        return self._report("active", stamp)

    def back(self, stamp: int) -> FaultReport | None:
        """The port is open; a report if it was missing."""
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
        summary = f"{self._port}: {self._reason}"
        return FaultReport(
            stamp=stamp,
            code=_CODE,
            component=self._component,
            status=status,
            confidence=1.0,
            message=message(_CODE, self._component, reason=self._reason),
            remedy=FAULT_CODES[_CODE].remedy,
            evidence=Evidence(summary=summary),
            since=self._since,
        )
