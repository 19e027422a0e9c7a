"""The hypotheses: what may be faulty, and which measurements that would spoil, by how much.

A hypothesis widens the rows that it touches. Rows in this order, as :mod:`wackel_diagnoser.rows`
measures them: slide rows, roll rows, gyros, steering against its reference, rolling against its
reference.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.array import Bools, Floats
from wackel_node.config_drive import GyroConfig
from wackel_schemas import component

Class = Literal["", "sensor", "actuator"]

WRONG = 0.5
"""Share of the robot's speed by which a faulty wheel's rows may be off: blocked is 1, an offset of
10° is 0.17."""
ASTRAY = 0.5
"""rad between a faulty steering and where it should be."""
BRAKED = 0.15
"""Share of the speed by which a robot with a blocked wheel misses its reference."""
SLIPPING = 0.04
"""Share of the speed by which the other wheels then slip."""
YAW_OFF = 1.0
"""What a mechanical fault adds to the yaw rate, and what a faulty gyro shows too much, in units of
:data:`wackel_diagnoser.rows.YAW` of speed by length."""
GYRO_OFF = 3.0
SHOVED = 0.3
"""Share of the speed by which ice or a collision moves all wheels against the floor."""

SINGLE = -6.0
"""Logarithm of the prior probability of a fault."""
DOUBLE = -16.0
"""Of two at once: less than the square, since a shock may break both."""
COMMON = -8.0
"""Of what concerns the whole drive: it could explain any fault of a part, and shall not."""


@dataclass(frozen=True)
class Hypothesis:
    """One explanation.

    Attributes:
        components: What is faulty; none: nothing is.
        kind: ``sensor``: only the value is wrong; ``actuator``: the part does not do what it is
            told, so the robot really slips; empty where that is not asked.
    """

    components: tuple[str, ...]
    kind: Class = ""


class Hypotheses:
    """All hypotheses of a drive; the first is that nothing is wrong.

    Attributes:
        each: The hypotheses.
        prior: Logarithms of their prior probabilities, shape (K,).
        spread: Squares of the factors by which they widen rows, in units of
            :attr:`Measured.size <wackel_diagnoser.rows.Measured>`, shape (K, M).
        singles: Numbers of those with one component.
        explanations: The sets of components, the first empty.
        explanation: Which of them each hypothesis names.
        members: The hypotheses that name each.
    """

    def __init__(self, layout: Layout, gyros: Mapping[str, GyroConfig]) -> None:
        names = layout.names
        drive = layout.drive
        slides, rolls = drive.slide_wheels.tolist(), drive.roll_wheels.tolist()
        steers = [i for i in slides if drive.steers[i]]
        self._slide = {wheel: row for row, wheel in enumerate(slides)}
        self._roll = {wheel: len(slides) + row for row, wheel in enumerate(rolls)}
        first_gyro = len(slides) + len(rolls)
        self._gyro = {name: first_gyro + i for i, name in enumerate(gyros)}
        first_steering = first_gyro + len(gyros)
        self._steering = {wheel: first_steering + row for row, wheel in enumerate(steers)}
        first_rolling = first_steering + len(steers)
        self._rolling = {wheel: first_rolling + row for row, wheel in enumerate(rolls)}
        self._count = first_rolling + len(rolls)

        wheels: list[tuple[str, Literal["drive", "steering"], int]] = [
            *((component.wheel_drive(names[i]), "drive", i) for i in rolls),
            *((component.wheel_steering(names[i]), "steering", i) for i in steers),
        ]
        each = [Hypothesis(())]
        prior = [0.0]
        spread = [self._none()]
        for path, part, i in wheels:
            own = self._own(part, i)
            # Others may slip, or hold the robot: that they need not is worth a hypothesis.
            ways: list[tuple[Class, Floats]] = [
                ("actuator", np.maximum(own, self._dragging())),
                ("actuator", np.maximum(own, self._disturbed())),
                ("sensor", own),
            ]
            for kind, spoilt in ways:
                each.append(Hypothesis((path,), kind))
                prior.append(SINGLE)
                spread.append(spoilt)
        for name in gyros:
            each.append(Hypothesis((component.gyro(name),), "sensor"))
            prior.append(SINGLE)
            spread.append(self._of_gyro(name))
        for path, touched in (
            (component.DRIVE, self._ground()),
            (component.DRIVE, self._dragging()),  # the same of a shove that hardly moves it
            (component.COMMAND, self._command()),
        ):
            each.append(Hypothesis((path,)))
            prior.append(COMMON)
            spread.append(touched)
        owns = {path: self._own(part, i) for path, part, i in wheels}
        owns |= {component.gyro(name): self._of_gyro(name) for name in gyros}
        for (a, own_a), (b, own_b) in combinations(owns.items(), 2):
            each.append(Hypothesis((a, b)))
            prior.append(DOUBLE)
            spread.append(np.maximum(np.maximum(own_a, own_b), self._disturbed()))
        self.each = tuple(each)
        self.prior: Floats = np.array(prior)
        self.spread: Floats = np.array(spread) ** 2
        self._owns = owns
        self._places: dict[str, tuple[Literal["drive", "steering"], int]] = {
            path: (part, i) for path, part, i in wheels
        }
        self.explanations = tuple(dict.fromkeys(hypothesis.components for hypothesis in each))
        self.explanation = [self.explanations.index(h.components) for h in each]
        numbers = np.array(self.explanation)
        self.members: list[list[int]] = [
            np.flatnonzero(numbers == i).tolist() for i in range(len(self.explanations))
        ]
        self.singles = [number for number, h in enumerate(each) if len(h.components) == 1]

    def place(self, path: str) -> tuple[Literal["drive", "steering"], int] | None:
        """Part and wheel of a component; ``None`` if it is not of a wheel."""
        return self._places.get(path)

    def own_rows(self, path: str) -> Bools:
        """Rows that a component itself spoils, shape (M,)."""
        spoilt: Bools = self._owns[path] > 0
        return spoilt

    def __len__(self) -> int:
        return len(self.each)

    def _none(self) -> Floats:
        return np.zeros(self._count)

    def _own(self, part: Literal["drive", "steering"], wheel: int) -> Floats:
        touched = self._none()
        if wheel in self._roll:
            touched[[self._roll[wheel], self._rolling[wheel]]] = WRONG
        if part == "steering":
            touched[self._slide[wheel]] = WRONG
            touched[self._steering[wheel]] = ASTRAY
        return touched

    def _disturbed(self) -> Floats:
        """What a mechanical fault does to the robot's motion, with hardly any slip elsewhere."""
        touched = self._none()
        touched[list(self._rolling.values())] = BRAKED
        touched[list(self._gyro.values())] = YAW_OFF
        return touched

    def _dragging(self) -> Floats:
        touched = self._disturbed()
        touched[: len(self._slide) + len(self._roll)] = SLIPPING
        return touched

    def _of_gyro(self, name: str) -> Floats:
        touched = self._none()
        touched[self._gyro[name]] = GYRO_OFF
        return touched

    def _ground(self) -> Floats:
        touched = self._none()
        touched[: len(self._slide) + len(self._roll)] = SHOVED
        touched[list(self._rolling.values())] = SHOVED
        touched[list(self._gyro.values())] = GYRO_OFF
        return touched

    def _command(self) -> Floats:
        touched = self._none()
        touched[list(self._rolling.values())] = 1.0
        touched[list(self._steering.values())] = ASTRAY
        return touched
