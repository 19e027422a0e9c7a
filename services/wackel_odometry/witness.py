"""Whether time passes while no step is made, by the stamps of one whose messages go on."""

import math

STEADY_NS = 1_500_000_000
"""Between stamps that are further apart not so much time need have passed: whoever sends them was
away, or its clock was set. Statistics of a bus come once a second."""


class Witness:
    """One who goes on while the wheels are silent: a gyro, or the gateway of a bus."""

    def __init__(self) -> None:
        self._done: int | None = None
        self._since = self._last = -math.inf  # UTC ns

    def waited(self, stamp: int, done: int | None) -> float:
        """For how many ns it has gone on evenly since steps came to ``done``, at a new stamp."""
        if done != self._done:
            self._done, self._since = done, self._last
        if not 0 <= stamp - self._last <= STEADY_NS:
            self._since = stamp
        self._last = stamp
        return stamp - self._since
