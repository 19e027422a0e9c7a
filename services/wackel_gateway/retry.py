"""Waiting before a port is tried again: soon at first, then less and less often."""

from time import monotonic

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
