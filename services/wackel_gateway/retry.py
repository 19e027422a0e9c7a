"""Keeping a port open: when it is lost, trying again soon at first, then less and less often."""

from collections.abc import Callable
from time import monotonic

from wackel_gateway.port import Port, PortLost
from wackel_gateway.reporter import Reporter
from wackel_node.config import BusConfig
from wackel_node.node import Node

_FIRST_S = 0.05
_LAST_S = 1.0


class Retry:
    """The pauses between attempts to open a port; the node's handlers run meanwhile."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._pause_s = _FIRST_S

    def succeeded(self) -> None:
        """The next pause is a short one again."""
        self._pause_s = _FIRST_S

    def wait(self) -> None:
        """The next pause, twice as long as the one before; ends early if the node stops."""
        until = monotonic() + self._pause_s
        self._pause_s = min(_LAST_S, 2 * self._pause_s)
        while not self._node.stopping and (left_s := until - monotonic()) > 0:
            self._node.pump(left_s)


def keep_open(
    node: Node, config: BusConfig, reporter: Reporter, use: Callable[[Port], None]
) -> None:
    """Opens the bus's port and calls ``use`` with it, again whenever it was lost.

    Args:
        node: Until this one stops.
        config: Path and baud rate.
        reporter: Told when the port is there and when it is lost.
        use: Returns when the node stops; raises :class:`PortLost`.
    """
    retry = Retry(node)
    while not node.stopping:
        try:
            port = Port(config.port, config.baud_rate)
        except PortLost as lost:
            reporter.lost(str(lost))
            retry.wait()
            continue
        with port:
            reporter.connected(port.baud_rate, port.latency_timer_ms)
            retry.succeeded()
            try:
                use(port)
            except PortLost as lost:
                # Before it is closed, for which a driver may take its time.
                reporter.lost(str(lost))
        retry.wait()
