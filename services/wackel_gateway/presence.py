"""Which servos are there, as far as the master knows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from wackel_gateway.roster import Member

_FIRST_SETBACK_NS = 10_000_000
_MOST_SETBACK_NS = 1_000_000_000
"""A servo that answers pings but no reads is tried again after 10 ms, 20 ms, … 1 s; a device that
is silent, too."""
_MOST_DOUBLINGS = 7


@dataclass(slots=True)
class Presence:
    """A servo.

    Attributes:
        member: Which.
        place: In the chain, from 0.
        present: The cycle asks it.
        proven: It has answered a read since it joined.
        scattered: Answers in a row that were lost though servos behind it answered.
        setbacks: How often in a row it answered a ping but not the read that followed.
        not_before_ns: When it may be pinged again.
    """

    member: Member
    place: int
    present: bool = False
    proven: bool = False
    scattered: int = 0
    setbacks: int = 0
    not_before_ns: int = 0

    def restart(self) -> None:
        """Nothing is known of it."""
        self.present = self.proven = False
        self.setbacks = self.scattered = self.not_before_ns = 0


Chain: TypeAlias = Mapping[int, Presence]
"""All servos by id, in cable order."""


def present(chain: Chain) -> tuple[int, ...]:
    """Servos that the cycle asks, in cable order."""
    return tuple(servo_id for servo_id, servo in chain.items() if servo.present)


def setback_ns(count: int) -> int:
    """How long to wait after so many setbacks in a row."""
    return min(_FIRST_SETBACK_NS << min(count, _MOST_DOUBLINGS), _MOST_SETBACK_NS)
