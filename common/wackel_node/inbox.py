"""Between Zenoh's threads, which receive, and the turns in which handlers run."""

import ctypes
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from wackel_schemas.keys import MOST_HEALTH_BYTES

# How many messages wait for a busy reader: of state a quarter of a second at 1 kHz, of evidence
# several seconds, which also bounds the age of what is still worth reading.
_DEPTH = {"newest": 256, "all": 4096}
_MOST_WAITING = 4 * MOST_HEALTH_BYTES  # bytes in one inbox

Arrival: TypeAlias = tuple[int, "Inbox", Any, int]
"""When, monotonic ns; inbox, item, bytes. By the time, items of several inboxes keep order."""

_zenoh_thread = threading.local()


def _keep_thread_state() -> None:
    """Keeps Python's own state of the Zenoh thread that calls.

    Python otherwise makes one for each callback and frees it behind it, which maps and unmaps
    memory: more than a third of what it takes to receive a message.
    """
    if not hasattr(_zenoh_thread, "kept"):
        _zenoh_thread.kept = True
        ctypes.pythonapi.PyGILState_Ensure()


class Inbox:
    """What one subscription or query has received and its handler has not yet seen.

    Args:
        keep: ``newest`` or ``all``, which decides how much may wait.
        deliver: Hands an item to the handler, in a turn.
        came: Called when something has come.

    Attributes:
        overrun: How many items gave way.
    """

    def __init__(self, keep: str, deliver: Callable[[Any], None], came: Callable[[], None]):
        self.deliver = deliver
        self.overrun = 0
        self._depth = _DEPTH[keep]
        self._items: deque[Arrival] = deque()
        self._bytes = 0
        self._lock = threading.Lock()
        self._came = came

    def add(self, item: Any, size: int = 0) -> None:
        """Something has come; on a thread of Zenoh's. The oldest gives way where there is no room.

        Args:
            item: What.
            size: Bytes.
        """
        _keep_thread_state()
        with self._lock:
            self._items.append((time.monotonic_ns(), self, item, size))
            self._bytes += size
            while len(self._items) > self._depth or self._bytes > _MOST_WAITING:
                self._bytes -= self._items.popleft()[-1]
                self.overrun += 1
        self._came()

    def take(self) -> deque[Arrival]:
        """What is there now; what comes meanwhile is for the next turn, so a flood starves none."""
        with self._lock:
            items, self._items = self._items, deque()
            self._bytes = 0
        return items
