"""Radii, steering offsets and track of a robot, from a run whose true path was recorded.

A camera or motion capture gives the true path. The measures are chosen such that the wheels lead
from each true pose to the true pose some seconds later; what the run does not tell stays as it was
configured, within the errors that are configured (maximum a posteriori). Without outside truth the
wheels only tell how they differ, not which is right, and a fit to that makes odometry worse.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace
from scipy.optimize import least_squares

from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.forward import forward
from wackel_kinematics.planar import exponential
from wackel_node.config_drive import DriveConfig, position

TRACK_SIGMA = 0.02
"""Share by which a track is off: nobody knows where in its width a tyre touches the floor."""
POSITION_SIGMA = 0.003
"""m, and rad: noise of the recorded path."""
HEADING_SIGMA = 0.005


@dataclass(frozen=True)
class Run:
    """A recorded run of m + 1 moments and the m steps between them.

    Attributes:
        poses: True poses [x, y, θ], m, m, rad, shape (m + 1, 3).
        rolled: How far each wheel turned in each step, rad, shape (m, n).
        heading: Direction that the servo of each wheel shows in each step, without
            ``steering_offset``, rad to the left of forward, shape (m, n); ignored where a wheel
            does not steer.
    """

    poses: Floats
    rolled: Floats
    heading: Floats

    def sound(self) -> bool:
        """Whether the shapes fit and all values are numbers."""
        steps = len(self.poses) - 1
        return (
            self.poses.shape[1:] == (3,)
            and self.rolled.shape == self.heading.shape
            and len(self.rolled) == steps
            and all(np.isfinite(each).all() for each in (self.poses, self.rolled, self.heading))
        )


def calibrate(config: DriveConfig, runs: list[Run], stretch: int) -> DriveConfig:
    """The drive with the radii, steering offsets and, if differential, the track that fit best.

    Args:
        config: As measured on the bench.
        runs: One or more.
        stretch: Steps between the true poses that are compared. Some seconds, so that the motion
            outweighs the noise of the recording; on a circle a lap, over which the slope of the
            floor cancels.

    Raises:
        ValueError: A run holds values that are no numbers, or is shorter than a stretch.
    """
    for run in runs:
        if not run.sound() or len(run.rolled) < stretch:
            raise ValueError("a run holds what are no numbers, or is shorter than a stretch")
    sigma = np.array(list(_sigmas(config)))

    def misses(change: Floats) -> Floats:
        drive = _changed(config, change)
        return np.concatenate([*(_misses(drive, run, stretch) for run in runs), change / sigma])

    return _changed(config, least_squares(misses, np.zeros(len(sigma)), x_scale=sigma).x)


def path(config: DriveConfig, run: Run, stretch: int) -> Floats:
    """Where the wheels lead from the beginning of each stretch, seen from there.

    Returns:
        Poses, shape (m // stretch, 3).
    """
    count = len(run.rolled) // stretch
    layout = Layout(config)
    heading = run.heading + np.array([wheel.steering_offset for wheel in config.wheels])
    # A step of one second: rates are angles, and the twist is the way.
    way = forward(layout.drive, layout.drive.steering(heading), run.rolled).twist
    steps = exponential(way[: count * stretch]).reshape(count, stretch, 3)
    theta = np.cumsum(steps[..., 2], axis=1)
    before = theta - steps[..., 2]
    cos, sin = np.cos(before), np.sin(before)
    x = (cos * steps[..., 0] - sin * steps[..., 1]).sum(axis=1)
    y = (sin * steps[..., 0] + cos * steps[..., 1]).sum(axis=1)
    return np.stack([x, y, theta[:, -1]], axis=-1)


def _misses(config: DriveConfig, run: Run, stretch: int) -> Floats:
    """By how many standard deviations the wheels miss the true path."""
    told = path(config, run, stretch)
    ends = run.poses[: len(told) * stretch + 1 : stretch]
    begin, end = ends[:-1], ends[1:]
    dx, dy = (end - begin)[:, 0], (end - begin)[:, 1]
    cos, sin = np.cos(begin[:, 2]), np.sin(begin[:, 2])
    turn = end[:, 2] - begin[:, 2] - told[:, 2]
    turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
    # The heading at the beginning is noisy, too, which shows at the end of a lever.
    place = np.hypot(POSITION_SIGMA, HEADING_SIGMA * np.hypot(dx, dy))
    return np.concatenate(
        [
            (told[:, 0] - cos * dx - sin * dy) / place,
            (told[:, 1] - cos * dy + sin * dx) / place,
            turn / (HEADING_SIGMA * np.sqrt(2)),
        ]
    )


def _sigmas(config: DriveConfig) -> Iterator[float]:
    """How far each measure may be off: the changes of :func:`_changed`, in its order."""
    for wheel in config.wheels:
        yield config.radius_error
        if wheel.steering is not None:
            yield config.steering_error
    if config.kind == "differential":
        yield TRACK_SIGMA


def _changed(config: DriveConfig, change: Floats) -> DriveConfig:
    """A drive whose measures differ by shares and, for steering offsets, by angles."""
    changes = iter(change.tolist())
    wheels = []
    for wheel in config.wheels:
        radius = wheel.radius * (1 + next(changes))
        offset = wheel.steering_offset + (next(changes) if wheel.steering is not None else 0.0)
        wheels.append(replace(wheel, radius=radius, steering_offset=offset))
    if config.kind != "differential":
        return replace(config, wheels=wheels)
    sides = [position(wheel)[1] for wheel in config.wheels]
    track = (config.track or max(sides) - min(sides)) * (1 + next(changes))
    return replace(config, wheels=wheels, track=track)
