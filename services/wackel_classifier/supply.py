"""Voltages along the chain: one bad contact, or a supply that is too low for all."""

from itertools import pairwise
from statistics import median

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_schemas import component

FRESH_NS = 30_000_000_000
"""Older readings are no longer compared; the background reads each voltage every few seconds."""
STEP_V = 0.5
"""Drop over one cable that a sound one does not make: 0.1 Ω of cable and contacts carry 5 A then.
The register's resolution is 0.1 V."""
STEP_RATIO = 4.0
"""How much more it must be than the median drop over the other cables with their like currents."""
SWAY_V = 0.3
"""What a servo's voltage sways by behind a bad contact, as its current changes: three steps of the
register. One that stays low is rather a servo that gets or measures too little."""
LOW_SHARE = 0.85
"""Of the nominal voltage: a lithium battery is nearly empty there (3.15 V of 3.7 V a cell)."""


class Supply:
    """Follows Present Input Voltage of each servo."""

    def __init__(self, chain: Chain, nominal_volts: float | None) -> None:
        self._chain = chain
        self._nominal = nominal_volts
        self._volts: list[float | None] = [None] * len(chain)
        self._read_ns = [0] * len(chain)
        self._candidate: tuple[str, str] | None = None
        self._candidate_ns = 0
        self._candidate_stamp = 0
        self._found: Finding | None = None
        self._stepped = 0  # the cable of the greatest drop, counted from the supply
        self._place: int | None = None  # the same of what has been found
        self._lone: int | None = None  # the only servo behind the candidate
        self._lone_volts: list[float] = []  # lowest and highest since then

    def voltage(self, position: int, volts: float, now_ns: int, stamp: int) -> None:
        """A reading.

        Readings are of different times, so while all of them change they look like a step; what is
        found counts once every servo has been read again.
        """
        self._volts[position] = volts
        self._read_ns[position] = now_ns
        self._compare(now_ns, stamp)

    @property
    def settled_ns(self) -> int:
        """Servos that complained before this time do so beside voltages that have been compared.

        Where voltages are not read, there is nothing to wait for.
        """
        if None in self._volts or not self._volts:
            return 1 << 62
        pending = self._candidate is not None and (self._found is None or self._is_steady())
        return -1 if pending else min(self._read_ns)

    def gone(self, position: int) -> None:
        """A servo is out of reach."""
        self._volts[position] = None
        self._candidate = self._found = self._place = self._lone = None

    def _is_steady(self) -> bool:
        """Whether there is but one servo behind the candidate, and its voltage does not sway."""
        return self._lone is not None and self._lone_volts[1] - self._lone_volts[0] < SWAY_V

    def _compare(self, now_ns: int, stamp: int) -> None:
        volts = [
            volts if now_ns - read_ns <= FRESH_NS else None
            for volts, read_ns in zip(self._volts, self._read_ns, strict=True)
        ]
        known = [value for value in volts if value is not None]
        found = None
        if known and len(known) == len(volts):
            found = self._step(known) or self._low(known)
        candidate = None if found is None else (found.code, found.component)
        if candidate != self._candidate:
            self._candidate, self._candidate_ns, self._candidate_stamp = candidate, now_ns, stamp
            # One servo behind the cable: then it is a suspect itself.
            last = len(known) - 1 if self._chain.power == "adapter" else 0
            self._lone = last if found is not None and found.suspects else None
            self._lone_volts = []
        if self._lone is not None:
            seen = [*self._lone_volts, known[self._lone]]
            self._lone_volts = [min(seen), max(seen)]
        if found is None:
            self._found = self._place = None
        elif min(self._read_ns) > self._candidate_ns:
            found.since = self._candidate_stamp
            self._found = found
            self._place = self._stepped if found.code == "contact_resistance" else None

    def findings(
        self, complaining: list[int], undervoltage: list[int], stamp: int
    ) -> list[Finding]:
        """What the voltages say.

        Args:
            complaining: Positions of the servos that report any hardware error.
            undervoltage: Those of them that are known to mean their input voltage.
            stamp: Of this transaction.
        """
        chain = self._chain
        # All of at least two servos at once: then it is not the servos.
        if undervoltage and len(complaining) == len(chain) > 1:
            return [
                Finding(
                    "low_supply",
                    component.supply(chain.bus),
                    0.95,
                    stamp,
                    f"all {len(chain)} servos raise an alert; input voltage is out of limits",
                    {"servos_reporting": len(undervoltage)},
                )
            ]
        if self._found is None or (self._is_steady() and self._lone in undervoltage):
            return []
        return [self._found]

    def _step(self, volts: list[float]) -> Finding | None:
        """The one cable over which the voltage falls for all behind it, seen from the supply."""
        chain = self._chain
        if len(chain) < 2 or chain.power == "both":
            return None
        # From the supply: the first servo first if it enters at the adapter, else the last one.
        along = volts if chain.power == "adapter" else volts[::-1]
        drops = [before - after for before, after in pairwise(along)]
        greatest = max(range(len(drops)), key=drops.__getitem__)
        # Readings of different times sway: what has been found stays while it can be true.
        known = self._place
        kept = known is not None and min(along[: known + 1]) - max(along[known + 1 :]) >= STEP_V
        if known is not None and kept:
            greatest = known
        self._stepped = greatest
        drop = drops[greatest]
        if not kept and drop < STEP_V:
            return None
        others = median(abs(d) for i, d in enumerate(drops) if i != greatest) if drops[1:] else 0.0
        behind = along[greatest + 1 :]
        before = along[greatest]
        # What lies behind is lower than what lies before, and none of it stands out.
        stands_out = max(behind) > before - max(drop, STEP_V) / 2
        if not kept and (drop < STEP_RATIO * others or stands_out):
            return None
        # Cable k leads to servo k; seen from the far end, from it to the servo before.
        first = greatest + 1 if chain.power == "adapter" else len(chain) - 2 - greatest
        cable = chain.cable(first if chain.power == "adapter" else first + 1)
        alone = len(behind) == 1
        return Finding(
            "contact_resistance",
            cable,
            0.6 if alone else 0.9,
            0,
            f"{drop:.1f} V less behind it than before it; over the other cables {others:.1f} V",
            {
                "drop_V": round(drop, 2),
                "usual_drop_V": round(others, 2),
                "before_V": round(before, 2),
                "behind_V": round(behind[0], 2),
            },
            [chain.servo(first)] if alone else [],
        )

    def _low(self, volts: list[float]) -> Finding | None:
        if self._nominal is None or max(volts) >= LOW_SHARE * self._nominal:
            return None
        highest = max(volts)
        return Finding(
            "low_supply",
            component.supply(self._chain.bus),
            0.95,
            0,
            f"the highest voltage in the chain is {highest:.1f} V, nominal is {self._nominal:g} V",
            {"highest_V": round(highest, 2), "nominal_V": self._nominal},
        )
