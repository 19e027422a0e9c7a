"""When commands came: how old the one is that is followed, and whether others are missing.

Busy computers and networks lose some. Which way round a wheel turns depends on every command that
the drive got, so after a missing one it may not be known.
"""

from collections.abc import Sequence

FRESH_NS = 500_000_000
"""A command older than this is no longer what drives the robot."""
MISSING = 1.5
"""Times as long as usual after the last, before a command, another is missing."""
USUAL = 0.05
"""Share by which each interval changes what is usual: some twenty of them."""
DOUBTFUL_NS, LONGEST_NS = 200_000_000, 5_000_000_000
"""For how long it is not known which way round wheels turn: until none turns faster than this, but
not for ever. A path past several wheels' contacts has one or another turn as fast as it can for
more than two seconds."""
TURNING_RAD_S = 2.0


class CommandTimes:
    """Follows their stamps, UTC ns.

    Args:
        steered: Numbers of the wheels that steer.
    """

    def __init__(self, steered: Sequence[int]) -> None:
        self._steered = steered
        self._latest: int | None = None
        self._interval = 0.0  # from one command to the next as a rule, ns
        self._begun = 0  # up to here commands have been followed
        self._doubtful: int | None = None  # since when it is not known which way wheels turn

    def forget(self) -> None:
        """Time was started anew."""
        self._latest = self._doubtful = None

    def is_overtaken(self, stamp: int) -> bool:
        """Whether a later command is followed already."""
        return self._latest is not None and stamp <= self._latest

    def follow(self, stamp: int) -> bool:
        """A new command is followed; says whether it came late, or after one that did not come:
        since when the drive follows it is then not known."""
        latest, self._latest = self._latest, stamp
        if latest is None:
            return False
        interval = min(stamp - latest, FRESH_NS)
        usual = self._interval or interval
        self._interval = usual + USUAL * (interval - usual)
        return stamp <= self._begun or interval > MISSING * usual

    def pass_to(self, begin: int) -> None:
        """All commands up to here that have come are followed."""
        self._begun = begin

    def doubt(self, begin: int) -> None:
        """From here on it is not known which way round wheels turn."""
        self._doubtful = begin

    def is_known(self, begin: int, turned: Sequence[float], seconds: float) -> bool:
        """Whether it is known what drives the robot in a step.

        Args:
            begin: Of the step.
            turned: How far each wheel was steered meanwhile, rad; NaN if unknown.
            seconds: How long it took.
        """
        if self._latest is None or not 0 <= begin - self._latest <= FRESH_NS:
            return False
        if self._doubtful is not None:
            for_ns, most = begin - self._doubtful, TURNING_RAD_S * seconds
            rests = all(abs(turned[i]) < most for i in self._steered)
            if not 0 <= for_ns < DOUBTFUL_NS and (rests or not 0 <= for_ns < LONGEST_NS):
                self._doubtful = None
        return self._doubtful is None
