"""Whether a gyro's value is stuck: its noise is about one step of its resolution, so that even a
coarse one soon shows another value while the robot turns."""

SAMPLES = 25
LASTS_NS = 500_000_000
"""That all samples must be the same: so many, and for so long."""
TURN = 0.1
"""rad/s by which the robot's yaw rate must change meanwhile: 100 steps of a common gyro."""
FRESH_NS = 100_000_000
"""Two periods of a slow gyro; what turns while it sends nothing does not tell that it is stuck."""


class StuckValue:
    """Follows the samples of one gyro.

    Attributes:
        same: How many samples in a row have been exactly the same.
    """

    def __init__(self) -> None:
        self.same = 0
        self._last: tuple[float, float, float] | None = None
        self._since = self._stamp = 0
        self._turn: tuple[float, float] | None = None  # least and greatest meanwhile

    def sample(self, stamp: int, values: tuple[float, float, float]) -> None:
        """A sample as it came: UTC ns, and about all its axes."""
        if values == self._last:
            self.same += 1
        else:
            self._last, self.same, self._since, self._turn = values, 1, stamp, None
        self._stamp = stamp

    def turns(self, end: int, yaw_rate: float) -> None:
        """The robot turns so in a step with that end, rad/s, as others say."""
        if self.same and abs(end - self._stamp) <= FRESH_NS:
            low, high = self._turn or (yaw_rate, yaw_rate)
            self._turn = min(low, yaw_rate), max(high, yaw_rate)

    @property
    def stuck(self) -> bool:
        """Whether it is."""
        return (
            self.same >= SAMPLES
            and self._stamp - self._since >= LASTS_NS
            and self._turn is not None
            and self._turn[1] - self._turn[0] >= TURN
        )
