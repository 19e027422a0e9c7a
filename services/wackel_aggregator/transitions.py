"""The numbered log of changes, from which times between failures follow."""

from collections import deque
from collections.abc import Iterable

from wackel_node.clock import Instant
from wackel_schemas.health import Transition

# What a reader may miss between two of its looks at health: a broken cable on a chain of twenty
# servos, with its healing, fits.
KEPT = 64


class TransitionLog:
    """Numbers changes without gaps, also over restarts, and keeps the latest.

    Attributes:
        latest: Oldest first.
    """

    def __init__(self, earlier: Iterable[Transition] = ()) -> None:
        self.latest: deque[Transition] = deque(earlier, maxlen=KEPT)

    @property
    def next_number(self) -> int:
        """What the next change will be numbered."""
        return self.latest[-1].number + 1 if self.latest else 0

    def add(self, subject: str, before: str, after: str, now: Instant) -> None:
        """Numbers one change."""
        self.latest.append(
            Transition(
                number=self.next_number,
                stamp=now.utc_ns,
                subject=subject,
                before=before,
                after=after,
            )
        )
