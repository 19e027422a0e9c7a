"""Which wheels stand though they are told to roll, and which roll as they are told."""

import math
from collections.abc import Sequence

from wackel_diagnoser.history import DRIVING_M_S, STANDING

STANDS_S = 0.5
"""For how long a wheel must have stood while another rolled to be faulty: motors need a tenth of
that to follow. Where all stand, one may hold all others, or the robot may have been stopped."""
JAMMED_S = 0.03
"""For how long it has stood altogether to be one that sticks; with play and lag, one that turns
round stands for a step."""
FOLLOWS = 0.25
"""Share of its speed by which a wheel that does what it is told may be off on average: a motor that
pulls against a blocked wheel as hard as the tyre grips loses so much at half speed."""
FOLLOWING_S = 0.5
"""Over which that is averaged: longer than a reference leads or lags when the command changes."""


def stand(
    told: Sequence[float], rolled: Sequence[float], present: Sequence[bool]
) -> dict[int, bool]:
    """Which of the wheels that are told to roll stand now; see :meth:`Standing.step`."""
    return {
        roll: abs(does) < STANDING * abs(should)
        for roll, (should, does, known) in enumerate(zip(told, rolled, present, strict=True))
        if known and abs(should) > DRIVING_M_S
    }


class Standing:
    """Follows each driven wheel while something is suspected.

    Args:
        rolls: How many roll rows there are.
    """

    def __init__(self, rolls: int) -> None:
        self._stood_s = [0.0] * rolls
        self._altogether_s = [0.0] * rolls
        self._off = [0.0] * rolls
        self._told = [0.0] * rolls

    def begin(self) -> None:
        """Nothing is known."""
        for values in (self._stood_s, self._altogether_s, self._off, self._told):
            values[:] = [0.0] * len(values)

    def step(
        self,
        told: Sequence[float],
        rolled: Sequence[float],
        seconds: float,
        present: Sequence[bool],
    ) -> None:
        """Takes in a step of all of them.

        Args:
            told: What each wheel should do, m/s; NaN if that is not known.
            rolled: What it does, m/s.
            seconds: For how long.
            present: Whether its sensor was heard.
        """
        fade = math.exp(-seconds / FOLLOWING_S)
        driven = stand(told, rolled, present)
        for roll in driven:
            should = told[roll]
            self._off[roll] = fade * self._off[roll] + abs(rolled[roll] - should)
            self._told[roll] = fade * self._told[roll] + abs(should)
        moves = not all(driven.values())
        for roll, stands in driven.items():
            if not stands:
                self._stood_s[roll] = 0.0
            elif moves:
                self._stood_s[roll] += seconds
                self._altogether_s[roll] += seconds
        if not driven and not any(abs(should) > DRIVING_M_S for should in told):
            # How a wheel came to rest says nothing of how it leaves it.
            self._stood_s = [0.0] * len(self._stood_s)

    def rows(self) -> list[int]:
        """Those that stand while others roll."""
        return [roll for roll, seconds in enumerate(self._stood_s) if seconds >= STANDS_S]

    def stood(self, roll: int) -> bool:
        """Whether a wheel has stood since the beginning, though it may roll now."""
        return self._altogether_s[roll] >= JAMMED_S

    def follows(self, roll: int) -> bool:
        """Whether a wheel rolls as it is told."""
        return self._off[roll] < FOLLOWS * self._told[roll]
