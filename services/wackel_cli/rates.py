"""How often and how punctually messages of each key come. No clock here."""

from collections import defaultdict
from dataclasses import dataclass, field
from statistics import median

from wackel_schemas.message import Message, Record

_MAX_KEYS = 1024  # strangers may write on any number of them


class Rate(Record, kw_only=True):
    """One key over one period.

    Attributes:
        key: Below the robot's name.
        hz: Messages per second.
        shortest_s, longest_s: Between two messages; absent below two.
        age_s: Median from a message's stamp to its arrival; absent without stamps.
        lost: Messages that never came, by their numbers.
        bytes_per_s: Payload.
    """

    key: str
    hz: float
    shortest_s: float | None = None
    longest_s: float | None = None
    age_s: float | None = None
    lost: int = 0
    bytes_per_s: float = 0.0


@dataclass
class _Key:
    last_s: float | None = None
    number: tuple[int, int] | None = None
    intervals_s: list[float] = field(default_factory=list)
    ages_s: list[float] = field(default_factory=list)
    messages: int = 0
    lost: int = 0
    size: int = 0


class Rates:
    """Counts from one call of :meth:`take` to the next."""

    def __init__(self) -> None:
        self._keys: defaultdict[str, _Key] = defaultdict(_Key)

    def add(self, key: str, size: int, header: Message | None, now_s: float, utc_ns: int) -> None:
        """Counts a message.

        Args:
            key: Below the robot's name.
            size: Of the payload.
            header: If it has one.
            now_s: Monotonic clock.
            utc_ns: Wall clock.
        """
        if key not in self._keys and len(self._keys) == _MAX_KEYS:
            return
        entry = self._keys[key]
        entry.messages += 1
        entry.size += size
        if entry.last_s is not None:
            entry.intervals_s.append(now_s - entry.last_s)
        entry.last_s = now_s
        if header is None:
            return
        entry.ages_s.append((utc_ns - header.stamp) / 1e9)
        if entry.number is not None and entry.number[0] == header.boot:
            entry.lost += max(0, header.seq - entry.number[1] - 1)
        entry.number = (header.boot, header.seq)

    def take(self, period_s: float) -> list[Rate]:
        """The rates of the period that ends now, by key; begins the next one."""
        rates = []
        for key, entry in sorted(self._keys.items()):
            rates.append(
                Rate(
                    key=key,
                    hz=entry.messages / period_s,
                    shortest_s=min(entry.intervals_s, default=None),
                    longest_s=max(entry.intervals_s, default=None),
                    age_s=median(entry.ages_s) if entry.ages_s else None,
                    lost=entry.lost,
                    bytes_per_s=entry.size / period_s,
                )
            )
            self._keys[key] = _Key(last_s=entry.last_s, number=entry.number)
        return rates
