"""Motors that move nothing, since the wheel has come off its shaft.

Such a wheel rolls as all others do; only the current shows it. A motor that drives needs current
for friction, for its share of the robot's acceleration, and for what wheels push against each
other. One that turns alone needs only the first, and always the same at the same speed, while the
others work. How much that is, is learnt meanwhile.

Now and then a motor that drives happens to need just that. So each look is held against what either
foresees of it. What a motor pushes goes on from what it has pushed, by steps about as large as
those of the others: while theirs are small it tells little that one needs the same as before, and
while they are large, it tells much.
"""

import math
from operator import sub

from wackel_diagnoser.efforts import LEAST, Rolling
from wackel_diagnoser.sequential import threshold

LESS = 0.14
FRICTION = 0.1
"""Share of the friction that motors seem to have, that one alone lacks, give or take so much: what
wheels rub away on the floor is taken for friction of their motors. Of five hundred that came off
while robots drove, half lacked 0.08 to 0.18, and one in twenty 0.3 or nothing."""
LEARNT = 0.02
"""And share by which that is uncertain once it is learnt: a motor that pushes may just need as
little as an idle one, but not the same from look to look."""
NOISE = LEAST
"""A, or share of the greatest load, by which the reading of an idle motor sways. With half as much
again taken for usual, pushing motors of two robots passed for idle in some fifty hours."""
AT_MOST = 1.5
"""But it may sway by so many times that, and is still told."""
AWAKE_S = 0.3
"""The others work if they have done so for this long."""
HARDEST = 2.0
"""Squares of what they need count at most as so many times what is usual: that they had to push
hard a second ago does not mean that they have anything to do now."""
CHANGES_S = 0.12
"""Over which the others' steps are averaged: three looks. Those of a single one may be none."""
WANDERS_S = 8.0
"""In which a push becomes another even where no step is larger than readings sway. Half or twice
that does as well; with none, the push is known too well, and one more sound motor in 24 hours came
near the limit."""
INDEPENDENT = 0.5
"""Share of a look's evidence that counts: how large a motor's own steps are, the others' tell only
about."""
FOR = 1.44
AGAINST = 30.0
"""Of one look's evidence: a motor that has nothing to do now may have in a moment, but one that
pushes is not idle. With the share above, it takes 22 looks of the clearest evidence at least; 98 of
100 idle motors are told in two seconds. Of 164 robots without a fault that drove for 24 hours,
eleven gathered half of the limit, three 0.6 and none 0.7."""
WORKS = 4.0
"""How many times as much as readings sway, as squares, motors must need for it to be told that one
does not: two standard deviations, usually or to accelerate now, and the others also of late. On
even ground at an even speed they do not; and what a gently driven robot needs for that, its wheels
push each other, too."""
HASTENS = 0.1
"""And how many times that it must take to accelerate now: at an even speed wheels push each other
as they did before. Without this, four sound motors passed for idle in 24 hours."""
EVEN = 0.02
"""Of what it usually needs beyond driving, as squares, the share by which what it must take to
accelerate has changed of late, or what another needs, by more than its reading sways: while a robot
hastens evenly, its wheels push each other as before, and one that others happen to relieve of all
it should push stays so. In two hundred hours that made three motors pass for idle, all of robots
that had hastened evenly for a second or two."""
STEADY_S = 0.2
"""What has changed is off its mean over so long."""
FADES_S = 4.0
"""In which what has been gathered fades while nothing tells: it was of another motion. What has
been found stays until its motor works."""
SURPRISE = 3.0
"""Of the square of what one needs, by what is foreseen: more speaks no louder against driving, for
it speaks against idling as well."""
LONG_S = 20.0
BURST = 9.0
"""What is usual is followed over so long; what is more than so many times that counts as so much,
for a wheel that was blocked for a second does not usually push as hard."""
MOST = 1.5
"""Evidence by what is needed, beyond which no more is gathered, so that it can heal."""
_SWAYING, _MOST_SWAYING = NOISE**2, (AT_MOST * NOISE) ** 2  # as variances; worked out once


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
        self._gathered = [0.0] * count
        # What each needs by its speed beyond the friction of all, A s/m, if it is idle; and with
        # what variance that is known.
        self._own = [(0.0, 0.0)] * count
        self._awake = [0.0] * count
        # What each pushes if it drives, A, and with what variance that is known; what it needed at
        # the last look beyond driving, A; and squares of its steps of late, by what is usual.
        self._pushes = [(0.0, math.inf)] * count
        self._rest: list[float] | None = None
        self._steps = [0.0] * count
        # What each has needed of late, and what of it for inertia, A.
        self._needed, self._hastened = [0.0] * count, [0.0] * count
        self._before: tuple[list[float], list[float]] | None = None
        self._usual: list[float] | None = None

    def step(
        self,
        seconds: float,
        speeds: list[float],
        turning: list[float],
        rolling: Rolling,
        *,
        faulty: list[bool],
    ) -> None:
        """Looks once.

        Args:
            seconds: Since the last look.
            speeds: At which each should roll, m/s.
            turning: How much of that is for the robot's turning, m/s.
            rolling: The motors. What is usual is taken over at the first look; later ones follow it
                on their own.
            faulty: At which wheels something is known to be wrong. All others fight that, with far
                more than they usually need, and all at once no longer; so they are not watched
                meanwhile, and nothing is learnt. Of two, one that idles has both slip.
        """
        before, self._before = self._before, (speeds, turning)
        if before is None or len(speeds) < 2:
            return
        # Single numbers: for some motors, Python is faster with them than numpy.
        current, needs, usual = rolling
        friction, mass, more = needs.friction, needs.mass / seconds, needs.turning / seconds
        inertias = [
            mass * (now - then) + more * (turns - did)
            for now, then, turns, did in zip(speeds, before[0], turning, before[1], strict=True)
        ]
        alone = [a - friction * now for a, now in zip(current, speeds, strict=True)]
        rest = [*map(sub, alone, inertias)]
        means = self._usual or usual
        if not math.isfinite(sum(rest) + sum(means)):
            return
        faults = sum(faulty)
        if not faults:
            means = self._follow(means, rest, seconds)
        self._usual = means
        means = [max(mean, _SWAYING) for mean in means]
        share, last, self._rest = min(1.0, seconds / CHANGES_S), self._rest or rest, rest
        steps = self._steps = [
            each + share * ((now - then) ** 2 / mean - each)
            for each, now, then, mean in zip(self._steps, rest, last, means, strict=True)
        ]
        total, others = sum(steps), len(steps) - 1
        share = min(1.0, seconds / AWAKE_S)
        awake = self._awake = [
            each + share * (min(amperes * amperes / mean, HARDEST) - each)
            for each, amperes, mean in zip(self._awake, alone, means, strict=True)
        ]
        steady = min(1.0, seconds / STEADY_S)
        hastened = _changes(self._hastened, inertias, steady)
        changes = _changes(self._needed, alone, steady)
        # The laziest of the others says how much there is to do.
        lowest, second = sorted(awake)[:2]
        most_changed, less_changed = sorted(changes)[:-3:-1]
        most, unsure, fades = MOST * self._limit, needs.unsure**2, min(seconds / FADES_S, 1.0)
        wanders = 2.0 * seconds / WANDERS_S
        for i, (mean, gathered) in enumerate(zip(means, self._gathered, strict=True)):
            # Readings alone differ by twice their variance from look to look.
            stepped = max((total - steps[i]) / others * mean - 2.0 * _SWAYING, 0.0)
            drives = self._follow_push(i, rest[i], mean, stepped + wanders * mean)
            if faults > faulty[i] and not (faulty[i] and others == 1):  # at another wheel
                continue
            square, inertia = speeds[i] * speeds[i], inertias[i] * inertias[i]
            # Friction that is known badly may look like idling; that it is tells nothing.
            rough = _MOST_SWAYING + unsure * square
            tells = inertia >= HASTENS * rough and max(mean, inertia) >= WORKS * rough
            if tells and hastened[i] < EVEN * mean:  # only if others' needs are new
                changed = most_changed if changes[i] < most_changed else less_changed
                tells = changed >= max(EVEN * mean, WORKS * _SWAYING)
            tells = tells and mean * (lowest if awake[i] > lowest else second) >= WORKS * _SWAYING
            if not (tells or gathered):
                continue
            if not gathered:
                own, known = self._own[i] = -LESS * friction, (FRICTION * friction) ** 2
                off, variance = alone[i] - own * speeds[i], _SWAYING + known * square
                if math.log(variance) + off * off / variance > drives:  # as mostly: they push
                    continue
            idle = self._follow_own(i, alone[i], speeds[i], LEARNT * friction)
            told = INDEPENDENT * min(max(0.5 * (drives - idle), -AGAINST), FOR if tells else 0.0)
            kept = gathered if tells or self.found[i] else gathered * (1.0 - fades)
            self._gathered[i] = min(max(kept + told, 0.0), most)
        self.found = [
            gathered > (0.5 if known else 1.0) * self._limit
            for gathered, known in zip(self._gathered, self.found, strict=True)
        ]

    def _follow_push(self, motor: int, rest: float, usual: float, stepped: float) -> float:
        """Follows what a motor pushes if it drives: a Kalman filter of a random walk.

        Args:
            motor: Its number.
            rest: What it needs beyond friction and acceleration, A.
            usual: Mean square of that, A². No push is known worse, nor mostly larger.
            stepped: Variance of its step since the last look, A².

        Returns:
            Twice the negative logarithm of how likely that was, up to a constant.
        """
        push, unsure = self._pushes[motor]
        unsure = min(unsure + stepped, usual)
        off, variance = rest - push, unsure + _SWAYING
        share = unsure / variance
        self._pushes[motor] = push + share * off, share * _SWAYING
        odd = max(off * off / variance, rest * rest / (usual + variance))
        return math.log(variance) + min(odd, SURPRISE)

    def _follow_own(self, motor: int, alone: float, speed: float, steady: float) -> float:
        """Learns what a motor needs by its speed if it is idle: a Kalman filter of that one number.

        Args:
            motor: Its number.
            alone: What it needs beyond the friction of all, A.
            speed: At which it should roll, m/s.
            steady: Standard deviation with which that stays the same, A s/m.

        Returns:
            Twice the negative logarithm of how likely that was, up to a constant.
        """
        own, unsure = self._own[motor]
        off, variance = alone - own * speed, _SWAYING + unsure * speed * speed
        self._own[motor] = (
            own + unsure * speed / variance * off,
            max(unsure * _SWAYING / variance, steady * steady),
        )
        return math.log(variance) + off * off / variance

    def _follow(self, usual: list[float], rest: list[float], seconds: float) -> list[float]:
        """What is usual, from what motors need now; that of one without a wheel stays."""
        share = min(1.0, seconds / LONG_S)
        return [
            mean if found else mean + share * (min(left * left, BURST * max(mean, _SWAYING)) - mean)
            for mean, left, found in zip(usual, rest, self.found, strict=True)
        ]


def _changes(means: list[float], now: list[float], share: float) -> list[float]:
    """How far each is off its mean of late, as squares; the means follow by that share."""
    squares = []
    for i, each in enumerate(now):
        change = each - means[i]
        means[i] += share * change
        squares.append(change * change)
    return squares
