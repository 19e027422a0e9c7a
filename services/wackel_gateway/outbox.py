"""What has happened on a bus and is not yet published.

A message wakes its readers, which costs more than to read it. So what is as it should be waits for
others to travel with; but never the state that control goes by, nor what a diagnosis waits for.
"""

from collections.abc import Callable

from wackel_gateway.outcome import Outcome

WAIT_NS = 20_000_000
"""Longest wait; and longest pause of a busy bus, beyond which nothing follows to travel with."""
SUSPECT_NS = 1_000_000_000
"""For so long after anything that is not as it should be, every answer is news to a diagnosis."""


class Outbox:
    """Outcomes in the order of the bus; states apart from transactions, which may wait longer.

    Args:
        transaction: Publishes what went over the wire.
        state: Publishes what it says.
    """

    def __init__(
        self, transaction: Callable[[Outcome], object], state: Callable[[Outcome], None]
    ) -> None:
        self._transaction = transaction
        self._state = state
        self._unstated: list[Outcome] = []
        self._travelling: list[Outcome] = []
        self._ended_ns = self._trouble_ns = -SUSPECT_NS
        self._busy = False

    @property
    def due_ns(self) -> int | None:
        """When :meth:`release` has to be called at the latest, monotonic; ``None`` if empty."""
        waiting = self._travelling or self._unstated
        return waiting[0].ended_ns + WAIT_NS if waiting else None

    def add(self, outcome: Outcome) -> None:
        """Takes in an outcome; of trouble the transaction goes out at once.

        It goes without its state, whose readers would keep the processor from the classifier.
        """
        self._busy = outcome.begin_ns - self._ended_ns < WAIT_NS
        self._ended_ns = outcome.ended_ns
        self._unstated.append(outcome)
        self._travelling.append(outcome)
        if not outcome.answers.clean or outcome.answers.has_errors:
            self._trouble_ns = outcome.ended_ns
            self._publish_transactions()

    def release(self, now_ns: int) -> None:
        """Publishes what can wait no longer; to be called when there is time."""
        due_ns = self.due_ns
        if due_ns is None:
            return
        if not self._busy or self._ended_ns - self._trouble_ns < SUSPECT_NS or now_ns >= due_ns:
            self.release_all()
        elif any(outcome.purpose != "background" for outcome in self._unstated):
            self._publish_states()

    def release_all(self) -> None:
        """Publishes everything."""
        self._publish_transactions()
        self._publish_states()

    def _publish_transactions(self) -> None:
        outcomes, self._travelling = self._travelling, []
        for outcome in outcomes:
            self._transaction(outcome)

    def _publish_states(self) -> None:
        outcomes, self._unstated = self._unstated, []
        for outcome in outcomes:
            self._state(outcome)
