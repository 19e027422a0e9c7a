"""The inputs of one recorded service, in the order in which the live one took them in. No I/O.

A recorder hears topics in an order of its own, earlier or later than a service, and not the same
losses. What a service took in it tells on ``inputs/<service>/<instance>``; this puts that right.
"""

from collections import defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import TypeAlias

from wackel_schemas.inputs import Inputs
from wackel_schemas.keys import topic_of
from wackel_schemas.message import Message

SILENCE_NS = 3_000_000_000
"""A service tells its inputs twice a second: if it is silent for so long, none is there."""
BELATED_NS = 1_000_000_000
"""How much later than the word of it a message may be recorded."""

_Id: TypeAlias = tuple[str, int, int]
"""Key, boot, seq; publishers that do not number give the same one to many."""


@dataclass(slots=True)
class Input:
    """A message that a service takes in.

    Attributes:
        key: Below the robot's name.
        message: What came.
        arrived_ns: When the recorder got it, or what it follows from, UTC ns.
    """

    key: str
    message: Message
    arrived_ns: int

    @property
    def id(self) -> _Id:
        """By which a word names it."""
        return self.key, self.message.boot, self.message.seq


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
        self._count = 0
        self._waiting: dict[int, Input] = {}  # by number
        self._arrivals: list[tuple[int, int]] = []  # time and number, a heap
        self._numbers: defaultdict[_Id, deque[int]] = defaultdict(deque)
        self._named: deque[tuple[_Id | Restart, int]] = deque()  # with the time of the word
        self._latest: dict[str, Input] = {}
        self._next_word = 0
        self._heard_ns: int | None = None

    def add(self, item: Input) -> None:
        """A message was recorded."""
        self._waiting[self._count] = item
        heappush(self._arrivals, (item.arrived_ns, self._count))
        self._numbers[item.id].append(self._count)
        self._count += 1

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
            known = (self._numbers[name][0] for name in names if self._numbers.get(name))
            first = min(known, default=0)
            taken = {name for name, _ in self._named}
            self._named.extend(
                (item.id, now_ns)
                for number, item in self._waiting.items()
                if number < first and item.id not in taken
            )
        self._next_word = inputs.seq + 1
        self._heard_ns = now_ns
        self._named.extend((name, now_ns) for name in names)

    def due(self, now_ns: int) -> Iterator[Input | Restart]:
        """What the live service had taken in, as far as it is known now.

        Args:
            now_ns: Up to which time of arrival the recording has been read.
        """
        newest: dict[tuple[str, int], int] = {}
        while self._named:
            name, named_ns = self._named[0]
            if isinstance(name, Restart):
                self._named.popleft()
                self._latest.clear()
                yield name
                continue
            numbers = self._numbers.get(name)
            if numbers:
                newest[name[:2]] = name[2]
                item = self._pop(numbers[0])
            elif (again := self._latest.get(name[0])) is not None and again.id == name:
                item = again  # a latched one, told again
            elif now_ns - named_ns <= BELATED_NS:
                break
            else:
                self.unknown += 1
                self._named.popleft()
                continue
            self._named.popleft()
            topic = topic_of(item.key)
            if topic is not None and topic.latched:
                self._latest[item.key] = item
            yield item
        if newest:
            self._pass_over(newest)
        self._forget_arrivals()
        if self._heard_ns is None or now_ns - self._heard_ns > SILENCE_NS:
            yield from self._arrived_by(now_ns - SILENCE_NS)

    def rest(self) -> Iterator[Input | Restart]:
        """Everything else, at the end of the recording."""
        yield from self.due(self._heard_ns + SILENCE_NS if self._heard_ns is not None else 0)
        yield from self._arrived_by(None)

    def _arrived_by(self, limit_ns: int | None) -> Iterator[Input]:
        while self._arrivals and (limit_ns is None or self._arrivals[0][0] <= limit_ns):
            yield self._pop(self._arrivals[0][1])
            self._forget_arrivals()

    def _pass_over(self, newest: dict[tuple[str, int], int]) -> None:
        """Forgets what the live service cannot have got: it already had what came later."""
        named = {name for name, _ in self._named}
        late = [
            number
            for number, item in self._waiting.items()
            if item.message.seq < newest.get(item.id[:2], 0) and item.id not in named
        ]
        for number in late:
            self._pop(number)
        self.passed_over += len(late)

    def _forget_arrivals(self) -> None:
        """Of what waits no longer."""
        while self._arrivals and self._arrivals[0][1] not in self._waiting:
            heappop(self._arrivals)

    def _pop(self, number: int) -> Input:
        item = self._waiting.pop(number)
        numbers = self._numbers[item.id]
        numbers.remove(number)
        if not numbers:
            del self._numbers[item.id]
        return item


def _ids(inputs: Inputs) -> Iterator[_Id]:
    """The messages that a word names; what makes no sense in it names none."""
    counts = [0] * len(inputs.streams)
    for index in inputs.order:
        if 0 <= index < len(counts):
            stream = inputs.streams[index]
            yield stream.key, stream.boot, stream.seq + counts[index]
            counts[index] += 1
