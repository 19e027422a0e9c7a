"""How a robot is built: what no configuration says, and what differs from one to the next."""

from dataclasses import dataclass
from random import Random
from typing import Self

from wackel_virtual.motion import TIME_CONSTANT_S


@dataclass(frozen=True)
class Build:
    """Servos, body and tyres.

    Attributes:
        lag_s: Time constant with which servos follow their goals.
        droop_m_s: What a driven wheel loses of its speed when it pushes with all its grip: velocity
            control without integral part, 4 % at 1.5 m/s.
        gyration: Radius of gyration by L, the mean distance of the wheels: a body somewhat smaller
            than its footprint.
        friction: Of tyres on a dry, smooth floor.
        grip_A: Current of a motor at which its tyre slips there: one that fits its robot has some
            reserve.
        rolling_A: Current that it needs to turn its wheel at :data:`FAST_M_S`.
    """

    lag_s: float = TIME_CONSTANT_S
    droop_m_s: float = 0.06
    gyration: float = 0.8
    friction: float = 0.8
    grip_A: float = 0.8  # noqa: N815  (A is the unit)
    rolling_A: float = 0.15  # noqa: N815

    @classmethod
    def drawn(cls, random: Random) -> Self:
        """Any: small servos in stiff loops to heavy wheels in soft ones, half a load or a full one,
        dusty tiles or clean rubber."""

        def between(least: float, most: float) -> float:
            """Any size as likely as any other."""
            return float(least * (most / least) ** random.random())

        return cls(
            between(0.02, 0.12),
            between(0.02, 0.12),
            random.uniform(0.6, 1.0),
            random.uniform(0.6, 1.0),
            between(0.4, 1.2),
            between(0.08, 0.25),
        )


FAST_M_S = 2.0
"""Of a wheel."""
