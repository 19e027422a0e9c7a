"""Mode proxy: the user's software is the master, through a pseudo-terminal that we pass on.

The forwarding itself is :mod:`.forward`, in a process of its own; here its records become
transactions.
"""

import json
import select
import socket
import subprocess
import sys
from contextlib import suppress
from time import monotonic, monotonic_ns, sleep

from wackel_gateway.commands import Refused
from wackel_gateway.forward import MAX_RECORD, STOP, Kind, Record, Task
from wackel_gateway.outbox import Outbox
from wackel_gateway.patience import Patience
from wackel_gateway.recovery import Recovery
from wackel_gateway.reporter import Reporter
from wackel_gateway.retry import wait
from wackel_gateway.segment import Segmenter
from wackel_gateway.waiting import wait_ms
from wackel_node.config import BusConfig, ConfigError
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_schemas import keys
from wackel_schemas.bus import BusReply, BusRequest

_START_S = 10.0  # Python and pyserial on a small computer under load
_STOP_S = 0.5
_LOOK_S = 0.005
_GATHER_S = 0.001  # the records of one transaction in one go, not waking up for each of them
_NOT_MASTER = Refused("not the master", "the bus belongs to the software that opened the port")


class Proxy:
    """Turns the forwarder's records into transactions."""

    def __init__(self, node: Node, bus: str, config: BusConfig, reporter: Reporter) -> None:
        self._node = node
        self._task = Task(config.port, config.baud_rate, config.proxy_port)
        self._reporter = reporter
        self._outbox = Outbox(reporter.transaction, reporter.state)
        self._segmenter = Segmenter(Patience(config.baud_rate), config.baud_rate)
        self._latency_timer_ms: int | None = None
        node.subscribe(keys.COMMAND, lambda *_: reporter.refused("command", _NOT_MASTER), bus=bus)
        node.serve(keys.BUS_REQUEST, self._request, bus=bus)

    def run(self) -> None:
        """Until the node stops; then the forwarder stops too."""
        recovery = Recovery()
        while not self._node.stopping:
            with attach(self._task) as forwarder:
                self._read(forwarder)
                self._outbox.release_all()
                if self._node.stopping:
                    stop(forwarder)
                    return
            logger.error("the forwarder ended; starting another")
            wait(self._node, recovery.lose())

    def _read(self, forwarder: socket.socket) -> None:
        """Until the node stops or the forwarder ends."""
        waiting = select.poll()
        waiting.register(forwarder.fileno(), select.POLLIN)
        while not self._node.stopping:
            if waiting.poll(wait_ms(self._segmenter.due_ns, self._outbox.due_ns)):
                sleep(_GATHER_S)
            now = monotonic_ns()
            while True:
                try:
                    data = forwarder.recv(MAX_RECORD)
                except BlockingIOError:
                    break
                if not data:
                    return
                self._take(Record.decode(data))
            for outcome in self._segmenter.idle(now):
                self._outbox.add(outcome)
            self._outbox.release(now)
            self._node.pump()

    def _take(self, record: Record) -> None:
        kind, at_ns, payload = record
        if kind is Kind.HOST:
            outcomes = self._segmenter.host(at_ns, payload)
        elif kind is Kind.BUS:
            outcomes = self._segmenter.bus(at_ns, payload)
        else:
            self._notice(kind, json.loads(payload))
            return
        for outcome in outcomes:
            self._outbox.add(outcome)

    def _notice(self, kind: Kind, values: dict[str, object]) -> None:
        match kind, values:
            case Kind.OPEN, {"baud_rate": int(rate), "latency_timer_ms": latency_timer_ms}:
                self._latency_timer_ms = (
                    latency_timer_ms if isinstance(latency_timer_ms, int) else None
                )
                self._change_rate(rate)
                self._reporter.connected(rate, self._latency_timer_ms)
            case Kind.RATE, {"baud_rate": int(rate)}:
                logger.info("the port's user chose %d bit/s", rate)
                self._change_rate(rate)
            case Kind.LOST, {"reason": str(reason)}:
                self._reporter.lost(reason)
            case Kind.DROPPED, {"count": int(count)}:
                self._node.lost += count
                logger.warning("%d records lost: this process was too slow", count)

    def _change_rate(self, rate: int) -> None:
        self._reporter.statistics.baud_rate = rate
        self._segmenter.change_rate(Patience(rate, self._latency_timer_ms), rate)

    def _request(self, _: BusRequest) -> BusReply:
        self._reporter.refused("request", _NOT_MASTER)
        return BusReply(stamp=self._node.clock.now_ns(), ok=False, text=str(_NOT_MASTER))


def attach(task: Task) -> socket.socket:
    """A connection to the forwarder of a task: the one that runs, or a new one.

    Raises:
        ConfigError: It cannot do its task; one line with the reason.
    """
    running = _connect(task)
    if running is not None:
        told = json.loads(Record.decode(running.recv(MAX_RECORD)).payload)
        if told == task._asdict():
            logger.info("attached to the forwarder that kept control going")
            running.setblocking(False)
            return running
        stop(running)  # the configuration has changed
        running.close()
    # A session of its own: Ctrl-C in the terminal is for us, and we stop it in order.
    process = subprocess.Popen(
        [sys.executable, "-m", "wackel_gateway.forward", json.dumps(task)],
        stdin=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    limit = monotonic() + _START_S
    while monotonic() < limit:
        started = _connect(task)
        if started is not None:
            started.recv(MAX_RECORD)
            started.setblocking(False)
            return started
        if process.poll() is not None:
            assert process.stderr is not None
            raise ConfigError(process.stderr.read().strip() or "the forwarder does not start")
        sleep(_LOOK_S)
    process.kill()
    raise ConfigError(f"the forwarder of {task.proxy_port} does not start")


def stop(forwarder: socket.socket) -> None:
    """Ends a forwarder and waits until its port and its link are gone."""
    forwarder.settimeout(_STOP_S)
    with suppress(OSError):
        forwarder.send(STOP)
        while forwarder.recv(MAX_RECORD):
            pass


def _connect(task: Task) -> socket.socket | None:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    connection.settimeout(_START_S)
    try:
        connection.connect(task.address())
    except OSError:
        connection.close()
        return None
    return connection
