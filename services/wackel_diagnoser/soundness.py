"""When a part that was named is sound again: not when nothing shows, but when what it showed would.

A wheel that turns a tenth too slow looks sound while it hardly turns, and a steering that stands
three degrees off while its reference leads by ten. So it is kept by how much the part missed its
reference while it was seen to be faulty, and each step is asked whether it still does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wackel_diagnoser.hypotheses import Hypotheses
from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import MOVING_M_S, Measured, Rows
from wackel_diagnoser.sequential import BOUND, INDEPENDENT
from wackel_drive.alignment import Step

CONTRARY = 0.5
"""Evidence of one step that speaks for the fault."""
SETS_BACK_S = 0.1
"""By how much, for each unit of that. What lasts has undone a second within a few steps; a single
one, as on a busy computer whose stamps are late, takes back some tenths."""
TRAVELLED_RAD = 0.1
"""How far a steering must have been told to turn meanwhile, or have turned since the verdict: one
that is blocked looks sound until then."""
CLEAR = 6.0
"""Logarithm of how much likelier it must be that the part follows its reference than that it misses
it as it did (400 to 1); and before, that it missed it at all. Where that was not clear, time alone
decides."""


@dataclass
class _Part:
    """One that is named, of a wheel.

    Attributes:
        steers: Whether it is a steering.
        wheel: Which.
        roll: Its roll row among those; -1: it has none.
        row: Of its miss of the reference; -1: it has none.
        asked: Square of what the reference asked while the part was seen to be faulty, by variance.
        missed: The same by what the part was off.
        follows: Evidence since then that it is not.
    """

    steers: bool
    wheel: int
    roll: int
    row: int
    asked: float = 0.0
    missed: float = 0.0
    follows: float = 0.0


class Soundness:
    """Follows parts that are named.

    Args:
        hypotheses: Which rows a part spoils.
        rows: How measurements are numbered.
        components: The parts.
        step, target: From when on they are.
        earlier: Those that were named before, with what has followed each alone: by how much it
            missed its reference is known.
    """

    def __init__(
        self,
        hypotheses: Hypotheses,
        rows: Rows,
        components: Sequence[str],
        *,
        step: Step,
        target: Target,
        earlier: Mapping[str, "Soundness"],
    ) -> None:
        self._parts: dict[str, _Part] = {}
        for path in components:
            place = hypotheses.place(path)
            if place is None:
                continue
            part, wheel = place
            steers = part == "steering"
            kind = rows.steering if steers else rows.rolling
            own = hypotheses.own_rows(path)[kind].nonzero()[0].tolist()
            row = kind.start + own[0] if own else -1
            self._parts[path] = _Part(steers, wheel, rows.roll_of(wheel), row)
            if path in earlier:
                was = earlier[path]._parts[path]
                self._parts[path].asked, self._parts[path].missed = was.asked, was.missed
        self._seconds = self._travelled = 0.0
        self._heading_then, self._told_before = step.heading, target.heading

    def step(self, step: Step, target: Target, measured: Measured, evidence: float) -> None:
        """Takes in a step.

        Args:
            step: What the sensors said.
            target: What the wheels should have done.
            measured: The rows of that.
            evidence: For their faults, logarithm.
        """
        before, self._told_before = self._told_before, target.heading
        contrary, shows, variance = evidence > CONTRARY, True, measured.spread().variance
        for part in self._parts.values():
            told = target.speed[part.roll] if part.roll >= 0 else 0.0
            shows &= part.roll < 0 or abs(told) > MOVING_M_S
            if part.steers:
                turned = abs(target.heading[part.wheel] - before[part.wheel])
                # Half turns are the same direction.
                self._travelled += turned if turned < 1.0 else 0.0
                moved = abs(step.heading[part.wheel] - self._heading_then[part.wheel])
                shows &= max(self._travelled, moved) > TRAVELLED_RAD
            if part.row >= 0 and measured.present[part.row]:
                off, known = float(measured.z[part.row]), float(variance[part.row])
                asked = 1.0 if part.steers else told
                _weigh(part, asked, off, known, evidence if contrary else 0.0)
        if contrary:
            self._seconds = max(0.0, self._seconds - SETS_BACK_S * evidence)
            if not self._seconds:
                self._travelled = 0.0
        elif shows:
            self._seconds += step.seconds

    def lasts(self, seconds: float) -> bool:
        """Whether all of them have shown themselves sound for so long."""
        return self._seconds >= seconds and all(
            part.follows >= CLEAR
            for part in self._parts.values()
            if 0.5 * part.missed * part.missed >= CLEAR * part.asked > 0.0
        )


def _weigh(part: _Part, asked: float, off: float, variance: float, contrary: float) -> None:
    """What a miss says of a part, in a step that speaks for its fault by so much, or not: 0."""
    if contrary:
        part.asked += INDEPENDENT * asked * asked / variance
        part.missed += INDEPENDENT * asked * off / variance
        part.follows = max(0.0, part.follows - contrary)
    elif part.asked > 0.0:
        miss = off - asked * part.missed / part.asked
        told = 0.5 * INDEPENDENT * (miss * miss - off * off) / variance
        part.follows = max(0.0, part.follows + min(max(told, -BOUND), BOUND))
