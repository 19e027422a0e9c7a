"""Which motors are switched off while others are on, from registers that are read now and then.

A gateway reads those of each servo once a second, so what is known of some is up to a second old.
While all are switched on or off, those that have been read say something else than those that have
not. So of a motor that says off, another must have been on well before it was asked, and well after
it was off.
"""

SWITCHING_NS = 250_000_000
"""In which software switches the motors of a robot, one after the other."""


class TorqueWatch:
    """Follows the registers of some motors.

    Args:
        motors: How many.

    Attributes:
        off: Which of them are switched off while others are on.
    """

    def __init__(self, motors: int) -> None:
        self.off = [False] * motors
        self._on: list[bool | None] = [None] * motors
        self._since = [0] * motors  # stamps of the first reading, and of the last, that said so
        self._read = [0] * motors

    def read(self, motor: int, *, on: bool, stamp: int) -> None:
        """A register has been read."""
        if on is not self._on[motor] or stamp < self._read[motor]:
            self._on[motor], self._since[motor] = on, stamp
        self._read[motor] = stamp
        if False in self._on or True in self.off:
            self.off = [
                state is False and self._is_alone(number) for number, state in enumerate(self._on)
            ]

    def _is_alone(self, motor: int) -> bool:
        """Whether others have been on since before it was off, or was asked last, and still are."""
        since, read = self._since, self._read
        others = [number for number, state in enumerate(self._on) if state]
        were_on = any(since[other] <= read[motor] - SWITCHING_NS for other in others)
        return were_on and any(read[other] >= since[motor] + SWITCHING_NS for other in others)
