"""Watches one gyro: saturated, frozen, silent, at the wrong rate, wrongly stamped, biased."""

import math

from wackel_drive.alignment import WAIT_NS, Step
from wackel_drive.stuck import SAMPLES, StuckValue
from wackel_node.config_drive import RATE_FACTOR, GyroConfig
from wackel_odometry.reports import Complaint
from wackel_odometry.time_offset import Offset, TimeOffset
from wackel_odometry.witness import Witness

NEAR_SATURATION = 0.98
"""Share of the greatest rate beyond which a sensor is no longer linear."""
SATURATED_NS = 1_000_000_000
"""For so long after it the heading may have suffered; samples at the limit that are no further
apart are one run."""
SILENT_NS = 500_000_000
"""Longer than any driver's buffer."""
RATE_NS = 1_000_000_000
OFFSET_S = 0.02
"""At 5 rad/s², a quick turn's start, it makes an error of 0.1 rad/s."""
OFFSET_SIGMAS = 5.0
OFFSET_LASTS_NS = 2_000_000_000
"""A clock that is off stays so; a wheel that is dragged until it is excluded seems to be late or
early as it pleases."""


class GyroWatch:
    """Follows the samples of one gyro and the steps.

    Args:
        config: Of the gyro.

    Attributes:
        in_step: Whether its samples have ever covered a step.
        witness: Of time in which no step is made.
    """

    def __init__(self, config: GyroConfig) -> None:
        self.in_step = False
        self.witness = Witness()
        self._config = config
        self._value = StuckValue()
        self._saturated: tuple[int, int] | None = None  # first and last of the present run
        self._uncovered_ns = 0  # of the steps since the last one that its samples cover
        self._heard_ns = 0  # how much that was when a sample last came
        self._came = self._useless = 0  # samples since then; those with nothing wrong but the stamp
        self._behind_ns = 0  # the most that one of those was behind the others, or ahead if below 0
        self._window: tuple[int, int] | None = None  # since, samples
        self._rate: float | None = None
        self._offset = TimeOffset()
        self._late: Offset | None = None  # its offset, if that is too large
        self._late_since = 0

    @property
    def frozen(self) -> bool:
        """Whether its value is stuck."""
        return self._value.stuck

    def sample(
        self,
        stamp: int,
        values: tuple[float, float, float],
        rate: float | None,
        sound: bool,
        newest: int | None,
    ) -> None:
        """A sample as it came.

        Args:
            stamp: Its own.
            values: About the sensor's axes, rad/s.
            rate: About the robot's z axis; ``None`` if it was not taken.
            sound: Whether at most its stamp was against that.
            newest: Stamp that the sensors had come to, this one left out if it was not taken.
        """
        self._value.sample(stamp, values)
        if rate is not None and abs(rate) >= NEAR_SATURATION * self._config.saturation:
            first, last = self._saturated or (stamp, stamp)
            # Steps are made of samples that are long there: the latest alone is of none of them.
            self._saturated = first if 0 <= stamp - last <= SATURATED_NS else stamp, stamp
        self._came += 1
        self._useless += sound
        if sound and newest is not None and abs(newest - stamp) > abs(self._behind_ns):
            self._behind_ns = newest - stamp
        self._heard_ns = self._uncovered_ns
        since, count = self._window or (stamp, 0)
        if not 0 <= stamp - since <= 2 * RATE_NS:
            self._window = stamp, 0
        elif stamp - since >= RATE_NS:
            self._rate = count * 1e9 / (stamp - since)
            self._window = stamp, 1
        else:
            self._window = since, count + 1

    def usable(self, step: Step, rate: float) -> float:
        """Takes in the mean of its samples in a step, rad/s; each step once.

        Args:
            step: The step.
            rate: Not a number where no samples cover it.

        Returns:
            What can be used of it: not a number while the value is stuck or at its limit.
        """
        if math.isfinite(rate):
            self.in_step, self._uncovered_ns = True, 0
        elif step.end - step.begin <= SILENT_NS:  # else the wheels themselves were silent
            if not self._uncovered_ns:
                # While there were no steps, none could be of use.
                self._came = self._useless = self._heard_ns = self._behind_ns = 0
            self._uncovered_ns += step.end - step.begin
        period = 1e9 / self._config.rate
        saturated = self._saturated is not None and (
            step.begin - period <= self._saturated[1] and self._saturated[0] <= step.end + period
        )
        return math.nan if saturated or self.frozen else rate

    def step(self, step: Step, wheels: float, gyro: float, bias: float) -> None:
        """Takes in the yaw rate of the wheels alone and of the gyro in a step, rad/s, maybe NaN."""
        if math.isfinite(wheels):
            self._value.turns(step.end, wheels)
        self._offset.add(step.seconds, wheels, gyro - bias)

    def complaints(self, now: int, bias: float, sigma: float) -> list[Complaint]:
        """What is wrong with it, as of the end of the latest step."""
        config, found = self._config, []
        # The latest sample may be newer than the latest step.
        if self._saturated is not None and abs(now - self._saturated[1]) <= SATURATED_NS:
            limit = config.saturation
            found.append(
                Complaint(
                    "gyro_saturated",
                    f"a rate of {NEAR_SATURATION:.0%} of {limit:g} rad/s and more",
                    {"limit_rad_s": limit},
                )
            )
        if self.frozen:
            found.append(
                Complaint(
                    "gyro_frozen",
                    f"{self._value.same} samples with exactly the same value while the wheels turn",
                    {"samples": self._value.same},
                )
            )
        if self._uncovered_ns > SILENT_NS:
            found += self._out_of_step()
        elif self._rate is not None:
            if not 1 / RATE_FACTOR <= self._rate / config.rate <= RATE_FACTOR:
                found.append(_wrong_rate(self._rate, config.rate))
            if (offset := self._offset.estimate()) is not None:  # a robot at rest disproves none
                beyond = abs(offset.seconds) > max(OFFSET_S, OFFSET_SIGMAS * offset.sigma)
                if self._late is None:
                    self._late_since = now
                self._late = offset if beyond else None
            lasts = not 0 <= now - self._late_since < OFFSET_LASTS_NS
            if self._late is not None and lasts:
                found.append(_offset(*self._late))
        if abs(bias) - 3 * sigma > config.bias_limit:
            found.append(
                Complaint(
                    "gyro_bias",
                    f"a bias of {bias:.4f} ± {sigma:.4f} rad/s, at most {config.bias_limit:g} "
                    "expected",
                    {"bias_rad_s": round(bias, 5), "limit_rad_s": config.bias_limit},
                    {"bias": f"{bias:.3f}"},
                )
            )
        return found

    def _out_of_step(self) -> list[Complaint]:
        """No sample covers the steps: there are none or few, they come late, or their stamps are of
        another time.

        What is wrong with them else is told of the input.
        """
        silent_ns = self._uncovered_ns - self._heard_ns
        if not self._came or silent_ns > RATE_NS:
            text = f"no sample for {silent_ns / 1e9:.1f} s of the wheels' time"
            return [Complaint("gyro_silent", text)]
        rate = self._came * 1e9 / max(self._heard_ns, 1)  # whatever their stamps are
        needed = max(self._config.rate, 1e9 / WAIT_NS)  # steps do not wait for slower ones
        if rate < needed / RATE_FACTOR:
            known = self._uncovered_ns > RATE_NS
            return [_wrong_rate(rate, needed)] if known else []
        if self._useless >= SAMPLES:
            return [_offset(-self._behind_ns / 1e9, 0.0)]
        return []


def _wrong_rate(rate: float, nominal: float) -> Complaint:
    told, expected = f"{rate:.0f}", f"{nominal:.0f}"
    return Complaint(
        "gyro_rate",
        f"{told} samples a second, {expected} expected",
        {"rate_Hz": round(rate, 1), "nominal_Hz": nominal},
        {"rate": told, "nominal": expected},
    )


def _offset(seconds: float, sigma: float) -> Complaint:
    told = f"{seconds:+.0f} s" if abs(seconds) >= 1.0 else f"{seconds * 1e3:+.0f} ms"
    return Complaint(
        "gyro_time_offset",
        f"stamps {told} off, ± {sigma * 1e3:.0f} ms",
        {"offset_s": round(seconds, 4), "sigma_s": round(sigma, 4)},
        {"offset": told},
    )
