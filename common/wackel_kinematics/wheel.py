"""One wheel: where it touches the floor, how it is mounted, and which constraints it imposes.

Kinds and their constraints: Siegwart, Nourbakhsh, "Introduction to Autonomous Mobile Robots",
section 3.2.3 (wheel kinematic constraints); steered wheels also the paper's [4].
"""

import math
from dataclasses import dataclass
from typing import Self

MAX_ROLLER_RAD = math.radians(80.0)
"""Towards 90° the rollers' axis lies along the wheel's axle and the drive pushes nothing; at 80° an
error of the wheel rate is already felt 1/cos 80° = 5.8 times across."""


@dataclass(frozen=True)
class Placement:
    """Contact point of a wheel in the robot frame, polar as in the paper's figure 1.

    Attributes:
        l_m: Distance from the origin.
        alpha_rad: Angle from the x axis.

    Raises:
        ValueError: A value is not finite, or the distance is negative.
    """

    l_m: float
    alpha_rad: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.l_m) and self.l_m >= 0):
            raise ValueError(f"l is {self.l_m} m, expected a finite distance of 0 or more")
        if not math.isfinite(self.alpha_rad):
            raise ValueError(f"alpha is {self.alpha_rad} rad, expected a finite angle")

    @classmethod
    def cartesian(cls, x_m: float, y_m: float) -> Self:
        """The same from coordinates; at the origin alpha is 0."""
        return cls(math.hypot(x_m, y_m), math.atan2(y_m, x_m))

    @property
    def x_m(self) -> float:
        """Forward of the origin."""
        return self.l_m * math.cos(self.alpha_rad)

    @property
    def y_m(self) -> float:
        """Left of the origin."""
        return self.l_m * math.sin(self.alpha_rad)


@dataclass(frozen=True)
class Wheel:
    """A wheel as a set of constraints; made by the functions below.

    Attributes:
        place: Contact point.
        radius_m: None if the rolling is neither driven nor read: there is no roll row then.
        beta_rad: Steering angle β of a wheel that does not steer, None of one that does. The axle
            points along alpha + β, the wheel rolls forward along alpha + β − π/2.
        slide: Whether the wheel resists sideways motion: it has a slide row.
        roller_rad: Angle from the rolling direction to the axis of the roller on the floor.

    Raises:
        ValueError: The radius or an angle is out of range.
    """

    place: Placement
    radius_m: float | None
    beta_rad: float | None
    slide: bool
    roller_rad: float = 0.0

    def __post_init__(self) -> None:
        if self.radius_m is not None and not (math.isfinite(self.radius_m) and self.radius_m > 0):
            raise ValueError(f"radius is {self.radius_m} m, expected a finite length above 0")
        if self.beta_rad is not None and not math.isfinite(self.beta_rad):
            raise ValueError(f"heading or beta is {self.beta_rad} rad, expected a finite angle")
        if not abs(self.roller_rad) <= MAX_ROLLER_RAD:
            raise ValueError(
                f"roller angle is {self.roller_rad} rad, expected ±{MAX_ROLLER_RAD:.3f} rad at most"
            )
        if self.slide and self.roller_rad:
            raise ValueError("a wheel with rollers does not resist sideways motion")


def steered(place: Placement, radius_m: float | None) -> Wheel:
    """Steered standard wheel: roll row (eq. 3) if it has a radius, slide row (eq. 4)."""
    return Wheel(place, radius_m, None, slide=True)


def fixed(place: Placement, radius_m: float | None, heading_rad: float = 0.0) -> Wheel:
    """Fixed standard wheel that rolls along the heading: eq. 3 and 4 at constant β."""
    return Wheel(place, radius_m, _beta(place, heading_rad), slide=True)


def mecanum(
    place: Placement, radius_m: float, roller_rad: float, heading_rad: float = 0.0
) -> Wheel:
    """Swedish wheel: only the motion along the axis of the roller on the floor is bound.

    The roller rolls freely across its axis; along it the contact moves with the share cos γ of r φ̇.

    Args:
        place: Contact point.
        radius_m: Wheel radius.
        roller_rad: From the heading to the axis of the roller on the floor; ±45° for mecanum.
        heading_rad: Rolling direction.
    """
    return Wheel(place, radius_m, _beta(place, heading_rad), slide=False, roller_rad=roller_rad)


def omni(place: Placement, radius_m: float, heading_rad: float) -> Wheel:
    """Swedish wheel whose rollers turn straight across the heading: a roll row and nothing else."""
    return mecanum(place, radius_m, 0.0, heading_rad)


def castor(place: Placement) -> Wheel:
    """Castor that swivels freely: it follows any motion, so it has no row at all."""
    return Wheel(place, None, 0.0, slide=False)


def _beta(place: Placement, heading_rad: float) -> float:
    return heading_rad - place.alpha_rad + math.pi / 2
