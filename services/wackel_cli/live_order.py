"""The inputs of one recorded service, in the order in which the live one took them in. No I/O.

A recorder hears topics in an order of its own, earlier or later than a service, and not the same
losses. What a service took in it tells on ``inputs/<service>/<instance>``; this puts that right.
"""

from bisect import insort
from collections import deque
from collections.abc import Iterator
from operator import attrgetter
from typing import TypeAlias

from wackel_schemas.inputs import Inputs
from wackel_schemas.keys import topic_of
from wackel_schemas.message import Message

SILENCE_NS = 3_000_000_000
"""A service tells its inputs twice a second: if it is silent for so long, none is there."""
BELATED_NS = 1_000_000_000
"""How much later than the word of it a message may be recorded."""

_ARRIVED = attrgetter("arrived_ns")

_Id: TypeAlias = tuple[str, int, int]
"""Key, boot, seq; publishers that do not number give the same one to many."""


class Input:
    """A message that a service takes in.

    Attributes:
        key: Below the robot's name.
        message: What came.
        arrived_ns: When the recorder got it, or what it follows from, UTC ns.
        id: By which a word names it.
    """

    __slots__ = ("arrived_ns", "id", "key", "message")

    def __init__(self, key: str, message: Message, arrived_ns: int) -> None:
        self.key = key
        self.message = message
        self.arrived_ns = arrived_ns
        self.id: _Id = (key, message.boot, message.seq)


class Restart:
    """The live service was started anew here, and had forgotten everything."""


class LiveOrder:
    """Takes in what was recorded; gives it back in the order of the live service.

    Where there was no live service, that is the order of arrival.

    Attributes:
        boot: Of the live service; absent while none was heard.
        restarts: How often it was started anew.
        unknown: Messages that it had and the recording has not.
        passed_over: Messages that the recording has and it never got.
        lost_words: How often something is missing before a word of it.
    """

    def __init__(self) -> None:
        self.boot: int | None = None
        self.restarts = self.unknown = self.passed_over = self.lost_words = 0
        self._waiting: dict[_Id, list[Input]] = {}
        self._arrivals: deque[Input] = deque()  # in order; with some that wait no longer
        self._named: deque[tuple[_Id | Restart, int]] = deque()  # with the time of the word
        self._latest: dict[str, Input] = {}
        self._next_word = 0
        self._heard_ns: int | None = None

    def add(self, item: Input) -> None:
        """A message was recorded."""
        arrivals = self._arrivals
        if arrivals and item.arrived_ns < arrivals[-1].arrived_ns:
            insort(arrivals, item, key=_ARRIVED)  # it follows from one that has waited
        else:
            arrivals.append(item)
        same = self._waiting.get(item.id)
        if same is None:
            self._waiting[item.id] = [item]
        else:
            same.append(item)

    def word(self, inputs: Inputs, now_ns: int) -> None:
        """The live service told what it took in."""
        if inputs.boot != self.boot:
            if self.boot is not None:
                self.restarts += 1
                self._named.append((Restart(), now_ns))
            self.boot, self._next_word = inputs.boot, 0
        names = list(_ids(inputs))
        if inputs.seq != self._next_word:
            # What it told before is lost: most likely, what had arrived before this.
            self.lost_words += 1
            self._named.extend((name, now_ns) for name in self._before(set(names)))
        self._next_word = inputs.seq + 1
        self._heard_ns = now_ns
        self._named.extend((name, now_ns) for name in names)

    def due(self, now_ns: int) -> Iterator[Input | Restart]:
        """What the live service had taken in, as far as it is known now.

        Args:
            now_ns: Up to which time of arrival the recording has been read.
        """
        newest: dict[tuple[str, int], int] = {}
        named, waiting, arrivals = self._named, self._waiting, self._arrivals
        while named:
            name, named_ns = named[0]
            if isinstance(name, Restart):
                named.popleft()
                self._latest.clear()
                yield name
                continue
            same = waiting.get(name)
            if same:
                key, boot, seq = name
                newest[key, boot] = seq
                item = same.pop(0)
                if not same:
                    del waiting[name]
            elif (again := self._latest.get(name[0])) is not None and again.id == name:
                item = again  # a latched one, told again
            elif now_ns - named_ns <= BELATED_NS:
                break
            else:
                self.unknown += 1
                named.popleft()
                continue
            named.popleft()
            topic = topic_of(item.key)
            if topic is not None and topic.latched:
                self._latest[item.key] = item
            yield item
        if newest:
            self._pass_over(newest)
        while arrivals and arrivals[0] not in waiting.get(arrivals[0].id, ()):
            arrivals.popleft()
        if self._heard_ns is None or now_ns - self._heard_ns > SILENCE_NS:
            yield from self._arrived_by(now_ns - SILENCE_NS)

    def rest(self) -> Iterator[Input | Restart]:
        """Everything else, at the end of the recording."""
        yield from self.due(self._heard_ns + SILENCE_NS if self._heard_ns is not None else 0)
        yield from self._arrived_by(None)

    def _arrived_by(self, limit_ns: int | None) -> Iterator[Input]:
        arrivals = self._arrivals
        while arrivals and (limit_ns is None or arrivals[0].arrived_ns <= limit_ns):
            item = arrivals.popleft()
            if self._waits(item):
                self._remove(item)
                yield item

    def _before(self, names: set[_Id]) -> list[_Id]:
        """What had arrived before any of these, if any of them has, and is not named yet."""
        named = {name for name, _ in self._named}
        found: list[_Id] = []
        for item in self._arrivals:
            if self._waits(item):
                if item.id in names:
                    return found
                if item.id not in named:
                    found.append(item.id)
        return []

    def _pass_over(self, newest: dict[tuple[str, int], int]) -> None:
        """Forgets what the live service cannot have got: it already had what came later."""
        late = {name for name in self._waiting if name[2] < newest.get(name[:2], 0)}
        if late:
            late.difference_update([name for name, _ in self._named])
        for name in late:
            self.passed_over += len(self._waiting.pop(name))

    def _waits(self, item: Input) -> bool:
        return item in self._waiting.get(item.id, ())

    def _remove(self, item: Input) -> None:
        same = self._waiting[item.id]
        same.remove(item)
        if not same:
            del self._waiting[item.id]


def _ids(inputs: Inputs) -> Iterator[_Id]:
    """The messages that a word names; what makes no sense in it names none."""
    counts = [0] * len(inputs.streams)
    for index in inputs.order:
        if 0 <= index < len(counts):
            stream = inputs.streams[index]
            yield stream.key, stream.boot, stream.seq + counts[index]
            counts[index] += 1
