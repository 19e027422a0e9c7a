"""What the wheels of a recording did, beside the true path: runs to calibrate from."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from wackel_drive.alignment import Alignment, Step
from wackel_drive.layout import Layout
from wackel_node.config_drive import DriveConfig
from wackel_odometry.calibration import Run
from wackel_odometry.truth import Truth
from wackel_schemas.bus import BusState


class Recorded(NamedTuple):
    """A run in which all wheels were heard all the time, from ``begin`` to ``end``, UTC ns."""

    run: Run
    begin: int
    end: int

    @property
    def step_s(self) -> float:
        """Mean of its steps, s."""
        return (self.end - self.begin) / 1e9 / len(self.run.rolled)


def recorded_runs(
    config: DriveConfig, states: Iterable[tuple[str, BusState]], truth: Truth
) -> Iterator[Recorded]:
    """The runs of a recording, beside the true path.

    Args:
        config: The drive, as it was configured for the recording.
        states: What servos said, with the name of their bus, in the order of arrival.
        truth: The true path.
    """
    for steps in _unbroken(config, states):
        yield Recorded(_run(config, steps, truth), steps[0].begin, steps[-1].end)


def _unbroken(config: DriveConfig, states: Iterable[tuple[str, BusState]]) -> Iterator[list[Step]]:
    """Steps that follow each other, in each of which every servo was heard."""
    layout = Layout(config)
    alignment = Alignment(layout, {})
    rolling = [i for i, joint in enumerate(layout.rolling) if joint is not None]
    steering = [i for i, joint in enumerate(layout.steering) if joint is not None]
    steps: list[Step] = []
    for bus, state in states:
        if not alignment.bus_state(bus, state):
            continue
        while (step := alignment.step()) is not None:
            heard = [step.wheel_rate[i] for i in rolling] + [step.heading[i] for i in steering]
            whole = all(map(math.isfinite, heard))
            if steps and not (whole and step.begin == steps[-1].end):
                yield steps
                steps = []
            if whole:
                steps.append(step)
    if steps:
        yield steps


def _run(config: DriveConfig, steps: list[Step], truth: Truth) -> Run:
    stamps = np.array([steps[0].begin, *(step.end for step in steps)])
    seconds = np.array([[step.seconds] for step in steps])
    offset = np.array([wheel.steering_offset for wheel in config.wheels])
    # What no servo turns or steers says nothing.
    rolled = np.nan_to_num(np.array([step.wheel_rate for step in steps])) * seconds
    heading = np.nan_to_num(np.array([step.heading for step in steps]) - offset)
    return Run(truth.at(stamps), rolled, heading)
