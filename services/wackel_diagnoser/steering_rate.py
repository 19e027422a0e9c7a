"""How fast the steering can turn: whatever is wrong, as one has turned, so it can.

A step may have taken longer than its stamps say; all then seem to turn faster. So what counts is
how far one turned while it turned faster than is known yet, less an encoder's step, by the longest
that may have taken. That is never too much where stamps are late by less than half a step (and by
two hundredths if by more, which looks like a step that was lost): references that are ahead of what
steerings can would make all of them seem slow, in every turn.
"""

LEAST = 2.0
"""rad/s that every steering reaches; how much faster this one is, driving shows."""
MOST = 20.0
"""rad/s, that no servo reaches."""
LONG_S = 0.015
"""A turn must last longer: at least two steps, as a reading that jumps lasts one."""
JUMPS = 1.5
"""By how much further or less far than the one before a step goes that shows no turn."""
MEMORY_S = 3600.0
"""Servos become slower by a tenth while a battery runs down, within an hour."""
EVENS = 0.02
"""Share of a step in the mean of its length."""
MISSING = 0.5
"""Share of a step by which one that is longer is several, between which readings were lost."""
UNEVEN_S = 10.0
"""For how long a stamp counts as late, unless shorter steps make up for it, and says that others
may be as late."""


class SteeringRate:
    """Learns it.

    Args:
        wheels: How many there are.
        encoder_step: Of steerings, rad.

    Attributes:
        now: As learnt, rad/s.
    """

    def __init__(self, wheels: int, encoder_step: float) -> None:
        self.now = LEAST
        self._encoder_step = encoder_step
        self._before = [0.0] * wheels, 1.0  # rad, s
        self._steps = 0
        # How long a step is; by how much its last stamp is late, and others may be.
        self._usual_s = self._late_s = self._unsure_s = 0.0
        self._turning = [(0.0, 0.0)] * wheels  # how far, rad, and how long each turns fast, s
        self._one_is_fast = False

    def step(self, turned: list[float], seconds: float) -> None:
        """Takes in a step.

        Args:
            turned: By how much each wheel was steered, rad; NaN if unknown.
            seconds: How long it took.
        """
        self._steps += 1
        usual = self._usual_s or seconds
        off = seconds - usual
        if off > MISSING * usual and self._steps * EVENS > 1.0:
            off -= usual * round(off / usual)
        self._usual_s = usual + max(EVENS, 1.0 / self._steps) * off
        kept = max(1.0 - seconds / UNEVEN_S, 0.0)
        self._late_s = max(kept * self._late_s + off, 0.0)
        self._unsure_s = max(abs(off), self._late_s, kept * self._unsure_s)
        self.now = max(LEAST, self.now - seconds / MEMORY_S * self.now)
        most = self.now * seconds
        before, self._before = self._before, (turned, seconds)
        # Not so if the first is not known.
        if max(turned) <= most and min(turned) >= -most and not self._one_is_fast:
            return
        for i, (now, then) in enumerate(zip(turned, before[0], strict=True)):
            angle, took = self._turning[i]
            if not took and abs(then) > self.now * before[1]:
                angle, took = abs(then), before[1]
            angle, took = angle + abs(now), took + seconds
            alike = now * then > 0.0 and max(now / then, then / now) <= JUMPS  # not if unknown
            if not alike or angle <= self.now * took:
                self._turning[i] = 0.0, 0.0
                continue
            self._turning[i] = angle, took
            rate = (angle - self._encoder_step) / (took + self._unsure_s)
            if took > LONG_S and self.now < rate <= MOST:
                self.now = rate
        self._one_is_fast = any(took for _, took in self._turning)
