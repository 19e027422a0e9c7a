"""Which servo to ping next: those that have just fallen out of the cycle, and those that are
silent in turn."""

from collections import Counter, deque

from wackel_gateway.job import Job, ping
from wackel_gateway.presence import Chain

_PROOFS = 4
"""Pings that convict a silent servo; ordinary loss takes so many in a row once in 10^12."""


class Pings:
    """Two queues of servos that are not in the cycle.

    Args:
        chain: All servos.

    Attributes:
        fresh: Servos of which it is not known yet whether they are silent.
        silent: Those that have not answered.
    """

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self.restart()

    def restart(self) -> None:
        """No servo is known to be there."""
        self.fresh: deque[int] = deque(self._chain)
        self.silent: deque[int] = deque()
        self._waiting = set(self._chain)
        self._unanswered: Counter[int] = Counter()  # pings in a row

    def add(self, servo_id: int) -> None:
        """A servo has left the cycle."""
        if servo_id not in self._waiting:
            self._waiting.add(servo_id)
            self.fresh.append(servo_id)

    def missed(self, servo_id: int) -> None:
        """A ping was not answered."""
        self._unanswered[servo_id] += 1
        self.silent.append(servo_id)

    def answered(self, servo_id: int) -> None:
        """A ping was; what has come back seldom comes alone."""
        self._waiting.discard(servo_id)
        self._unanswered.pop(servo_id, None)
        self.fresh.extend(self.silent)
        self.silent.clear()

    def next_fresh(self, now_ns: int) -> Job | None:
        """The ping of the first whose time has come."""
        return self._next(self.fresh, now_ns)

    def next_silent(self, now_ns: int) -> Job | None:
        """The same of those that are silent; first those of which a few more pings tell what has
        happened.

        These are the ones with others behind them that answer, and the first of those at the end.
        """
        last = max((s.place for s in self._chain.values() if s.present), default=-1)
        for servo_id in self.silent:
            if self._unanswered[servo_id] < _PROOFS and self._chain[servo_id].place <= last + 1:
                self.silent.remove(servo_id)
                self.silent.appendleft(servo_id)
                break
        return self._next(self.silent, now_ns)

    def _next(self, waiting: deque[int], now_ns: int) -> Job | None:
        for _ in range(len(waiting)):
            servo_id = waiting.popleft()
            if self._chain[servo_id].not_before_ns <= now_ns:
                return ping(servo_id)
            waiting.append(servo_id)
        return None
