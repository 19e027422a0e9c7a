"""One gateway process: the node, the publishing side, and the mode that owns the bus."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from wackel_gateway.poll import Poller
from wackel_gateway.proxy import Proxy
from wackel_gateway.reporter import Reporter
from wackel_gateway.roster import Roster
from wackel_gateway.tap import Tap
from wackel_node.config import BusConfig, RobotConfig
from wackel_node.node import Node

_TIMER_SLACK_NS = 1000
"""By default Linux wakes a sleeper up to 50 µs late, a tenth of a servo's whole answer."""


class _Owner(Protocol):
    """A way to own a bus."""

    def __init__(self, node: Node, bus: str, config: BusConfig, reporter: Reporter) -> None: ...

    def run(self) -> None:
        """Until the node stops."""


_MODES: Mapping[str, type[_Owner]] = {"poll": Poller, "proxy": Proxy, "tap": Tap}


def run(config: RobotConfig, bus: str) -> None:
    """Serves one bus until the process is told to stop.

    Raises:
        ConfigError: The configuration names a model that no control table describes, or a port
            that cannot be offered.
    """
    bus_config = config.buses[bus]
    roster = Roster(bus_config.servos)
    with suppress(OSError):  # only a kernel without procfs, where waking late still works
        Path("/proc/self/timerslack_ns").write_text(str(_TIMER_SLACK_NS))
    with Node("gateway", bus, config) as node:
        reporter = Reporter(node, bus, bus_config, roster)
        owner = _MODES[bus_config.mode](node, bus, bus_config, reporter)
        node.await_links()
        node.ready()
        owner.run()
