"""Odometry: cost of a step, drift on random paths, and recorded robots against their baselines.

The simulated robots do not slip: their errors are those of calibration (0.2° and 0.3 % of each
wheel), encoder steps, and a gyro with noise and bias. Seeds are not those of the tests.
"""

# ruff: noqa: E402
import math
from collections.abc import Callable
from functools import partial

from wackel_node.algebra import single_threaded

single_threaded()  # as the service does

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from rich.table import Table

from tests.bench.progress import steps
from tests.bench.result import Figure, side_by_side, table
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
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_node.garbage import collect_rarely
from wackel_odometry.core import Odometer
from wackel_schemas import component

_SEED = 100_000


def run(*, quick: bool = False) -> list[Table]:
    """Cost, drift, recorded robots."""
    return [_cost(quick), _drift(10 if quick else 60), *_recorded()]


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
    cases: dict[str, tuple[Callable[[int], End], float | None]] = {
        "4 steered wheels, uncalibrated": (partial(_uncalibrated, steered_drive(4)), 0.5),
        "3 steered wheels, uncalibrated": (partial(_uncalibrated, steered_drive(3)), 0.5),
        "differential, uncalibrated": (partial(_uncalibrated, differential_drive()), None),
        "4 steered wheels, calibrated by one run": (_calibrated, 0.2),
        "4 steered wheels, a stuck wheel sensor excluded": (_excluded, 0.5),
    }
    figures = []
    for name, (ends, budget) in cases.items():
        found = [ends(_SEED + seed) for seed in steps(range(runs), name)]
        drifts = 100 * np.array([end.drift for end in found])
        figures += [
            Figure(f"{name}: drift, median", float(np.median(drifts)), "%", None, budget),
            Figure("   drift, 9 of 10 runs below", float(np.quantile(drifts, 0.9)), "%"),
            Figure(
                "   heading, rms",
                math.degrees(np.sqrt(np.mean([end.heading**2 for end in found]))),
                "°",
            ),
            Figure("   NEES of the pose, mean (3 is right)", _mean(found, "nees"), ""),
            Figure("   rejections a step (all are false)", _mean(found, "rejections"), ""),
        ]
    return table(f"Odometry: random paths of 17 m, {runs} runs each", figures)


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


def _recorded() -> list[Table]:
    found = []
    if HUSKY.exists():
        windows = husky()
        rms = {n: np.sqrt(np.mean(e**2)) for n, e in (("fused", windows.fused), ("", windows.gyro))}
        median = [float(np.median(np.abs(each))) for each in (windows.fused, windows.gyro)]
        found.append(
            table(
                "Odometry: Husky, skid-steered, 603 windows of 2 s",
                [
                    Figure(
                        "heading, rms",
                        math.degrees(rms["fused"]),
                        "°",
                        ("gyro alone", math.degrees(rms[""])),
                        1.2,
                    ),
                    Figure(
                        "heading, median",
                        math.degrees(median[0]),
                        "°",
                        ("gyro alone", math.degrees(median[1])),
                        1.2,
                    ),
                ],
            )
        )
    if OPTIODOM.exists():
        found.append(_optiodom())
    return found


def _optiodom() -> Table:
    nominal, better = optiodom_nominal(), optiodom_calibrated()
    figures = []
    for name, run_name, limit in (
        ("free", "free_030120210001_run-01", 0.019),
        ("square", "square_230620202042_run-01", None),
        ("circle 1 (calibrated on it)", "circular_231220200121_run-01", None),
        ("circle 2 (calibrated on it)", "circular_231220200121_run-02", None),
    ):
        recorded = optiodom_run(run_name)
        position, heading = optiodom_end(better, recorded)
        plain, plain_heading = optiodom_end(nominal, recorded)
        figures += [
            Figure(f"{name}: end error, nominal measures", plain, "m"),
            Figure(f"{name}: end error, calibrated", position, "m", None, limit),
            Figure("   heading, nominal", math.degrees(abs(plain_heading)), "°"),
            Figure("   heading, calibrated", math.degrees(abs(heading)), "°"),
        ]
    return table("Odometry: optiodom, differential, wheels alone, calibrated on circles", figures)
