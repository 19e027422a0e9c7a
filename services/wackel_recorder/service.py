"""Topics into the files of a recording; a disk that fails costs messages, never the service."""

from collections.abc import Callable, Sequence

from wackel_node.absence import Absence
from wackel_node.clock import Clock
from wackel_node.listen import header_of, listen
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_recording.writer import FLUSH_S, RecordingWriter
from wackel_schemas import component
from wackel_schemas.fault import FaultReport
from wackel_schemas.keys import FAULT

RETRY_S = 5.0  # a disk that was full is not tried more often than a person could make room
_REPEAT_S = 1.0


class Recorder:
    """Records what matches the patterns, from construction until :meth:`close`.

    Attributes:
        dropped: Messages that came while no file could be written.
        others: Whether anything came from another process than this one.
    """

    def __init__(
        self,
        node: Node,
        writer: RecordingWriter,
        patterns: Sequence[str],
        progress: Callable[["Recorder"], None] = lambda _: None,
    ) -> None:
        """Subscribes.

        Raises:
            BadPattern: As :func:`listen`.
        """
        self.writer = writer
        self.dropped = 0
        self.others = False
        self._node = node
        self._clock = Clock()  # its own: a wall clock that is set leaves no gap in a recording
        self._faults = node.publisher(FAULT, source="recorder")
        self._arrived_ns = 0
        self._disk = Absence("recording_paused", component.service(node.name), "the disk")
        self._ticks = 0
        self._progress = progress
        listen(node, patterns, self._take)
        node.every(FLUSH_S, self._tick)
        node.every(_REPEAT_S, lambda: self._tell(self._disk.again(node.clock.now_ns())))

    @property
    def lost(self) -> int:
        """Messages that are in no file, at most."""
        return self.dropped + self.writer.lost

    def close(self) -> bool:
        """Takes what has arrived, and ends the file with its index; whether that could be done."""
        self._node.pump()
        try:
            self.writer.close()
        except OSError as error:
            logger.error("the last file cannot be finished: %s", self._reason(error))
            self.writer.abandon()
            return False
        return True

    def _take(self, key: str, payload: bytes) -> None:
        # When Zenoh had it: here it may have waited. Of two of its threads, one may be late.
        arrived_ns = max(self._arrived_ns, self._clock.stamp_ns(self._node.arrived_ns))
        self._arrived_ns = arrived_ns
        header = header_of(key, payload)
        self._node.received += 1
        if header is not None:
            self._node.notice_gap(key, header)
            self.others = self.others or header.boot != self._node.boot
        if self._disk.active or not self._guarded(
            lambda: self.writer.add(key, arrived_ns, payload, header)
        ):
            self.dropped += 1

    def _tick(self) -> None:
        self._ticks += 1
        if not self._disk.active:
            self._guarded(self.writer.flush)
        elif self._ticks % round(RETRY_S / FLUSH_S) == 0 and self._guarded(self.writer.open):
            logger.warning("recording again into %s", self.writer.path)
            self._tell(self._disk.back(self._node.clock.now_ns()))
        self._progress(self)

    def _guarded(self, act: Callable[[], object]) -> bool:
        """Whether it was done; if not, recording pauses."""
        try:
            act()
        except OSError as error:
            reason = self._reason(error)
            if not self._disk.active:
                logger.error("recording pauses, next attempt in %g s: %s", RETRY_S, reason)
            self._tell(self._disk.lost(reason, self._node.clock.now_ns()))
            self.writer.abandon()
            return False
        return True

    def _reason(self, error: OSError) -> str:
        where = error.filename or self.writer.path
        return f"{where}: {error.strerror}" if error.strerror else str(error)

    def _tell(self, report: FaultReport | None) -> None:
        if report is not None:
            self._faults.put(report)
