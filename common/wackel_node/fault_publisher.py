"""The faults that a service finds, as its topic tells them."""

from collections.abc import Callable, Iterable

from msgspec.structs import replace

from wackel_node.log import logger
from wackel_node.node import Node
from wackel_schemas.fault import FaultReport
from wackel_schemas.keys import FAULT

REPEAT_S = 1.0
"""Active faults are told again so often, for those who came later."""


class FaultPublisher:
    """Publishes fault reports: a change at once, and what is active once a second.

    Args:
        node: Of the service; its journal is told with each change, so that a recording has what a
            conclusion follows from even if the process is killed soon after it.
        source: As which it reports.
        active: Says what is active now.
    """

    def __init__(
        self, node: Node, source: str, active: Callable[[], Iterable[FaultReport]]
    ) -> None:
        self._node = node
        self._faults = node.publisher(FAULT, source=source)
        self._active = active
        node.every(REPEAT_S, self._repeat)

    def put(self, report: FaultReport) -> None:
        """A fault began, changed or healed."""
        self._faults.put(report)
        self._node.tell_inputs()
        logger.info("%s: %s", report.status, report.message)

    def _repeat(self) -> None:
        for report in self._active():
            self._faults.put(replace(report, repeated=True))
