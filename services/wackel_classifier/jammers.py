"""Something that writes on the bus without being asked: rhythmic and permanent jammers.

Source: thesis, 2.5.4 to 2.6. A permanent jammer fills every pause until the host stops listening;
a rhythmic one puts a single zero between packets, and masks a permanent one.
"""

from wackel_classifier.findings import Finding
from wackel_classifier.symptoms import PAUSE_BYTES, PAUSE_FILLED, Outcome, Symptoms
from wackel_schemas import component

BEATS = 4
"""Packets with exactly one zero before them, in a row. A sparking contact throws a single zero now
and then, hardly four times in a row at the right place."""
LOOSE_CONTACT_BYTES = 100
"""A loose contact never reached as many foreign bytes (thesis, 2.5.2: mean 39, deviation 12)."""
QUIET_TRANSACTIONS = 20
"""Answered requests in a row without a sign of the jammer after which it is gone."""


class Jammers:
    """Collects the signs of both kinds."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._beats = 0
        self._foreign = 0
        self._since = 0
        self._quiet = 0
        self.rhythmic: Finding | None = None
        self.permanent: Finding | None = None

    def findings(self) -> list[Finding]:
        """The jammer that is there."""
        return [finding for finding in (self.rhythmic, self.permanent) if finding]

    @property
    def suspicious(self) -> bool:
        """Whether the next transactions matter even if they are clean."""
        return bool(self._beats or self._foreign or self.rhythmic or self.permanent)

    def clean(self) -> None:
        """A request was answered as it should be."""
        if self.suspicious:
            self._be_quiet()

    def step(self, symptoms: Symptoms, stamp: int) -> None:
        """Takes in a transaction that was not clean."""
        foreign = symptoms.zeros + symptoms.stray + symptoms.broken
        saturated = (
            symptoms.filled >= PAUSE_FILLED
            and foreign >= PAUSE_BYTES
            and foreign > symptoms.zeros
            and not symptoms.rhythmic
        )
        if symptoms.rhythmic:
            self._beat(symptoms, stamp)
        elif saturated:
            self._fill(symptoms, foreign, stamp)
        elif Outcome.ANSWERED in symptoms.outcomes:
            # A request that nobody answered tells nothing about what stands between answers.
            self._be_quiet()

    def _beat(self, symptoms: Symptoms, stamp: int) -> None:
        self._quiet = self._foreign = 0
        self.permanent = None
        if not self._beats:
            self._since = stamp
        self._beats += symptoms.packets
        if self._beats >= BEATS and self.rhythmic is None:
            self.rhythmic = Finding(
                "rhythmic_jammer",
                component.bus(self._bus),
                0.95,
                self._since,
                f"exactly one zero byte stands before each of {self._beats} packets in a row",
                {"packets_with_zero": self._beats},
            )

    def _fill(self, symptoms: Symptoms, foreign: int, stamp: int) -> None:
        self._quiet = self._beats = 0
        self.rhythmic = None
        if not self._foreign:
            self._since = stamp
        self._foreign += foreign
        if self._foreign >= LOOSE_CONTACT_BYTES and self.permanent is None:
            self.permanent = Finding(
                "permanent_jammer",
                component.bus(self._bus),
                0.97,
                self._since,
                f"{self._foreign} foreign bytes fill {symptoms.filled:.0%} of the time in which "
                "nobody should send",
                {"foreign_bytes": self._foreign, "pauses_filled": round(symptoms.filled, 3)},
            )

    def _be_quiet(self) -> None:
        self._quiet += 1
        if self.rhythmic is None and self.permanent is None:
            self._beats = self._foreign = 0
        elif self._quiet >= QUIET_TRANSACTIONS:
            self._beats = self._foreign = 0
            self.rhythmic = self.permanent = None
