"""When a part that was named is sound again."""

import numpy as np
import pytest

from tests.odometry.simulation import steered_drive
from wackel_diagnoser.hypotheses import Hypotheses
from wackel_diagnoser.reference import Target
from wackel_diagnoser.rows import Measured, Rows, Spread
from wackel_diagnoser.soundness import Soundness
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_node.config_drive import GyroConfig
from wackel_schemas import component

STEP_S = 0.01
SIGMA = 0.01
"""Of all rows."""
GYROS = {"body": GyroConfig()}


class Named:
    """A part of wheel ``w1`` of three that was named."""

    def __init__(self, path: str) -> None:
        config = steered_drive(3)
        layout = Layout(config)
        self._rows = Rows(layout, config, GYROS)
        self._row = (self._rows.rolling if path.endswith("drive") else self._rows.steering).start
        self._told = 0.0
        self._soundness = Soundness(
            Hypotheses(layout, GYROS),
            self._rows,
            (path,),
            step=self._step(),
            target=self._target(0.0),
            earlier={},
        )

    def drive(self, seconds: float, speed: float, off: float, *, evidence: float = 0.0) -> None:
        """It misses its reference by so much; its steering is told to turn."""
        nothing = np.zeros(self._rows.count)
        spread = Spread(np.full(self._rows.count, SIGMA**2), nothing, nothing)
        for _ in range(round(seconds / STEP_S)):
            self._told += 0.01
            z = np.zeros(self._rows.count)
            z[self._row + 1] = off
            h = np.zeros((self._rows.count, 3))
            still = [0.0] * 3
            measured = Measured(
                z,
                h,
                z[self._rows.gyros.start :].tolist(),
                [],
                [],
                speed,
                0.0,
                False,
                self._rows.every,
                still,
                [],
                lambda: spread,
            )
            self._soundness.step(self._step(), self._target(speed), measured, evidence)

    def sound(self, seconds: float = 1.0) -> bool:
        return self._soundness.lasts(seconds)

    def _step(self) -> Step:
        return Step(0, round(1e9 * STEP_S), STEP_S, *([self._told] * 3,) * 3, [0.0])

    def _target(self, speed: float) -> Target:
        told, nothing = [self._told] * 3, [0.0] * 3
        return Target(
            told, nothing, nothing, [speed] * 3, nothing, nothing, told, (0.0, 0.0, 0.0), 0.0
        )


DRIVE, STEERING = component.wheel_drive("w1"), component.wheel_steering("w1")


@pytest.mark.parametrize(("path", "off"), [(DRIVE, -0.1), (STEERING, 0.06)])
def test_what_follows_its_reference_again_is_sound_after_a_while(path: str, off: float) -> None:
    named = Named(path)
    named.drive(0.5, 1.0, off, evidence=2.0)
    named.drive(0.9, 1.0, 0.0)
    assert not named.sound()
    named.drive(0.2, 1.0, 0.0)
    assert named.sound()


def test_a_motor_that_is_a_tenth_too_slow_is_not_sound_where_it_turns_too_slowly_to_show() -> None:
    named = Named(DRIVE)
    named.drive(0.5, 1.0, -0.1, evidence=2.0)
    named.drive(5.0, 0.06, -0.006)
    assert not named.sound()
    named.drive(0.5, 1.0, 0.0)
    assert named.sound()


def test_a_steering_that_still_stands_off_is_not_sound_because_nothing_else_shows() -> None:
    named = Named(STEERING)
    named.drive(0.5, 0.5, 0.06, evidence=2.0)
    named.drive(5.0, 0.5, 0.06)
    assert not named.sound()


@pytest.mark.parametrize(("speaks_s", "sound"), [(STEP_S, True), (0.05, False)])
def test_evidence_for_the_fault_begins_it_anew_if_it_lasts(speaks_s: float, sound: bool) -> None:
    """A single step sets it back by some tenths."""
    named = Named(DRIVE)
    named.drive(0.5, 1.0, -0.1, evidence=2.0)
    named.drive(0.9, 1.0, 0.0)
    named.drive(speaks_s, 1.0, -0.1, evidence=2.0)
    named.drive(0.2, 1.0, 0.0)
    assert not named.sound()
    named.drive(0.2, 1.0, 0.0)
    assert named.sound() == sound


def test_where_a_fault_never_showed_in_the_reference_time_decides() -> None:
    named = Named(DRIVE)
    named.drive(0.5, 1.0, 0.0, evidence=2.0)
    named.drive(1.1, 1.0, 0.0)
    assert named.sound()
    assert not named.sound(3.0)
