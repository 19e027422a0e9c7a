"""How far drives are from where they are going, while no command tells where that is.

One that follows a goal with a lag is as far behind it as what it shows is ahead of its own past,
smoothed with the same lag. So what stays as it is has reached its goal, and what changes has not.
Only of a steering that turns as fast as it can nothing tells how far it has yet to go, and that it
must be told.
"""

import math
from collections import deque
from collections.abc import Sequence

LAG_S = 0.08
"""Of a soft servo; see :data:`~wackel_diagnoser.drive_lags.LAGS_S`."""
SETTLING_S = 0.15
"""As in :mod:`wackel_diagnoser.reference`: what has ended still shows."""
RECENT = 16
"""Steps from which it is known where drives are going once no command tells it any more: twice the
lag."""
ROUNDED = 3.0
"""Rounding errors, below which nothing has changed."""


class Transients:
    """Follows some drives.

    Args:
        rounding: Of what each shows, standard deviations.
    """

    def __init__(self, rounding: list[float]) -> None:
        self._least = [ROUNDED * each for each in rounding]
        self._past: list[float] | None = None
        self._gaps = [0.0] * len(self._least)

    def step(
        self, shown: list[float], seconds: float, far: Sequence[float] | None = None
    ) -> list[float]:
        """A step has passed.

        Args:
            shown: What each shows; NaN if that is not known.
            seconds: Its length.
            far: How far from its goal each may be at least.

        Returns:
            How far each is from its goal, or was of late, fading.
        """
        past = self._past or shown
        share, fade = -math.expm1(-seconds / LAG_S), math.exp(-seconds / SETTLING_S)
        now = []
        for i, (is_, was) in enumerate(zip(shown, past, strict=True)):
            # The first of the two if the other is not known.
            self._gaps[i] = max(fade * self._gaps[i], abs(is_ - was) - self._least[i])
            smoothed = was + share * (is_ - was)
            now.append(smoothed if math.isfinite(smoothed) else was if math.isfinite(was) else is_)
        if far is not None:
            self._gaps = [*map(max, self._gaps, far)]
        self._past = now
        return self._gaps


class Untold:
    """Follows steering and rolling, mostly for the time in which no command is known.

    Args:
        headings: Rounding of the headings of all wheels, rad.
        speeds: Of the speeds of those that roll by themselves, m/s.
    """

    def __init__(self, headings: list[float], speeds: list[float]) -> None:
        self._roundings = headings, speeds
        self._recent: deque[tuple[list[float], list[float], list[float], float]]
        self._recent = deque(maxlen=RECENT)
        self._begin()

    def told(
        self, stands: list[float], turns: list[float], rolled: list[float], seconds: float
    ) -> None:
        """A step has passed in which a command was known; as :meth:`step`."""
        self._recent.append((stands, turns, rolled, seconds))

    def step(
        self, stands: list[float], turns: list[float], rolled: list[float], seconds: float
    ) -> tuple[list[float], list[float]]:
        """One has passed in which none was.

        Args:
            stands: Where each wheel stands, rad; NaN if that is not known.
            turns: How far it has at least yet to turn, rad.
            rolled: How each rolls, m/s; as above.
            seconds: Its length.

        Returns:
            How far each is from its goal, as :meth:`Transients.step`.
        """
        if self._recent:
            self._begin()
            for each in self._recent:
                self._step(*each)
            self._recent.clear()
        return self._step(stands, turns, rolled, seconds)

    def _begin(self) -> None:
        self._turning, self._hastening = map(Transients, self._roundings)

    def _step(
        self, stands: list[float], turns: list[float], rolled: list[float], seconds: float
    ) -> tuple[list[float], list[float]]:
        return self._turning.step(stands, seconds, turns), self._hastening.step(rolled, seconds)
