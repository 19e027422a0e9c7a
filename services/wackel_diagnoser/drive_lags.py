"""How quickly drives follow what they are told, learnt from how they do.

Nobody states it. So several lags are tried side by side, for steering and for rolling; the one that
the measurements follow best is used, refined by how well its neighbours do. What is learnt changes
within seconds: steps are gathered, and what is tried moves by all of them when there is something
to learn.
"""

import math

import numpy as np

from wackel_kinematics.array import Floats

LAGS_S = np.array([0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.05, 0.065, 0.08, 0.1, 0.12, 0.16, 0.2])
"""That are tried: from a stiff servo to a heavy wheel in a soft loop."""
FIRST = 6
"""Number of the one that is taken first."""
MEMORY_S = 10.0
"""Of what tells, in which the lag is learnt."""
CHOOSE_S = 0.5
"""Of that from choice to choice: a single change of speed, in which drives wait for their steering,
does not decide."""
CLEARER = 0.7
"""Of the squares that the present lag misses, what another must miss at most. Lags that miss alike
will do alike."""
SLOWED = 0.35
"""The same of what was missed while wheels slowed each other, for a longer lag of rolling: that is
no lag of theirs."""
UNEVEN_M_S = 0.01
"""By how much a speed may be wrong because its step took another time than its stamps say, until
that halves what it teaches: it would hide what lags miss, which is hardly more."""
MOST_WAITING = 32
"""Steps: twice as many as from one that can teach to the next."""


class DriveLags:
    """Learns the lags of steering and of rolling.

    Args:
        wheels: How many there are; what is tried are their headings, and then speeds of roll rows.
        rolls: How many of those.

    Attributes:
        used_s: Lags of steering and of rolling, as learnt.
        learnt: Whether they are; else they are what learning begins with.
    """

    def __init__(self, wheels: int, rolls: int) -> None:
        self._parts = slice(wheels), slice(wheels, None)
        self.used_s = [float(LAGS_S[FIRST])] * 2
        self._chosen = [FIRST, FIRST]
        # A column for each lag that is tried.
        self._state = np.zeros((wheels + rolls, len(LAGS_S)))
        self._turns = np.repeat((1.0, math.inf), (wheels, rolls))[:, None]  # only steerings do
        self._waiting: list[tuple[list[float], float, float]] = []
        # Which of the state are headings, which speeds.
        self._kinds = np.repeat(np.eye(2), (wheels, rolls), axis=1)
        # Of steering and of rolling; and of the latter those while wheels slowed each other.
        self._misses = np.zeros((2, len(LAGS_S)))
        self._slowed = np.zeros(len(LAGS_S))
        self._since_choice = 0.0
        self._told_s = [0.0, 0.0]  # of driving that told of each
        self.learnt = [False, False]
        self._uneven = 0.0  # of the last step, as a share

    def begin(self, state: list[float]) -> None:
        """All drives are here, rad and m/s, shape (wheels + rolls,)."""
        self._state.T[:] = state
        self._waiting.clear()

    def turn_faster(self, heading: list[float]) -> None:
        """Steerings turn faster than was known. All that is tried has fallen behind, the shortest
        lag the least; it begins anew where the wheels are.

        Args:
            heading: Of them, as the state, before the next step; NaN if not known.
        """
        if self._waiting:
            self._move()
        headings, _ = self._parts
        tried = self._state[headings]
        shown = np.array(heading)[:, None]
        np.copyto(tried, shown, where=np.isfinite(shown))
        self._misses[0] = self._told_s[0] = self._since_choice = 0.0
        self.learnt[0] = False

    def follow(self, goal: list[float], seconds: float, most: float, off_s: float) -> None:
        """A step has passed.

        Args:
            goal: What drives were told, rad and m/s, shape (wheels + rolls,).
            seconds: How long it took.
            most: By how much a steering can turn meanwhile, rad.
            off_s: By how much the step is longer than most, as far as its stamps may be wrong.
        """
        if len(self._waiting) >= MOST_WAITING:
            self._move()
        self._waiting.append((goal, seconds, most))
        self._uneven = off_s / seconds

    def learn(
        self, shown: list[float], learnt_s: float, tells: tuple[bool, bool], *, slowed: bool
    ) -> None:
        """Learns from the last step that was followed.

        Args:
            shown: Where drives were in the middle of it, as the state; NaN if not known: the others
                teach.
            learnt_s: For how much driving without a fault it stands.
            tells: Whether steerings tell of their lag, and drives: what misses are of one that has
                arrived is how its encoder rounds.
            slowed: Whether wheels slow each other.
        """
        values, middle = np.array(shown)[:, None], self._move()
        known = np.isfinite(values)
        off = np.where(known, values - middle, 0.0)
        squares = np.minimum(off * off, 0.01)
        _, rolls = self._parts
        uneven = self._uneven / UNEVEN_M_S * np.where(known[rolls], values[rolls], 0.0)
        squares[rolls] /= 1.0 + uneven * uneven
        fade = 1.0 - learnt_s / MEMORY_S
        added = self._kinds @ squares
        for kind, told in enumerate(tells):
            if told and (teaches := added[kind]).any():
                self._misses[kind] *= fade
                self._misses[kind] += teaches
                self._told_s[kind] += learnt_s
        if tells[1]:
            self._slowed *= fade
            if slowed:
                self._slowed += added[1]
        self._since_choice += learnt_s

    def choose(self, state: list[float]) -> list[float]:
        """Takes the lags that are followed as those of the drives, when it is time.

        Args:
            state: Where drives are with the lags that are used.

        Returns:
            The same with those that are used from now on.
        """
        if self._since_choice < CHOOSE_S:
            return state
        self._since_choice = 0.0
        chosen = self._followed()
        for kind, (part, now, before) in enumerate(
            zip(self._parts, chosen, self._chosen, strict=True)
        ):
            if now != before:
                state[part] = self._state[part, now].tolist()
            misses = self._misses[kind] - self._slowed if kind else self._misses[kind]
            self.used_s[kind] = _refined(misses, now)
            self.learnt[kind] = self._told_s[kind] >= CHOOSE_S
        self._chosen = chosen
        return state

    def _move(self) -> Floats:
        """Moves what is tried by the steps that wait.

        Returns:
            Where it was on average in the last of them, shape (wheels + rolls, lags).
        """
        goals, seconds, most = map(np.array, zip(*self._waiting, strict=True))
        self._waiting.clear()
        # All of one shape: numpy takes four times as long to repeat one for several.
        shape = (len(seconds), *self._state.shape)
        each = np.empty((4, *shape))
        each[0] = goals[..., None]
        each[1] = np.expm1(-seconds[:, None] / LAGS_S)[:, None]
        np.multiply(most[:, None, None], self._turns, out=each[3])
        np.negative(each[3], out=each[2])
        state = self._state
        for goal, share, least, limit in zip(*each, strict=True):
            moved = state - goal
            moved *= share
            np.minimum(moved, limit, out=moved)
            np.maximum(moved, least, out=moved)
            state += moved
        middle = goal - LAGS_S / seconds[-1] * moved
        # One that turns as fast as it can is half way in the middle of a step.
        np.copyto(middle, self._state - 0.5 * moved, where=np.abs(moved) >= limit)
        return np.asarray(middle)

    def _followed(self) -> list[int]:
        """Lags of steering and rolling: others than now only where they are clearly followed."""
        best = self._misses.argmin(axis=1).tolist()
        _, rolling = self._chosen
        slowed = float(self._slowed[rolling]) if best[1] > rolling else 0.0
        return [
            lag if misses[lag] < CLEARER * misses[now] - less else now
            for lag, now, misses, less in zip(
                best,
                self._chosen,
                self._misses.tolist(),
                (0.0, (CLEARER - SLOWED) * slowed),
                strict=True,
            )
        ]


def _refined(misses: Floats, at: int) -> float:
    """Lag where a parabola through the misses of one that is tried and its neighbours is lowest, s;
    no further off than half way to them."""
    if not 0 < at < len(LAGS_S) - 1:
        return float(LAGS_S[at])
    left, here, right = LAGS_S[at - 1 : at + 2].tolist()
    before, now, after = misses[at - 1 : at + 2].tolist()
    falls, rises = (now - before) / (here - left), (after - now) / (right - here)
    first, last = 0.5 * (left + here), 0.5 * (here + right)
    if not rises > falls:
        return float(here)
    lowest = first - falls * (last - first) / (rises - falls)
    return float(min(max(lowest, first), last))
