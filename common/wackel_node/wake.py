"""Waking a thread that waits: from other threads and from signal handlers."""

import threading
from collections import deque
from contextlib import suppress


class Wake:
    """Words for one thread, which waits until there is one.

    A lock, held while there is nothing to wake for. ``queue.SimpleQueue`` seems made for this, but
    up to Python 3.12 its ``get`` waits for ever where a short timeout is over before it has begun
    to wait (it takes what is left, a negative number, for no limit), as happens on a busy computer.
    ``threading.Event`` is not for signal handlers: one that interrupts its ``set`` waits for ever.
    """

    def __init__(self) -> None:
        self._words: deque[bool] = deque()
        self._nothing = threading.Lock()
        self._nothing.acquire()

    def __bool__(self) -> bool:
        """Whether there is a word."""
        return bool(self._words)

    def put(self, word: bool) -> None:
        """Wakes who waits, or else who waits next; from any thread and signal handler."""
        self._words.append(word)
        with suppress(RuntimeError):  # it is to wake already
            self._nothing.release()

    def wait(self, timeout_s: float) -> bool | None:
        """Until there is a word; to be called by one thread at a time.

        Args:
            timeout_s: Longest wait; none where it is not above zero. It may end early.

        Returns:
            Whether any of the words that were there is true; ``None`` if there was none.
        """
        self._nothing.acquire(timeout=max(timeout_s, 0.0))
        word = None
        while self._words:
            word = self._words.popleft() or word or False
        return word
