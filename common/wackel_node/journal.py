"""Writes down which messages a service takes in, and in which order. No I/O."""

from wackel_schemas.inputs import Inputs, InputStream
from wackel_schemas.message import Message

MOST = 2000
"""Messages in one word: less than ``MOST_BYTES`` even if each is a stream of its own, as those of
publishers that do not number are; and more than come within a second."""


class Journal:
    """The messages since the last word."""

    def __init__(self) -> None:
        self._streams: list[InputStream] = []
        self._order: list[int] = []
        self._open: dict[str, tuple[int, int, int]] = {}  # by key: boot, next seq, stream

    @property
    def full(self) -> bool:
        """Whether no more should be taken before the next word."""
        return len(self._order) >= MOST

    def take(self, key: str, message: Message) -> None:
        """A message that the service is about to handle."""
        boot, seq, stream = self._open.get(key, (0, -1, 0))
        if message.boot != boot or message.seq != seq:
            boot, seq, stream = message.boot, message.seq, len(self._streams)
            self._streams.append(InputStream(key=key, boot=boot, seq=seq))
        self._open[key] = boot, seq + 1, stream
        self._order.append(stream)

    def word(self, stamp: int) -> Inputs | None:
        """What was taken since the last one, if anything.

        Args:
            stamp: Now, UTC ns.
        """
        if not self._order:
            return None
        word = Inputs(stamp=stamp, streams=self._streams, order=self._order)
        self._streams, self._order, self._open = [], [], {}
        return word
