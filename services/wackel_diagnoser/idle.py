"""Motors that move nothing, since the wheel has come off its shaft.

Such a wheel rolls as all others do; only the current shows it. A motor that drives needs current
for friction, for its share of the robot's acceleration, and for what wheels push against each
other. One that turns alone needs only the first, while the others work.
"""

import math

import numpy as np

from wackel_diagnoser.efforts import LEAST
from wackel_diagnoser.sequential import threshold
from wackel_kinematics.array import Floats

FRICTION = 0.1
"""Share by which the friction of a motor differs from that of the others."""
NOISE = 1.5 * LEAST
"""A, or share of the greatest load, by which the reading of an idle motor sways."""
AWAKE_S = 0.3
"""The others work if they have done so for this long."""
INDEPENDENT = 0.25
"""Share of a look that is new: of 25 a second, since forces last for a sixth of a second."""
FOR = 2.5
AGAINST = 30.0
"""Of one look's evidence: a motor that has nothing to do now may have in a moment, but one that
pushes is not idle."""
WORKS = 9.0
"""How many times the noise, as squares, motors must usually need for it to be told that one does
not: three standard deviations. On even ground at an even speed they do not."""
LONG_S = 20.0
BURST = 9.0
"""What is usual is followed over so long; what is more than so many times that counts as so much,
for a wheel that was blocked for a second does not usually push as hard."""
MOST = 1.5
"""Evidence by what is needed, beyond which no more is gathered, so that it can heal."""


class IdleMotors:
    """Looks for them among the rolling motors.

    Args:
        count: Rolling motors.
        rate: Looks a second.

    Attributes:
        found: Which have been found.
    """

    def __init__(self, count: int, rate: float) -> None:
        self.found = [False] * count
        self._limit = threshold(count, rate)
        self._sums = np.zeros(count)
        self._awake = np.zeros(count)
        self._before: Floats | None = None
        self._usual: Floats | None = None

    def step(
        self, seconds: float, speed: Floats, current: Floats, needs: Floats, usual: Floats
    ) -> None:
        """Looks once.

        Args:
            seconds: Since the last look.
            speed: At which each should roll, m/s.
            current: Of each motor, A or share of load; NaN if unknown.
            needs: What friction needs by speed, and mass by acceleration.
            usual: Mean square of what each needs beyond that, as known before the first look; later
                ones follow it on their own.
        """
        before, self._before = self._before, speed
        if before is None or len(speed) < 2:
            return
        friction, inertia = needs[0] * speed, needs[1] * (speed - before) / seconds
        alone, rest = current - friction, current - friction - inertia
        if not math.isfinite(float(alone.sum() + rest.sum() + usual.sum())):
            return
        usual = self._usual = self._follow(
            usual if self._usual is None else self._usual, rest, seconds
        )
        active = alone * alone / np.maximum(usual, NOISE**2)
        self._awake += (active - self._awake) * min(1.0, seconds / AWAKE_S)
        # The laziest of the others says how much there is to do.
        lowest, second = np.sort(self._awake)[:2]
        others = np.minimum(np.where(self._awake > lowest, lowest, second), 1.0)
        idle = NOISE**2 + (FRICTION * friction) ** 2
        driving = idle + usual * others
        told = np.log(driving / idle) + rest * rest / driving - alone * alone / idle
        # At an even speed wheels push each other as they did before: nothing new.
        quiet = (usual < WORKS * NOISE**2) | (np.abs(inertia) < NOISE)
        told[quiet & (told > 0.0)] = 0.0
        self._sums += INDEPENDENT * np.clip(0.5 * told, -AGAINST, FOR)
        np.clip(self._sums, 0.0, MOST * self._limit, out=self._sums)
        self.found = [
            bool(total > (0.5 if known else 1.0) * self._limit)
            for total, known in zip(self._sums.tolist(), self.found, strict=True)
        ]

    def _follow(self, usual: Floats, rest: Floats, seconds: float) -> Floats:
        """What is usual, from what motors need now; that of one without a wheel stays."""
        seen = np.minimum(rest * rest, BURST * np.maximum(usual, NOISE**2))
        share = min(1.0, seconds / LONG_S)
        return np.where(self.found, usual, usual + share * (seen - usual))
