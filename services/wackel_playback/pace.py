"""When what is due: recorded time against the clock, at any speed, with pauses. No clock here."""

from collections.abc import Iterable, Iterator

from wackel_recording.reader import Entry

SLOWEST, FASTEST = 0.01, 1000.0


class Pace:
    """An absolute schedule: a message that went out late makes none of the later ones late.

    Attributes:
        speed: Recorded seconds per second.
        paused: Whether recorded time stands still.
    """

    def __init__(self, now_s: float, speed: float = 1.0, paused: bool = False) -> None:
        """Starts at the recorded time 0.

        Args:
            now_s: The clock's reading, as in all the methods.
            speed: Limited to SLOWEST … FASTEST.
            paused: Whether to begin with a pause.
        """
        self.speed = min(max(speed, SLOWEST), FASTEST)
        self.paused = paused
        self._anchor_s = now_s
        self._recorded_s = 0.0

    def wait_s(self, recorded_s: float, now_s: float) -> float:
        """How long until a message of that recorded time is due; infinite in a pause."""
        if self.paused:
            return float("inf")
        return self._anchor_s + (recorded_s - self._recorded_s) / self.speed - now_s

    def toggle(self, now_s: float) -> None:
        """Pauses, or goes on."""
        self._set_anchor(now_s)
        self.paused = not self.paused

    def scale(self, factor: float, now_s: float) -> None:
        """Makes it faster or slower from now on."""
        self._set_anchor(now_s)
        self.speed = min(max(self.speed * factor, SLOWEST), FASTEST)

    def _set_anchor(self, now_s: float) -> None:
        if not self.paused:
            self._recorded_s += (now_s - self._anchor_s) * self.speed
        self._anchor_s = now_s


def timed(
    recordings: Iterable[Iterable[Entry]], from_s: float = 0.0, to_s: float = float("inf")
) -> Iterator[tuple[float, Entry]]:
    """Messages with their recorded time in s after ``from_s``.

    Recordings that were made apart follow each other without the time between them.

    Args:
        recordings: Messages of each, in the order of their arrival.
        from_s, to_s: Only what lies between; counted from the first message of the first recording.
    """
    base_s = 0.0
    for entries in recordings:
        start_ns: int | None = None
        at_s = base_s
        for entry in entries:
            if start_ns is None:
                start_ns = entry.arrived_ns
            at_s = max(at_s, base_s + (entry.arrived_ns - start_ns) / 1e9)
            if at_s > to_s:
                return
            if at_s >= from_s:
                yield at_s - from_s, entry
        base_s = at_s
