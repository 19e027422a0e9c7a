"""Calibration from runs whose true path is known."""

import numpy as np
import pytest
from msgspec.structs import replace

from tests.odometry.runs import calibrated, recorded
from tests.odometry.simulation import Errors, differential_drive, steered_drive
from wackel_kinematics.planar import compose, exponential
from wackel_node.config_drive import DriveConfig
from wackel_odometry.calibration import Run, calibrate, fit, misses, path, uncertainty


def test_a_calibrated_drive_leads_along_paths_that_it_has_not_seen() -> None:
    errors = Errors(np.array([0.004, -0.003, 0.002]), np.array([0.006, -0.004, 0.003]))
    config, rng = steered_drive(3), np.random.default_rng(1)
    found = calibrated(config, errors, rng)
    fresh = recorded(config, errors, rng, noise=0.0)

    def off(drive: DriveConfig) -> float:
        return float(np.median(np.abs(misses(drive, fresh, stretch=500))[:, :2]))

    assert off(found) < 0.7 * off(config)


def curved_run(left: float, right: float, track: float) -> Run:
    """A robot with these radii and this track; turns to both sides."""
    rng = np.random.default_rng(2)
    rolled = 0.2 + 0.1 * np.sin(np.arange(2000)[:, None] / (150.0, 170.0)) + rng.normal(0, 0.01)
    poses = [np.zeros(3)]
    for a, b in rolled:
        way = np.array([(left * a + right * b) / 2, 0.0, (right * b - left * a) / track])
        poses.append(compose(poses[-1], exponential(way)))
    return Run(np.array(poses), rolled, np.zeros_like(rolled))


def test_a_differential_drive_gets_radii_and_track() -> None:
    run = curved_run(0.0502, 0.0499, 0.41)
    found = calibrate(differential_drive(track=0.4, radius=0.05), [run], stretch=200)
    assert [wheel.radius for wheel in found.wheels] == pytest.approx([0.0502, 0.0499], rel=1e-3)
    assert found.track == pytest.approx(0.41, rel=2e-3)


def test_what_a_run_does_not_tell_stays_as_it_was() -> None:
    rolled = np.full((1000, 2), 0.1)
    x = 0.005 * np.arange(1001)
    run = Run(np.stack([x, 0 * x, 0 * x], axis=-1), rolled, 0 * rolled)
    config = differential_drive(track=0.4, radius=0.05)
    found, known = fit(config, [run], stretch=100), uncertainty(config)
    assert found.config.track == pytest.approx(0.4)
    assert [wheel.radius for wheel in found.config.wheels] == pytest.approx([0.05, 0.05])
    assert found.sigma["track"] == pytest.approx(known["track"])
    assert found.sigma["left.radius"] < 0.9 * known["left.radius"]


def test_where_the_path_is_not_known_nothing_is_compared() -> None:
    run = curved_run(0.0502, 0.0499, 0.41)
    run.poses[1:300] = run.poses[301:1000] = np.nan
    assert run.moments(200) == [0, 300, 1000, 1200, 1400, 1600, 1800, 2000]
    found = calibrate(differential_drive(track=0.4, radius=0.05), [run], stretch=200)
    assert [wheel.radius for wheel in found.wheels] == pytest.approx([0.0502, 0.0499], rel=1e-3)


def test_parts_of_a_run_are_the_run() -> None:
    run, config = curved_run(0.0502, 0.0499, 0.41), differential_drive(track=0.4, radius=0.05)
    parts = run.part(0, 1000), run.part(1000, 2000)
    whole = misses(config, run, stretch=200)
    assert np.concatenate([misses(config, part, 200) for part in parts]) == pytest.approx(whole)


def test_the_path_of_a_stretch_is_seen_from_its_beginning() -> None:
    run = curved_run(0.05, 0.05, 0.4)
    ends = path(differential_drive(track=0.4, radius=0.05), run, [0, 300, 400])
    assert compose(run.poses[300], ends[1]) == pytest.approx(run.poses[400], abs=1e-6)


@pytest.mark.parametrize(
    "change",
    [
        {"poses": np.full((2001, 3), np.nan)},
        {"poses": np.zeros((7, 3))},
        {"rolled": np.zeros((2000, 3))},
        {"heading": np.full((2000, 2), np.inf)},
    ],
)
def test_a_run_that_is_none_is_refused(change: dict[str, np.ndarray]) -> None:
    good = curved_run(0.05, 0.05, 0.4)
    fields = {"poses": good.poses, "rolled": good.rolled, "heading": good.heading}
    run = Run(**{**fields, **change})
    with pytest.raises(ValueError, match="a run holds"):
        calibrate(differential_drive(), [run], stretch=100)


def test_a_run_shorter_than_a_stretch_is_refused() -> None:
    with pytest.raises(ValueError, match="shorter than a stretch"):
        calibrate(differential_drive(), [curved_run(0.05, 0.05, 0.4)], stretch=3000)


def test_nothing_but_the_measures_is_changed() -> None:
    config = differential_drive(track=0.4, radius=0.05)
    found = calibrate(config, [curved_run(0.05, 0.05, 0.4)], stretch=100)
    restored = [
        replace(new, radius=old.radius)
        for new, old in zip(found.wheels, config.wheels, strict=True)
    ]
    assert replace(found, wheels=restored, track=None) == config
