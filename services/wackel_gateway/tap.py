"""Mode tap: a second adapter on the wires of somebody else's bus; it never writes."""

from time import monotonic_ns

from wackel_gateway.commands import Refused
from wackel_gateway.outbox import Outbox
from wackel_gateway.patience import Patience
from wackel_gateway.port import Port, PortLost
from wackel_gateway.reporter import Reporter
from wackel_gateway.retry import keep_open
from wackel_gateway.segment import Segmenter
from wackel_gateway.waiting import wait_ms
from wackel_node.config import BusConfig
from wackel_node.node import Node
from wackel_schemas import keys
from wackel_schemas.bus import BusReply, BusRequest

_ONLY_LISTENS = Refused("not the master", "this gateway only listens")


class Tap:
    """Turns what is heard into transactions."""

    def __init__(self, node: Node, bus: str, config: BusConfig, reporter: Reporter) -> None:
        self._node = node
        self._config = config
        self._reporter = reporter
        node.subscribe(keys.COMMAND, lambda *_: reporter.refused("command", _ONLY_LISTENS), bus=bus)
        node.serve(keys.BUS_REQUEST, self._request, bus=bus)

    def run(self) -> None:
        """Until the node stops."""
        keep_open(self._node, self._config, self._reporter, self._listen)

    def _listen(self, port: Port) -> None:
        patience = Patience(port.baud_rate, port.latency_timer_ms)
        segmenter = Segmenter(patience, port.baud_rate)
        outbox = Outbox(self._reporter.transaction, self._reporter.state)
        try:
            while not self._node.stopping:
                if port.wait(wait_ms(segmenter.due_ns, outbox.due_ns)):
                    data = port.read()
                    if not data:
                        raise PortLost("it was closed from the other side")
                    outcomes = segmenter.both(monotonic_ns(), data)
                else:
                    outcomes = segmenter.idle(monotonic_ns())
                for outcome in outcomes:
                    outbox.add(outcome)
                outbox.release(monotonic_ns())
                self._node.pump()
        finally:
            outbox.release_all()

    def _request(self, _: BusRequest) -> BusReply:
        self._reporter.refused("request", _ONLY_LISTENS)
        return BusReply(stamp=self._node.clock.now_ns(), ok=False, text=str(_ONLY_LISTENS))
