"""When a port that was lost is tried again, and when it counts as back. Pure; monotonic ns."""

_FIRST_NS = 50_000_000
_LAST_NS = 1_000_000_000
_LASTED_NS = 1_000_000_000


class Recovery:
    """The losses of one port: it is tried again soon at first, then less and less often.

    To open is not to work: a wedged adapter opens and takes no bytes. So a port that was lost is
    back once something has been heard from it, or once it has lasted, since all servos may be
    silent.

    Attributes:
        lost: Whether it was lost and is not back.
    """

    def __init__(self) -> None:
        self.lost = False
        self._pause_ns = _FIRST_NS
        self._opened_ns = 0

    def lose(self) -> int:
        """It was lost, or cannot be opened; returns for how long to wait."""
        self.lost = True
        pause_ns = self._pause_ns
        self._pause_ns = min(_LAST_NS, 2 * pause_ns)
        return pause_ns

    def opened(self, now_ns: int) -> None:
        """It is open again."""
        self._opened_ns = now_ns

    def back(self, now_ns: int, *, heard: bool) -> bool:
        """Whether a port that was lost and is open is back; tells it once.

        Args:
            now_ns: Time.
            heard: Whether anything came from it since it was opened.
        """
        if not self.lost or not (heard or now_ns - self._opened_ns >= _LASTED_NS):
            return False
        self.lost = False
        self._pause_ns = _FIRST_NS
        return True
