"""The life of a service: starting, ready, heartbeat, stopping on a signal, crashed with reason."""

import os
import signal
import time
import traceback as tracebacks
from collections.abc import Callable
from pathlib import Path
from types import FrameType, TracebackType
from typing import Literal, Self

from wackel_node.config import RobotConfig
from wackel_node.errors import Explained
from wackel_node.garbage import collect_rarely
from wackel_node.journal import Journal
from wackel_node.link import Link
from wackel_node.log import logger
from wackel_node.notify import notify
from wackel_node.publisher import Publisher
from wackel_node.stop_signals import stop_signals
from wackel_schemas.health import Heartbeat
from wackel_schemas.inputs import Inputs
from wackel_schemas.keys import ALIVE, INPUTS, ROOT
from wackel_schemas.message import Message

_LINKING_S = 0.5  # links to all services are up in a tenth of this
_LINKED_S = 0.1  # twice as long as that takes
_MOST_REASON = 1000  # characters
HEARTBEAT_S = 0.5  # a hung service shows after 2.5 of these, well within two seconds

State = Literal["starting", "ready", "stopping", "crashed"]


class Node(Link):
    """A link with a life cycle; one per service process, in its main thread.

    Everyone sees it by its liveliness token (process there), its heartbeat (main loop turns) and
    the state in the heartbeat. A signal to stop ends :meth:`run`; leaving the ``with`` block by an
    exception publishes it as the reason of a crash.

    Args:
        service, instance: Its name.
        config: The robot's.
        also_at: An endpoint at which it is reached without a rendezvous, unless that is taken.
    """

    def __init__(
        self, service: str, instance: str, config: RobotConfig, also_at: str | None = None
    ) -> None:
        super().__init__(config, "peer", also_at)
        self.name = f"{service}/{instance}"
        self.stopping = False
        self._opened_s = time.monotonic()
        self._state: State = "starting"
        self._heartbeats = self.publisher(ALIVE, service=service, instance=instance)
        self._token = self.session.liveliness().declare_token(
            f"{ROOT}/{config.robot}/" + ALIVE.key(service=service, instance=instance)
        )
        self._journal: Journal | None = None
        self._inputs: Publisher[Inputs] | None = None
        self._previous: dict[int, Callable[[int, FrameType | None], None] | int | None] = {}

    def __enter__(self) -> Self:
        for number in stop_signals():
            self._previous[number] = signal.signal(number, lambda *_: self.stop())
        self._beat()
        self.every(HEARTBEAT_S, self._beat)
        # What was told before anyone was linked is told again, not half a second later.
        self.on_reader(self._heartbeats, self._beat)
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.tell_inputs()
        if exc is None or isinstance(exc, KeyboardInterrupt):
            self._enter("stopping")
        else:
            if not isinstance(exc, Explained):  # which the command prints
                logger.error("crashed: %s", _reason(exc))  # the interpreter prints the traceback
            self._wait_for_a_reader()
            self._enter("crashed", _reason(exc))
        notify("STOPPING=1")
        super().__exit__(exc_type, exc, traceback)
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def await_links(self) -> None:
        """To be called before the first message by a service from which others conclude.

        Links to those that are there come up one after the other. What is said meanwhile reaches
        some and not a recorder, and then nobody can conclude from its recording what they did.
        """
        limit = self._opened_s + _LINKED_S
        while not self.stopping and (left_s := limit - time.monotonic()) > 0:
            self.pump(left_s)

    def ready(self) -> None:
        """Tells everyone, and systemd, that the service does its work from now on."""
        collect_rarely()
        self._enter("ready")
        notify("READY=1")
        logger.info("ready")

    def keep_journal(self) -> None:
        """Tells from now on what is taken in: with that, a replay concludes what this one does."""
        service, instance = self.name.split("/")
        self._journal = Journal()
        self._inputs = self.publisher(INPUTS, service=service, instance=instance)
        self.every(HEARTBEAT_S, self.tell_inputs)

    def tell_inputs(self) -> None:
        """Tells what was taken in; while nobody is linked who would hear it, that is kept."""
        if self._journal is None or self._inputs is None:
            return
        if self._inputs.has_reader or self._journal.full:
            word = self._journal.word(self.clock.now_ns())
            if word is not None:
                self._inputs.put(word)

    def run(self) -> None:
        """Handles messages and timers until a signal or :meth:`stop`."""
        with self.handle_at_once():
            while not self.stopping:
                self.pump(HEARTBEAT_S)

    def stop(self) -> None:
        """Ends :meth:`run` soon; safe from handlers and signal handlers."""
        self.stopping = True
        self.wake()

    def taken(self, key: str, message: Message) -> None:
        """Also by services, of what is no message of a subscription and yet an input."""
        if self._journal is not None:
            self._journal.take(key, message)
            if self._journal.full:
                self.tell_inputs()

    def _wait_for_a_reader(self) -> None:
        """A crash right at the start would otherwise be told before anyone is linked."""
        limit = time.monotonic() + _LINKING_S
        while not self._heartbeats.has_reader and time.monotonic() < limit:
            time.sleep(0.01)

    def _enter(self, state: State, reason: str = "") -> None:
        self._state = state
        self._beat(reason)

    def _beat(self, reason: str = "") -> None:
        step_ns = self.clock.follow()
        if step_ns:
            logger.warning("the wall clock was set by %.1f s; stamps follow", step_ns / 1e9)
        self._heartbeats.put(
            Heartbeat(
                stamp=self.clock.now_ns(),
                state=self._state,
                period_s=HEARTBEAT_S,
                pid=os.getpid(),
                reason=reason,
                received=self.received,
                lost=self.lost,
                overrun=self.overrun,
                rejected=self.rejected,
                rejection=self.rejection,
            )
        )
        notify("WATCHDOG=1")


def _reason(error: BaseException) -> str:
    """``ValueError: text (core.py:12)``; of what is explained, the text, which is all one needs."""
    if isinstance(error, Explained):
        return str(error)[:_MOST_REASON]
    frames = tracebacks.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {str(error)[:_MOST_REASON]}{place}"
