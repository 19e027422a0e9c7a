"""What a fuzz target is, and what it reports."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Outcome:
    """Counts of one round, or of all of them.

    Attributes:
        bytes: Fed to the parser.
        planted: Intact packets put in.
        found: Of those, how many came out as they went in.
        shadowed: Of those, how many overlap other bytes that happen to be a valid packet which is
            complete before: a coincidence of CRC, one in 65536 for each bogus header.
        kinds: What the parser made of the bytes, by its own word for it.
        violations: One line for each broken promise; the run has failed if there is any.
    """

    bytes: int = 0
    planted: int = 0
    found: int = 0
    shadowed: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)

    def add(self, other: "Outcome") -> None:
        """Sum up."""
        self.bytes += other.bytes
        self.planted += other.planted
        self.found += other.found
        self.shadowed += other.shadowed
        self.kinds += other.kinds
        self.violations += other.violations


@dataclass(frozen=True)
class Target:
    """One parser under fire.

    Attributes:
        name: For the report.
        share: Of all the bytes, 0 … 1.
        round: Makes bytes from the generator, feeds them, judges the result.
    """

    name: str
    share: float
    round: Callable[[np.random.Generator], Outcome]
