"""What a fault report must be like so that health can carry it: numbers, and not too long."""

import math

from msgspec.structs import replace

from wackel_schemas import wire
from wackel_schemas.fault import FaultReport
from wackel_schemas.wire import Rejected

MOST_REPORT_BYTES = 8192
"""As many faults as are kept, each with its evidence twice, then fit into a health message; a sync
read of 20 servos as evidence has 2 kB."""


def sound(report: FaultReport) -> FaultReport:
    """The report, without the raw transaction if that is too long.

    Raises:
        Rejected: It is too long even so, or has numbers that are none.
    """
    values = report.evidence.values.values()
    if not all(math.isfinite(value) for value in values if isinstance(value, float)):
        raise Rejected("a report has numbers that are none")
    if len(wire.encode(report)) <= MOST_REPORT_BYTES:
        return report
    report = replace(report, evidence=replace(report.evidence, transaction=None))
    length = len(wire.encode(report))
    if length > MOST_REPORT_BYTES:
        raise Rejected(f"a report of {length} bytes; it may have {MOST_REPORT_BYTES}")
    return report
