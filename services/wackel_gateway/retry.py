"""Keeping a port open: when it is lost, trying again soon at first, then less and less often."""

from collections.abc import Callable
from contextlib import ExitStack
from time import monotonic_ns

from wackel_gateway.port import Port, PortLost
from wackel_gateway.recovery import Recovery
from wackel_gateway.reporter import Reporter
from wackel_node.config import BusConfig
from wackel_node.node import Node

_LOOK_S = 0.05


def wait(node: Node, pause_ns: int) -> None:
    """Lets the node's handlers run for so long; ends early if the node stops."""
    until_ns = monotonic_ns() + pause_ns
    while not node.stopping and (left_ns := until_ns - monotonic_ns()) > 0:
        node.pump(left_ns / 1e9)


def keep_open(
    node: Node, config: BusConfig, reporter: Reporter, use: Callable[[Port], None]
) -> None:
    """Opens the bus's port and calls ``use`` with it, again whenever it was lost.

    Args:
        node: Until this one stops.
        config: Path and baud rate.
        reporter: Told when the port is there and when it is lost.
        use: Returns when the node stops; raises :class:`PortLost`. Pumps the node meanwhile.
    """
    recovery = Recovery()
    port: Port | None = None

    def look() -> None:
        if port is not None and recovery.back(monotonic_ns(), heard=port.heard):
            reporter.connected(port.baud_rate, port.latency_timer_ms)

    node.every(_LOOK_S, look)
    while not node.stopping:
        with ExitStack() as stack:
            try:
                port = stack.enter_context(Port(config.port, config.baud_rate))
                recovery.opened(monotonic_ns())
                if not recovery.lost:
                    reporter.connected(port.baud_rate, port.latency_timer_ms)
                use(port)
            except PortLost as lost:
                # Before it is closed, for which a driver may take its time.
                reporter.lost(str(lost))
        port = None
        wait(node, recovery.lose())
