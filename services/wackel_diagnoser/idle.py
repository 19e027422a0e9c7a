"""Motors that move nothing, since the wheel has come off its shaft.

Such a wheel rolls as all others do; only the current shows it. A motor that drives needs current
for friction, for its share of the robot's acceleration, and for what wheels push against each
other. One that turns alone needs only the first, while the others work, whether the robot hastens
or slows down.
"""

import math

from wackel_diagnoser.efforts import LEAST, Rolling
from wackel_diagnoser.sequential import threshold

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
"""How many times the noise, as squares, motors must need for it to be told that one does not: three
standard deviations, usually or to accelerate now. On even ground at an even speed they do not."""
LONG_S = 20.0
BURST = 9.0
"""What is usual is followed over so long; what is more than so many times that counts as so much,
for a wheel that was blocked for a second does not usually push as hard."""
ONE_WAY = 0.75
"""Of the limit, that slowing down may bring, or hastening; the other has to confirm it. What wheels
push each other may just be what one of them needs, for as long as the robot slows down. No more is
gathered, so that it can heal."""
_SWAYING = NOISE**2  # as a variance; worked out once


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
        # Evidence from slowing down, and from hastening.
        self._gathered = [[0.0, 0.0] for _ in range(count)]
        self._awake = [0.0] * count
        self._before: tuple[list[float], list[float]] | None = None
        self._usual: list[float] | None = None

    def step(
        self, seconds: float, speeds: list[float], turning: list[float], rolling: Rolling
    ) -> None:
        """Looks once.

        Args:
            seconds: Since the last look.
            speeds: At which each should roll, m/s.
            turning: How much of that is for the robot's turning, m/s.
            rolling: The motors. What is usual is taken over at the first look; later ones follow it
                on their own.
        """
        before, self._before = self._before, (speeds, turning)
        if before is None or len(speeds) < 2:
            return
        # Single numbers: for some motors, Python is faster with them than numpy.
        current, needs, usual = rolling
        frictions = [needs.friction * now for now in speeds]
        mass, more = needs.mass / seconds, needs.turning / seconds
        inertias = [
            mass * (now - then) + more * (turns - did)
            for now, then, turns, did in zip(speeds, before[0], turning, before[1], strict=True)
        ]
        alone = [a - friction for a, friction in zip(current, frictions, strict=True)]
        rest = [a - inertia for a, inertia in zip(alone, inertias, strict=True)]
        means = self._usual or usual
        if not math.isfinite(sum(alone) + sum(rest) + sum(means)):
            return
        self._usual = means = self._follow(means, rest, seconds)
        share, awake = min(1.0, seconds / AWAKE_S), self._awake
        for i, (amperes, mean) in enumerate(zip(alone, means, strict=True)):
            awake[i] += (amperes * amperes / max(mean, _SWAYING) - awake[i]) * share
        # The laziest of the others says how much there is to do.
        lowest, second = sorted(awake)[:2]
        most = ONE_WAY * self._limit
        sways, unsure = (FRICTION * needs.friction) ** 2, needs.unsure**2
        for i, mean in enumerate(means):
            works = mean * min(lowest if awake[i] > lowest else second, 1.0)
            square = speeds[i] * speeds[i]
            idle = _SWAYING + sways * square
            told = _told(alone[i], rest[i], idle, works)
            if told > 0.0:
                # Friction that is known badly may look like idling, but excuses nothing.
                doubt = unsure * square
                told = min(told, _told(alone[i], rest[i], idle + doubt, works))
                # At an even speed wheels push each other as they did before: nothing new.
                noise, inertia = _SWAYING + doubt, inertias[i] * inertias[i]
                if not (max(mean, inertia) >= WORKS * noise and inertia >= noise):
                    told = 0.0
            told = INDEPENDENT * min(max(0.5 * told, -AGAINST), FOR)
            gathered, hastens = self._gathered[i], inertias[i] * speeds[i] > 0.0
            if told > 0.0:
                gathered[hastens] = min(gathered[hastens] + told, most)
            elif total := sum(gathered):
                kept = max(1.0 + told / total, 0.0)
                gathered[:] = [kept * each for each in gathered]
        self.found = [
            sum(gathered) > (0.5 if known else 1.0) * self._limit
            for gathered, known in zip(self._gathered, self.found, strict=True)
        ]

    def _follow(self, usual: list[float], rest: list[float], seconds: float) -> list[float]:
        """What is usual, from what motors need now; that of one without a wheel stays."""
        share = min(1.0, seconds / LONG_S)
        return [
            mean if found else mean + share * (min(left * left, BURST * max(mean, _SWAYING)) - mean)
            for mean, left, found in zip(usual, rest, self.found, strict=True)
        ]


def _told(alone: float, rest: float, idle: float, works: float) -> float:
    """Twice the logarithm of how much likelier it is that a motor idles than that it drives.

    Args:
        alone: What it needs beyond friction, A.
        rest: And beyond its share of the acceleration.
        idle: Variance of the first if it idles.
        works: And by which that of the second is larger if it drives.
    """
    driving = idle + works
    return math.log(driving / idle) + rest * rest / driving - alone * alone / idle
