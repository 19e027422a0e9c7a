"""Two servos with one id: both answer at once, so hardly an answer of that id arrives intact.

The others are clean, and it is never silent, which tells it from a bad cable and from noise. Where
both send the same bits at the same time, which at low baud rates they do in each ping, the answer
is intact; measured values differ.
"""

from dataclasses import dataclass
from math import log

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding

CERTAIN = -log(1e-9)
"""How improbable the evidence must be by chance, as for a late servo (Wald's sequential test, begun
anew wherever it falls below zero)."""
_WRECK = log(0.95 / 0.2)
_VALUES = log(0.02 / 0.75)
_SAME_BITS = log(0.5 / 0.6)
_SILENT = log(0.01 / 0.3)
"""What an answer says for two servos against anything else: a wreck; an intact answer with measured
values; an intact one without, as of a ping; none. Noise and lines that spoil more than one of five
answers are rare, and do it to all alike or lose as many; a contact that opens leaves silence."""


@dataclass(slots=True)
class _Servo:
    """Attributes: ``evidence`` since ``since``, with so many ``wrecks``; is it ``doubled``?"""

    evidence: float = 0.0
    since: int = 0
    wrecks: int = 0
    doubled: bool = False


class Duplicates:
    """Follows whose answers arrive as wrecks.

    Attributes:
        suspected: Servos whose intact answers matter, a bit for each position.
    """

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._servos = [_Servo() for _ in range(len(chain))]
        self.suspected = 0

    def wreck(self, position: int, stamp: int) -> bool:
        """A servo had its turn, and bytes came that are no answer.

        Returns:
            Whether it was so just before, too: the second of several says nothing new of the line.
        """
        servo = self._servos[position]
        if not servo.evidence:
            servo.since, servo.wrecks = stamp, 0
        servo.wrecks += 1
        servo.evidence = min(servo.evidence + _WRECK, CERTAIN)
        servo.doubled = servo.doubled or servo.evidence >= CERTAIN
        self.suspected |= 1 << position
        return servo.wrecks > 1

    def intact(self, position: int, *, values: bool) -> None:
        """A servo has answered, with measured values or with what may be the same of both."""
        if self.suspected >> position & 1:
            self._less(position, _VALUES if values else _SAME_BITS)

    def silent(self, position: int) -> None:
        """A servo had its turn, and nothing came."""
        if self.suspected >> position & 1:
            self._less(position, _SILENT)

    def _less(self, position: int, odds: float) -> None:
        servo = self._servos[position]
        servo.evidence = max(0.0, servo.evidence + odds)
        if not servo.evidence:
            servo.doubled = False
            self.suspected &= ~(1 << position)

    def findings(self) -> list[Finding]:
        """Whose id is there twice; nobody's if it is most of them, for then it is the line."""
        if not self.suspected:
            return []
        doubled = [place for place, servo in enumerate(self._servos) if servo.doubled]
        if 2 * len(doubled) > max(2, len(self._servos)):
            return []
        return [self._doubled(place) for place in doubled]

    def _doubled(self, place: int) -> Finding:
        servo = self._servos[place]
        return Finding(
            "duplicate_id",
            self._chain.servo(place),
            0.9,
            servo.since,
            f"{servo.wrecks} of its answers arrived as wrecks, hardly one intact or not at all,"
            " while others answer as they should",
            {"wrecks": servo.wrecks},
        )
