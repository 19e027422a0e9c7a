"""What a gyro makes of the true yaw rate: bias that wanders, scale, noise, steps, saturation."""

from math import sqrt
from random import Random

from wackel_node.config_drive import Axis, GyroConfig

WANDER_S = 100.0
"""The time that ``bias_stability`` is about."""
STEPS = 32768
"""Of a 16-bit sensor, from 0 to its saturation."""

_PLACES: dict[Axis, tuple[int, int]] = {
    "x": (0, 1),
    "y": (1, 1),
    "z": (2, 1),
    "-x": (0, -1),
    "-y": (1, -1),
    "-z": (2, -1),
}


class VirtualGyro:
    """One gyro.

    Args:
        config: Its data sheet.
        seed: Of its noise.
        bias: After power-on, rad/s.
        scale: Error of the scale, as a share.
    """

    def __init__(self, config: GyroConfig, seed: int | str, bias: float, scale: float) -> None:
        self.config = config
        self._random = Random(f"{seed}/gyro")
        self._bias = bias
        self._gain = 1.0 + scale
        self._place, self._sign = _PLACES[config.axis]
        self._noise = config.noise_density * sqrt(config.rate)
        self._wander = config.bias_stability / sqrt(WANDER_S * config.rate)
        self._step = config.saturation / STEPS
        self._last = (0.0, 0.0, 0.0)

    def sample(
        self, yaw_rate: float, offset: float = 0.0, *, frozen: bool = False
    ) -> tuple[float, float, float]:
        """The next sample, about the sensor's own axes, rad/s.

        Args:
            yaw_rate: The true one, mean over the sample's time.
            offset: A fault that adds to the bias.
            frozen: A fault: the values of the sample before.
        """
        if frozen:
            return self._last
        gauss = self._random.gauss
        self._bias += gauss(0.0, self._wander)
        values = [gauss(0.0, self._noise) for _ in range(3)]
        values[self._place] += self._sign * (self._gain * yaw_rate + self._bias + offset)
        limit, step = self.config.saturation, self._step
        x, y, z = (step * round(min(limit, max(-limit, value)) / step) for value in values)
        self._last = x, y, z
        return self._last
