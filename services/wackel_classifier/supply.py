"""Voltages along the chain: one bad contact, or a supply that is too low for all."""

from collections import deque
from itertools import pairwise
from statistics import median

from wackel_classifier.alerts import Alerts
from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_schemas import component

READINGS = 5
"""Of which the median counts: motors starting make single readings drop."""
FRESH_NS = 30_000_000_000
"""Older readings are no longer compared; the background reads each voltage every few seconds."""
STEP_V = 0.5
"""Drop over one cable that a sound one does not make: 0.1 Ω of cable and contacts carry 5 A then.
The register's resolution is 0.1 V."""
STEP_RATIO = 4.0
"""How much more it must be than the median drop over the other cables with their like currents."""
LOW_SHARE = 0.85
"""Of the nominal voltage: a lithium battery is nearly empty there (3.15 V of 3.7 V a cell)."""


class Supply:
    """Follows Present Input Voltage of each servo."""

    def __init__(self, chain: Chain, nominal_volts: float | None) -> None:
        self._chain = chain
        self._nominal = nominal_volts
        self._readings: list[deque[float]] = [deque(maxlen=READINGS) for _ in range(len(chain))]
        self._read_ns = [-FRESH_NS] * len(chain)
        self._stamp = [0] * len(chain)
        self._found: Finding | None = None

    def voltage(self, position: int, volts: float, now_ns: int, stamp: int) -> None:
        """A reading."""
        self._readings[position].append(volts)
        self._read_ns[position] = now_ns
        self._stamp[position] = stamp

    def gone(self, position: int) -> None:
        """A servo is out of reach."""
        self._readings[position].clear()

    def tick(self, now_ns: int, alerts: Alerts) -> None:
        """Compares the voltages; ``alerts`` knows which servos report theirs as out of limits."""
        volts = {
            position: median(readings)
            for position, readings in enumerate(self._readings)
            if readings and now_ns - self._read_ns[position] <= FRESH_NS
        }
        reporting = sum(alerts.undervoltage(place) for place in range(len(self._chain)))
        found = self._step(volts) or self._low(volts, reporting)
        if found is not None and self._found is not None and found.code == self._found.code:
            found.since = self._found.since
        self._found = found

    def findings(self) -> list[Finding]:
        """What the voltages said at the last tick."""
        return [] if self._found is None else [self._found]

    def _step(self, volts: dict[int, float]) -> Finding | None:
        """The one cable over which the voltage falls for all behind it, seen from the supply."""
        chain = self._chain
        if len(volts) < len(chain) or len(chain) < 2 or chain.power == "both":
            return None
        # From the supply: position 0 first if it enters at the adapter, else the last servo first.
        order = list(range(len(chain)))
        if chain.power == "far":
            order.reverse()
        along = [volts[position] for position in order]
        if self._nominal is not None:
            along.insert(0, self._nominal)
            order.insert(0, -1)
        drops = [before - after for before, after in pairwise(along)]
        greatest = max(range(len(drops)), key=drops.__getitem__)
        drop = drops[greatest]
        others = median(abs(d) for i, d in enumerate(drops) if i != greatest) if drops[1:] else 0.0
        behind = along[greatest + 1 :]
        if (
            drop < STEP_V
            or drop < STEP_RATIO * others
            or max(behind) > along[greatest] - STEP_V / 2
            or (self._nominal is not None and greatest == 0)  # that is the supply itself
        ):
            return None
        position = order[greatest + 1]
        cable = chain.cable(position if chain.power == "adapter" else order[greatest])
        alone = len(behind) == 1
        return Finding(
            "contact_resistance",
            cable,
            0.6 if alone else 0.9,
            self._stamp[position],
            f"{drop:.1f} V less behind it than before it; over the other cables {others:.1f} V",
            {
                "drop_V": round(drop, 2),
                "usual_drop_V": round(others, 2),
                "before_V": round(along[greatest], 2),
                "behind_V": round(along[greatest + 1], 2),
            },
            [chain.servo(position)] if alone else [],
        )

    def _low(self, volts: dict[int, float], reporting: int) -> Finding | None:
        chain = self._chain
        highest = max(volts.values(), default=None)
        low = (
            self._nominal is not None
            and highest is not None
            and len(volts) == len(chain)
            and highest < LOW_SHARE * self._nominal
        )
        # All of at least two servos at once: then it is not the servos.
        all_report = reporting == len(chain) > 1
        if not low and not all_report:
            return None
        values: dict[str, float | int | str] = {"servos_reporting": reporting}
        if highest is not None:
            values["highest_V"] = round(highest, 2)
        if self._nominal is not None:
            values["nominal_V"] = self._nominal
        return Finding(
            "low_supply",
            component.supply(chain.bus),
            0.95,
            max(self._stamp, default=0),
            f"{reporting} of {len(chain)} servos report input voltage out of limits"
            if highest is None
            else f"the highest voltage in the chain is {highest:.1f} V",
            values,
        )
