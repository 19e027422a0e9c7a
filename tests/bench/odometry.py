"""Odometry: cost of a step, drift on random paths, and recorded robots against their baselines.

Most simulated robots do not slip: their errors are those of calibration (0.2° and 0.3 % of each
wheel), encoder steps, and a gyro with noise and bias. Those of which a sensor fails on the way have
servos that lag and a floor on which wheels slip, and only their diagnoser says what is faulty.
Each version of the code has seeds of its own, as in :mod:`tests.bench.fresh`.
"""

# ruff: noqa: E402
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random

from wackel_node.algebra import single_threaded

single_threaded()  # as the service does

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from rich.table import Table

from tests.bench.fresh import version
from tests.bench.progress import steps
from tests.bench.result import Figure, side_by_side, table
from tests.diagnoser.rig import Rig
from tests.odometry.runs import (
    HUSKY,
    OPTIODOM,
    End,
    calibrated,
    husky,
    optiodom_calibrated,
    optiodom_end,
    optiodom_nominal,
    optiodom_run,
    ride,
)
from tests.odometry.simulation import (
    BUS,
    GYRO,
    Robot,
    calibration_errors,
    differential_drive,
    random_path,
    steered_drive,
)
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_node.garbage import collect_rarely
from wackel_odometry.core import Odometer
from wackel_schemas import component
from wackel_schemas.drive import Odometry, OdometryRequest
from wackel_virtual.build import Build
from wackel_virtual.drivetrain import Physics

_SEED = int(version("services/wackel_odometry"), 16)
_NEES = (1.2, 3.0)
"""Of the pose: 3 is right; caution about errors that stay, and about floors that hold worse, makes
it less, but no less than two fifths of that of robots that slip and lag as theirs do."""
_LEARN_M, _LENGTH_M = 15.0, 17.0
"""Driven before, in which the diagnoser learns what its robot is like, and then."""
_NOMINAL_M, _NOMINAL_DEG, _CALIBRATED_M = 0.046, 5.7, 0.019
"""Stated for optiodom: at the end of a run, with the measures of its makers (median), and of a free
one after calibration on circles."""


def run(*, quick: bool = False) -> list[Table]:
    """Cost, drift, a sensor that fails, recorded robots."""
    return [
        _cost(quick),
        _drift(10 if quick else 60),
        _failing(4 if quick else 20),
        _husky(),
        _optiodom(),
    ]


def _cost(quick: bool) -> Table:
    """CPU time from the messages of a cycle to the odometry message, beside the bare filter."""
    drives = {
        "2 fixed wheels": differential_drive(),
        **{f"{n} steered wheels": steered_drive(n) for n in (3, 4, 6, 8)},
    }
    actions: list[Callable[[], object]] = [_cycle(config) for config in drives.values()]
    collect_rarely()  # as the service does
    *figures, bare = side_by_side(
        *actions, _bare_filter(), rounds=15 if quick else 60, calls=50, cpu=True
    )
    peer = ("filterpy's predict and update of 9 rows", bare)
    return table(
        "Odometry: CPU of a step with a gyro, all inputs used",
        [
            Figure(name, figure, "µs", peer if name == "4 steered wheels" else None)
            for name, figure in zip(drives, figures, strict=True)
        ]
        + [Figure("4 steered wheels, budget", figures[2], "µs", None, 100.0)],
    )


def _cycle(config: DriveConfig) -> Callable[[], object]:
    """The next cycle of a robot that drives without end, from messages that lie ready."""
    rng = np.random.default_rng(_SEED)
    robot = Robot(config, calibration_errors(rng, len(config.wheels)), rng)
    moments = list(robot.drive(random_path(rng, 4.0, sideways=config.kind == "steered")))
    odometer = Odometer(config, {GYRO: GyroConfig()})
    span = moments[-1].state.stamp - moments[0].state.stamp + 10_000_000
    at = 0

    def cycle() -> None:
        nonlocal at
        moment = moments[at % len(moments)]
        odometer.bus_state(BUS, moment.state)
        odometer.imu(GYRO, moment.sample)
        moment.state.stamp += span
        moment.sample.stamp += span
        at += 1

    return cycle


def _bare_filter() -> Callable[[], object]:
    estimator = ExtendedKalmanFilter(7, 9)
    estimator.x = np.zeros(7)
    rng = np.random.default_rng(_SEED)
    h, noise, z = rng.normal(size=(9, 7)), np.eye(9), np.zeros(9)
    estimator.Q = np.eye(7) * 1e-3

    def step() -> None:
        estimator.predict()
        estimator.update(z, lambda _: h, lambda x: h @ x, R=noise)

    return step


def _drift(runs: int) -> Table:
    cases: dict[str, tuple[Callable[[int], End], float]] = {
        "4 steered wheels, uncalibrated": (partial(_uncalibrated, steered_drive(4)), 0.5),
        "3 steered wheels, uncalibrated": (partial(_uncalibrated, steered_drive(3)), 0.5),
        "differential, uncalibrated": (partial(_uncalibrated, differential_drive()), 0.5),
        "4 steered wheels, calibrated by one run": (_calibrated, 0.2),
        "4 steered wheels, a stuck wheel sensor excluded": (_excluded, 0.5),
    }
    figures = []
    for name, (ends, budget) in cases.items():
        found = [ends(_SEED + seed) for seed in steps(range(runs), name)]
        figures += [
            *_drifts(name, [end.drift for end in found], budget),
            Figure(
                "   heading, rms",
                math.degrees(np.sqrt(np.mean([end.heading**2 for end in found]))),
                "°",
            ),
            *_nees([end.nees for end in found], slips=False),
            Figure("   rejections a step (all are false)", _mean(found, "rejections"), ""),
        ]
    return table(f"Odometry: random paths of 17 m, {runs} runs each", figures)


def _drifts(name: str, shares: list[float], budget: float | None) -> list[Figure]:
    drifts = 100 * np.array(shares)
    return [
        Figure(f"{name}: drift, median", float(np.median(drifts)), "%", None, budget),
        Figure("   drift, 9 of 10 runs below", float(np.quantile(drifts, 0.9)), "%"),
    ]


def _nees(found: list[float], *, slips: bool) -> list[Figure]:
    least, most = _NEES
    mean = float(np.mean(found))
    figures = [Figure("   NEES of the pose, mean (3 is right)", mean, "", None, most)]
    if slips:
        figures.append(Figure("   the same, at least", mean, "", None, least, at_least=True))
    return figures


def _mean(ends: list[End], name: str) -> float:
    return float(np.mean([getattr(end, name) for end in ends]))


def _uncalibrated(config: DriveConfig, seed: int) -> End:
    rng = np.random.default_rng(seed)
    return ride(config, calibration_errors(rng, len(config.wheels)), rng)


def _calibrated(seed: int) -> End:
    rng = np.random.default_rng(seed)
    config = steered_drive(4)
    errors = calibration_errors(rng, 4)
    return ride(calibrated(config, errors, rng), errors, rng, true_config=config)


def _excluded(seed: int) -> End:
    rng = np.random.default_rng(seed)
    errors = calibration_errors(rng, 4)
    return ride(steered_drive(4), errors, rng, excluded=[component.wheel_drive("w1")], stuck=1)


@dataclass(frozen=True)
class _Way:
    """How :data:`_LENGTH_M` ended.

    Attributes:
        drift, nees: As in :class:`End`.
        taken_out_s: From when the sensor failed until the diagnoser had it excluded as a sensor;
            infinite if it never did.
    """

    drift: float
    nees: float
    taken_out_s: float


class _Robot:
    """A robot on four steered wheels whose diagnoser tells its odometry what not to believe."""

    def __init__(self, physics: Physics, seed: str) -> None:
        build = Build.drawn(Random(f"{seed}/build"))
        self.rig = Rig.of(seed, physics=physics, build=build, shown=False)
        self.poses: dict[int, Floats] = {}
        self.excluded_ns: dict[tuple[str, str], int] = {}  # component and class, when first
        self._odometer = Odometer(self.rig.config, {GYRO: GyroConfig()})

    def drive(self, twists: Floats) -> Odometry:
        """The odometry has the messages of a cycle before what the diagnoser says of them."""
        rig, odometer, last = self.rig, self._odometer, None
        for twist in twists:
            told = rig.exclusions
            cycle = rig.cycle(twist)
            self.poses[cycle.state.stamp] = cycle.pose
            for message in (
                *odometer.imu(rig.simulation.gyro, cycle.imu),
                *odometer.bus_state(rig.simulation.bus, cycle.state),
            ):
                if isinstance(message, Odometry):
                    last = message
            if rig.exclusions is not None and rig.exclusions is not told:
                odometer.exclusions(rig.exclusions)
                for each in rig.exclusions.excluded:
                    self.excluded_ns.setdefault((each.component, each.fault), cycle.state.stamp)
        if last is None:
            raise RuntimeError("no step was made")
        return last

    def set_pose(self, last: Odometry) -> None:
        """To where it is."""
        x, y, theta = self.poses[last.stamp].tolist()
        request = OdometryRequest(operation="set_pose", x=x, y=y, theta=theta)
        self._odometer.request(request, last.stamp)

    def off(self, last: Odometry) -> tuple[Floats, Floats]:
        """Error of the pose, and its covariance."""
        off = np.array([last.x, last.y, last.theta]) - self.poses[last.stamp]
        off[2] = math.remainder(off[2], math.tau)
        return off, np.reshape(last.pose_covariance, (3, 3))


def _failing(robots: int) -> Table:
    """A sensor fails on the way; beside it, the same robots with a sound one."""
    ways: dict[str, Physics] = {"no contact physics": "fast", "MuJoCo": "mujoco"}
    figures = []
    for name, physics in ways.items():
        for fails in (True, False):
            what = f"{name}, {'its sensor sticks' if fails else 'all sensors sound'}"
            found = [_way(physics, fails, _SEED + seed) for seed in steps(range(robots), what)]
            figures += [
                *_drifts(what, [way.drift for way in found], 0.5),
                *_nees([way.nees for way in found], slips=True),
            ]
            if fails:
                taken_out_s = [way.taken_out_s for way in found]
                share = 100 * float(np.mean(np.isfinite(taken_out_s)))
                figures += [
                    Figure("   excluded as a sensor", share, "%", None, 99.5, at_least=True),
                    Figure("   after, median", 1000 * float(np.median(taken_out_s)), "ms"),
                ]
    title = "Odometry: random paths of 17 m, a wheel sensor fails on the way, diagnosis excludes it"
    return table(f"{title}, {robots} robots each", figures)


def _way(physics: Physics, fails: bool, seed: int) -> _Way:
    rng, name = np.random.default_rng(seed), f"odometry/{physics}/{seed}"
    robot, wheel = _Robot(physics, name), "w1"
    robot.set_pose(robot.drive(random_path(rng, _LEARN_M)))
    path = random_path(rng, _LENGTH_M)
    onset = round(rng.uniform(0.2, 0.6) * len(path))
    robot.drive(path[:onset])
    robot.excluded_ns.clear()
    begin_ns = robot.rig.now_ns
    if fails:
        robot.rig.inject("drive_sensor_stuck", wheel)
    off, covariance = robot.off(robot.drive(path[onset:]))
    out_ns = robot.excluded_ns.get((component.wheel_drive(wheel), "sensor"), math.inf)
    return _Way(
        math.hypot(off[0], off[1]) / _LENGTH_M,
        float(off @ np.linalg.solve(covariance, off)),
        (out_ns - begin_ns) / 1e9,
    )


def _absent(title: str, path: Path, figures: list[str]) -> Table:
    """What was not measured has not passed."""
    missing = [Figure(name, math.nan, "", None, 1.0) for name in figures]
    return table(f"{title}: NOT MEASURED, there is no {path}", missing)


def _husky() -> Table:
    title, names = "Odometry: Husky, skid-steered", ("heading, rms", "heading, median")
    if not HUSKY.exists():
        return _absent(title, HUSKY, [*names])
    windows = husky()
    each = (windows.fused, windows.gyro)
    rms = [math.degrees(np.sqrt(np.mean(off**2))) for off in each]
    median = [math.degrees(np.median(np.abs(off))) for off in each]
    return table(
        f"{title}, 603 windows of 2 s",
        [
            Figure(name, fused, "°", ("gyro alone", alone), 1.2)
            for name, (fused, alone) in zip(names, (rms, median), strict=True)
        ],
    )


def _optiodom() -> Table:
    """The circles alone calibrate it; then each run is held against what is stated.

    The stated median of the nominal measures is of other runs than these four, on which dead
    reckoning by hand has 0.048 m and 4.6°, too.
    """
    title = "Odometry: optiodom, differential, wheels alone, calibrated on circles"
    runs = {
        "free": ("free_030120210001_run-01", _CALIBRATED_M),
        "square": ("square_230620202042_run-01", _NOMINAL_M),
        "circle 1 (calibrated on it)": ("circular_231220200121_run-01", _NOMINAL_M),
        "circle 2 (calibrated on it)": ("circular_231220200121_run-02", _NOMINAL_M),
    }
    if not OPTIODOM.exists():
        return _absent(title, OPTIODOM, [*runs])
    nominal, better = optiodom_nominal(), optiodom_calibrated()
    figures, plain = [], []
    for name, (run_name, limit) in runs.items():
        recorded = optiodom_run(run_name)
        position, heading = optiodom_end(better, recorded)
        plain.append(optiodom_end(nominal, recorded))
        off, turned = abs(math.degrees(heading)), abs(math.degrees(plain[-1][1]))
        figures += [
            Figure(f"{name}: end error, calibrated", position, "m", None, limit),
            Figure("   the same, nominal measures", plain[-1][0], "m"),
            Figure("   heading, calibrated", off, "°", None, _NOMINAL_DEG),
            Figure("   the same, nominal measures", turned, "°"),
        ]
    middle, turned = np.median(np.abs(plain), axis=0).tolist()
    figures += [
        Figure("all four, nominal measures: median", middle, "m", ("stated", _NOMINAL_M), 1.0),
        Figure("   heading", math.degrees(turned), "°", ("stated", _NOMINAL_DEG), 1.0),
    ]
    return table(title, figures)
