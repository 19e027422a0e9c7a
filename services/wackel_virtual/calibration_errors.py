"""How the true robot differs from the configured one."""

from dataclasses import dataclass
from random import Random
from typing import Self

from wackel_node.config_drive import DriveConfig, GyroConfig


@dataclass(frozen=True)
class CalibrationErrors:
    """What is wrong with a robot in which nothing is broken.

    Attributes:
        radius: Of each wheel's radius, as a share.
        direction: Of each wheel's direction, rad; no reading shows it.
        gyro_bias: rad/s.
        gyro_scale: As a share.
    """

    radius: tuple[float, ...]
    direction: tuple[float, ...]
    gyro_bias: float = 0.0
    gyro_scale: float = 0.0

    @classmethod
    def none(cls, drive: DriveConfig) -> Self:
        """A robot exactly as configured."""
        zeros = (0.0,) * len(drive.wheels)
        return cls(zeros, zeros)

    @classmethod
    def drawn(
        cls, drive: DriveConfig, gyro: GyroConfig, seed: int | str, factor: float = 1.0
    ) -> Self:
        """Errors as large as the configuration assumes them, or so many times.

        The gyro's bias is uniform within a fifth of its limit: a part that comes near to the limit
        is rare.
        """
        random = Random(f"{seed}/calibration")
        wheels = range(len(drive.wheels))
        return cls(
            tuple(random.gauss(0.0, factor * drive.radius_error) for _ in wheels),
            tuple(random.gauss(0.0, factor * drive.steering_error) for _ in wheels),
            random.uniform(-0.2, 0.2) * gyro.bias_limit,
            random.gauss(0.0, factor * gyro.scale_error),
        )
