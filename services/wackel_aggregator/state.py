"""What of the health outlives a restart of the aggregator."""

from wackel_schemas.health import FaultRecord, Transition
from wackel_schemas.message import Record


class SavedFault(Record, kw_only=True):
    """A fault and the service behind its source."""

    record: FaultRecord
    service: str = ""


class State(Record, kw_only=True):
    """Transitions oldest first, so that numbering goes on; faults in any order."""

    transitions: list[Transition]
    faults: list[SavedFault]
