"""Radii, steering offsets and track of a robot, from a run whose true path was recorded.

A camera or motion capture gives the true path, or marks on the floor some poses of it. The measures
are chosen such that the wheels lead from each true pose to the true pose some seconds later; what
the run does not tell stays as it was configured, within the errors that are configured (maximum a
posteriori). Without outside truth the wheels only tell how they differ, not which is right, and a
fit to that makes odometry worse.
"""

import math
from collections.abc import Sequence
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
FARTHEST, FARTHEST_RAD = 0.5, math.pi / 4
"""Share by which a radius or the track, and angle by which a steering may change: a path that asks
for more is of another robot."""


@dataclass(frozen=True)
class Run:
    """A recorded run of m + 1 moments and the m steps between them.

    Attributes:
        poses: True poses [x, y, θ], m, m, rad, shape (m + 1, 3); NaN where they are not known.
        rolled: How far each wheel turned in each step, rad, shape (m, n).
        heading: Direction that the servo of each wheel shows in each step, without
            ``steering_offset``, rad to the left of forward, shape (m, n); ignored where a wheel
            does not steer.
    """

    poses: Floats
    rolled: Floats
    heading: Floats

    def sound(self) -> bool:
        """Whether the shapes fit and all values are numbers, but for poses that are not known."""
        steps = len(self.poses) - 1
        return (
            self.poses.shape[1:] == (3,)
            and self.rolled.shape == self.heading.shape
            and len(self.rolled) == steps
            and not np.isinf(self.poses).any()
            and all(np.isfinite(each).all() for each in (self.rolled, self.heading))
        )

    def part(self, begin: int, end: int) -> "Run":
        """Some of its steps, and the moments before and after each."""
        return Run(self.poses[begin : end + 1], self.rolled[begin:end], self.heading[begin:end])

    def moments(self, stretch: int) -> list[int]:
        """Those of known poses that are ``stretch`` steps apart, or as little more as can be."""
        found: list[int] = []
        for moment in np.flatnonzero(np.isfinite(self.poses).all(axis=1)).tolist():
            if not found or moment - found[-1] >= stretch:
                found.append(moment)
        return found


def measures(config: DriveConfig) -> dict[str, float]:
    """What is calibrated, m and rad: of each wheel the radius, if it is driven, and the offset of
    its steering, if it is steered, ``<wheel>.radius`` and ``<wheel>.steering_offset``; and
    ``track``."""
    found = {}
    for wheel in config.wheels:
        if wheel.drive is not None:
            found[f"{wheel.name}.radius"] = wheel.radius
        if wheel.steering is not None:
            found[f"{wheel.name}.steering_offset"] = wheel.steering_offset
    if config.kind == "differential":
        sides = [position(wheel)[1] for wheel in config.wheels]
        found["track"] = config.track or max(sides) - min(sides)
    return found


def uncertainty(config: DriveConfig) -> dict[str, float]:
    """How far each of :func:`measures` may be off as it is configured: standard deviations, m and
    rad."""
    share = {"radius": config.radius_error, "track": TRACK_SIGMA}
    kinds = {name: name.rpartition(".")[2] for name in measures(config)}
    return {
        name: share[kinds[name]] * value if kinds[name] in share else config.steering_error
        for name, value in measures(config).items()
    }


@dataclass(frozen=True)
class Calibration:
    """What runs say of a drive.

    Attributes:
        config: The drive with the measures that fit best.
        sigma: Standard deviation of each measure, by the names of :func:`measures`, m and rad: as
            before where the runs do not tell it.
    """

    config: DriveConfig
    sigma: dict[str, float]


def fit(config: DriveConfig, runs: Sequence[Run], stretch: int) -> Calibration:
    """The radii, steering offsets and, if differential, the track that fit best.

    Args:
        config: As measured on the bench.
        runs: One or more.
        stretch: Least number of steps between the true poses that are compared. Some seconds, so
            that the motion outweighs the noise of the recording; on a circle a lap, over which the
            slope of the floor cancels.

    Raises:
        ValueError: A run holds values that are no numbers, or is shorter than a stretch.
    """
    before = measures(config)
    values, sigma = np.array(list(before.values())), np.array(list(uncertainty(config).values()))
    for run in runs:
        if not run.sound() or len(run.moments(stretch)) < 2:
            raise ValueError("a run holds what are no numbers, or is shorter than a stretch")
    expected = [noise(run, stretch) for run in runs]

    def off(change: Floats) -> Floats:
        """By how many standard deviations true poses are missed, and measures changed."""
        drive = _with(config, values + change)
        missed = [
            (misses(drive, run, stretch) / each).ravel()
            for run, each in zip(runs, expected, strict=True)
        ]
        return np.concatenate([*missed, change / sigma])

    farthest = np.array(
        [
            FARTHEST_RAD if name.endswith("steering_offset") else FARTHEST * value
            for name, value in before.items()
        ]
    )
    bounds = -farthest, farthest
    found = least_squares(off, np.zeros(len(sigma)), x_scale=sigma, bounds=bounds)
    left = found.fun[: -len(sigma)]
    # What is missed beyond the noise of the recording, wheels that slip, makes all less known.
    excess = max(math.sqrt(float(left @ left) / len(left)), 1.0)
    spread = np.sqrt(np.linalg.inv(found.jac.T @ found.jac).diagonal())
    known = dict(zip(before, np.minimum(excess * spread, sigma).tolist(), strict=True))
    return Calibration(_with(config, values + found.x), known)


def calibrate(config: DriveConfig, runs: Sequence[Run], stretch: int) -> DriveConfig:
    """The drive that :func:`fit` finds."""
    return fit(config, runs, stretch).config


def misses(config: DriveConfig, run: Run, stretch: int) -> Floats:
    """Where the wheels lead from each true pose less the next one, seen from the first.

    Args:
        config: The drive.
        run: A run.
        stretch: Least number of steps from one of these poses to the next.

    Returns:
        m, m, rad, shape (k, 3).
    """
    moments = run.moments(stretch)
    off = path(config, run, moments) - _between(run.poses[moments])
    off[:, 2] -= 2 * np.pi * np.round(off[:, 2] / (2 * np.pi))
    return off


def path(config: DriveConfig, run: Run, moments: Sequence[int]) -> Floats:
    """Where the wheels lead from each of some moments to the next, seen from there.

    Returns:
        Poses, shape (len(moments) - 1, 3).
    """
    steps = exponential(_ways(config, run))
    theta = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    cos, sin = np.cos(theta[:-1]), np.sin(theta[:-1])
    poses = np.zeros((len(theta), 3))
    np.cumsum(cos * steps[:, 0] - sin * steps[:, 1], out=poses[1:, 0])
    np.cumsum(sin * steps[:, 0] + cos * steps[:, 1], out=poses[1:, 1])
    poses[:, 2] = theta
    return _between(poses[moments])


def length(config: DriveConfig, run: Run) -> float:
    """How far the wheels have gone over the floor, m: along the way and about the centre."""
    ways = np.abs(_ways(config, run))
    return float(
        np.hypot(ways[:, 0], ways[:, 1]).sum() + Layout(config).drive.length_m * ways[:, 2].sum()
    )


def _ways(config: DriveConfig, run: Run) -> Floats:
    """Twist times duration of each step, m, m, rad, shape (m, 3)."""
    layout = Layout(config)
    heading = run.heading + np.array([wheel.steering_offset for wheel in config.wheels])
    # A step of one second: rates are angles, and the twist is the way.
    return forward(layout.drive, layout.drive.steering(heading), run.rolled).twist


def _between(poses: Floats) -> Floats:
    """Each pose but the first, seen from the one before."""
    dx, dy, turned = np.diff(poses, axis=0).T
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, turned], axis=-1)


def noise(run: Run, stretch: int) -> Floats:
    """Standard deviations of :func:`misses` by the noise of the recorded path, with its arguments:
    m, m, rad, shape (k, 3)."""
    dx, dy = np.diff(run.poses[run.moments(stretch), :2], axis=0).T
    # The heading at the beginning is noisy, too, which shows at the end of a lever.
    place = np.hypot(POSITION_SIGMA, HEADING_SIGMA * np.hypot(dx, dy))
    return np.stack([place, place, np.full(len(dx), HEADING_SIGMA * math.sqrt(2))], axis=-1)


def _with(config: DriveConfig, values: Floats) -> DriveConfig:
    """A drive with other measures, in the order of :func:`measures`."""
    told = dict(zip(measures(config), values.tolist(), strict=True))
    wheels = [
        replace(
            wheel,
            radius=told.get(f"{wheel.name}.radius", wheel.radius),
            steering_offset=told.get(f"{wheel.name}.steering_offset", wheel.steering_offset),
        )
        for wheel in config.wheels
    ]
    return replace(config, wheels=wheels, track=told.get("track", config.track))
