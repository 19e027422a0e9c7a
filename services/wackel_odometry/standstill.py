"""Whether the robot stands: wheels and gyros both still, and long enough.

Stillness of the gyro alone would take a slow, even turn for rest; stillness of the wheels alone,
a robot that is pushed or carried.
"""

import math

import numpy as np

from wackel_drive.alignment import Step
from wackel_kinematics.array import Floats, Ints

LEAST_S = 0.3
"""Rest shorter than this is a reversal or a pause between two moves."""
TREMBLE = 1.5
"""Encoder steps by which a wheel at rest may appear to turn: its edge, and play."""
GYRO_SPREAD = 12.0
"""Standard deviations of its noise within which a still gyro stays, from lowest to highest; in an
hour at 100 Hz the extremes of normal noise are 10 apart."""
GYRO_STEP = 0.005
"""rad/s on top of it: a few steps of a sensor with 16 bit for 2000 °/s."""

REST_SIGMA = np.array([2e-4, 2e-4, 1e-3])
"""m/s, m/s and rad/s that a robot at rest may still have: :data:`TREMBLE` encoder steps (2 mrad) of
a wheel of 3 cm within :data:`LEAST_S`, seen from wheels 20 cm away from the centre."""


class Standstill:
    """Follows wheels and gyros.

    Args:
        roll_wheels: Wheels with a roll row.
        encoder_step: rad.
        noise_density: Of each gyro, rad/s/√Hz, shape (g,).

    Attributes:
        wheels_s: For how long the wheels have been still.
    """

    def __init__(self, roll_wheels: Ints, encoder_step: float, noise_density: Floats) -> None:
        self.wheels_s = 0.0
        self._gyros_s = 0.0
        self._wheels: list[int] = roll_wheels.tolist()
        self._tremble = TREMBLE * encoder_step
        self._density = noise_density.tolist()
        self._turned = [0.0] * len(roll_wheels)
        self._low = [math.inf] * len(self._density)
        self._high = [-math.inf] * len(self._density)

    def step(self, step: Step, wheels: list[bool], gyros: list[bool]) -> bool:
        """Takes in a step; says whether the robot stands.

        Args:
            step: What the sensors said; a sensor that said nothing is left out.
            wheels, gyros: Which of the roll wheels and gyros are believed, in their order.
        """
        seconds = step.seconds
        rates = [step.wheel_rate[i] for i in self._wheels]
        still = self._still(rates, wheels, seconds)
        self.wheels_s = self.wheels_s + seconds if still else 0.0
        quiet = self._quiet(step.gyro_rate, gyros, seconds)
        self._gyros_s = self._gyros_s + seconds if quiet else 0.0
        return min(self.wheels_s, self._gyros_s) >= LEAST_S

    def _still(self, rates: list[float], believed: list[bool], seconds: float) -> bool:
        """Whether no wheel has moved from where it stood, and at least one says so."""
        heard, turned = False, self._turned
        for i, rate in enumerate(rates):
            if believed[i] and math.isfinite(rate):
                heard = True
                turned[i] += rate * seconds
                if abs(turned[i]) > self._tremble:
                    break
        else:
            if heard:
                return True
        self._turned = [0.0] * len(rates)
        return False

    def _quiet(self, rates: list[float], believed: list[bool], seconds: float) -> bool:
        """Whether each gyro that is believed stays within its noise; one that says nothing does."""
        quiet = True
        for i, rate in enumerate(rates):
            if not (believed[i] and math.isfinite(rate)):
                continue
            low, high = min(self._low[i], rate), max(self._high[i], rate)
            allowed = GYRO_SPREAD * self._density[i] / math.sqrt(seconds) + GYRO_STEP
            if high - low > allowed:
                low = high = rate
                quiet = False
            self._low[i], self._high[i] = low, high
        return quiet
