"""The filter's model, and that its covariance is the one of its errors (NEES, NIS)."""

import copy
import math

import numpy as np
import pytest

from wackel_kinematics.array import Floats
from wackel_kinematics.planar import compose, exponential
from wackel_odometry.filter import AGILITY, BIAS_TIME_S, FIRST_BIAS, TWIST, PlanarFilter

DT = 0.01
BIAS_SIGMA, STABILITY, GYRO_SIGMA = 0.03, 0.0003, 0.002
ROWS = np.array(
    [[1.0, 0.0, -0.2], [1.0, 0.0, 0.2], [0.0, 1.0, 0.3], [0.0, 1.0, -0.3], [0.6, 0.8, 0.1]]
)


def a_filter() -> PlanarFilter:
    return PlanarFilter(np.array([BIAS_SIGMA]), np.array([STABILITY]))


def test_a_known_twist_moves_the_pose_along_its_arc() -> None:
    estimator = a_filter()
    twist = np.array([0.5, -0.2, 1.5])
    estimator.x[TWIST] = twist
    estimator.seconds = 0.4
    estimator.predict()
    assert estimator.x[:3] == pytest.approx(exponential(twist * 0.4))


@pytest.mark.parametrize("omega", [0.0, 1e-9, 0.7, -12.0])
def test_the_jacobian_is_the_derivative_of_the_prediction(omega: float) -> None:
    def predicted(x: Floats) -> Floats:
        return np.concatenate([compose(x[:3], exponential(x[3:6] * DT)), x[3:]])

    estimator = a_filter()
    x = np.array([1.0, 2.0, 0.7, 0.5, -0.3, omega, 0.01])
    estimator.x = x.copy()
    estimator.seconds = DT
    estimator.predict()
    for i in range(len(x)):
        step = np.zeros(len(x))
        step[i] = 1e-6
        slope = (predicted(x + step) - predicted(x - step)) / 2e-6
        # The turn of the chord is taken at the middle heading, to second order of ω dt.
        assert estimator.F[:, i] == pytest.approx(slope, abs=1e-4 * (1 + omega**2) * DT)


def prior() -> tuple[PlanarFilter, Floats, Floats, Floats]:
    """A filter with all states correlated, and measurements."""
    rng = np.random.default_rng(4)
    estimator = a_filter()
    estimator.x = rng.normal(size=7)
    root = rng.normal(size=(7, 7))
    estimator.P = root @ root.T
    return estimator, rng.normal(size=5), rng.normal(size=(5, 7)), rng.uniform(0.1, 1.0, 5)


def test_a_correction_is_that_of_filterpy() -> None:
    estimator, z, h, variance = prior()
    reference = copy.deepcopy(estimator)
    reference.update(z, lambda _: h, lambda x: h @ x, R=np.diag(variance))
    estimator.correct(estimator.expect(z, h), np.diag(variance), learn_bias=True)
    assert estimator.x == pytest.approx(reference.x)
    np.testing.assert_allclose(estimator.P, reference.P)


def test_considering_the_bias_is_josephs_form_with_its_gain_left_out() -> None:
    estimator, z, h, variance = prior()
    x, covariance = estimator.x.copy(), estimator.P.copy()
    gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + np.diag(variance))
    gain[FIRST_BIAS:] = 0.0
    rest = np.eye(7) - gain @ h
    estimator.correct(estimator.expect(z, h), np.diag(variance), learn_bias=False)
    assert estimator.x == pytest.approx(x + gain @ (z - h @ x))
    joseph = rest @ covariance @ rest.T + gain * variance @ gain.T
    np.testing.assert_allclose(estimator.P, joseph)


def test_while_the_robot_moves_its_wheels_cannot_bend_the_bias() -> None:
    estimator = a_filter()
    gyro = np.zeros((1, 7))
    gyro[0, 5] = gyro[0, FIRST_BIAS] = 1.0
    wheels = np.zeros((1, 7))
    wheels[0, 5] = 1.0
    h = np.concatenate([gyro, wheels])
    for _ in range(100):
        estimator.seconds = DT
        estimator.predict()
        estimator.correct(
            estimator.expect(np.array([0.05, 0.0]), h), 1e-6 * np.eye(2), learn_bias=False
        )
    assert estimator.x[FIRST_BIAS] == 0.0
    assert estimator.P[FIRST_BIAS, FIRST_BIAS] >= BIAS_SIGMA**2
    estimator.correct(estimator.expect(np.array([0.05, 0.0]), h), 1e-6 * np.eye(2), learn_bias=True)
    assert estimator.x[FIRST_BIAS] == pytest.approx(0.05, rel=0.01)


def test_a_bias_learned_at_rest_mends_the_heading_that_it_has_bent() -> None:
    """What Schmidt's filter keeps: how heading and bias are correlated."""
    estimator = a_filter()
    gyro = np.zeros((1, 7))
    gyro[0, 5] = gyro[0, FIRST_BIAS] = 1.0
    for _ in range(100):
        estimator.seconds = DT
        estimator.predict()
        estimator.correct(
            estimator.expect(np.array([0.05]), gyro), np.diag([1e-8]), learn_bias=False
        )
    assert estimator.x[2] == pytest.approx(0.05, rel=0.05)
    rest = np.zeros((1, 7))
    rest[0, 5] = 1.0
    estimator.predict()
    both = np.concatenate([rest, gyro])
    estimator.correct(
        estimator.expect(np.array([0.0, 0.05]), both), np.diag([1e-10, 1e-8]), learn_bias=True
    )
    assert estimator.x[FIRST_BIAS] == pytest.approx(0.05, rel=0.05)
    assert estimator.x[2] == pytest.approx(0.0, abs=0.005)


def test_a_state_that_is_none_is_noticed() -> None:
    for spoil in (math.nan, math.inf, 1e9):
        estimator = a_filter()
        assert estimator.estimate().sound
        estimator.x[4] = spoil
        assert not estimator.estimate().sound
    estimator.restart()
    assert estimator.estimate().sound
    estimator.P[0, 0] = -1.0
    assert not estimator.estimate().sound


def test_errors_are_as_large_as_the_covariance_says() -> None:
    """NEES and NIS over 100 runs with the filter's own noise, within 99.9 % bounds of χ².

    The runs are short and turn slowly: over long ones, linearisation alone breaks the equality.
    """
    rng = np.random.default_rng(7)
    runs, steps = 100, 60
    wheel_sigma = 0.01
    gyro = np.zeros((1, 7))
    gyro[0, 5] = gyro[0, FIRST_BIAS] = 1.0
    wheels = np.concatenate([np.zeros((5, 3)), ROWS, np.zeros((5, 1))], axis=1)
    h = np.concatenate([wheels, gyro])
    variance = np.array([wheel_sigma**2] * 5 + [GYRO_SIGMA**2])
    walk = np.sqrt(AGILITY * DT)
    nees, nis = [], []
    for _ in range(runs):
        estimator = a_filter()
        pose, twist, bias = np.zeros(3), np.zeros(3), rng.normal(0.0, BIAS_SIGMA)
        for _ in range(steps):
            twist = twist + rng.normal(size=3) * walk
            pose = compose(pose, exponential(twist * DT))
            bias += rng.normal(0.0, STABILITY * math.sqrt(DT / BIAS_TIME_S))
            truth = np.concatenate([pose, twist, [bias]])
            z = h @ truth + rng.normal(size=6) * np.sqrt(variance)
            estimator.seconds = DT
            estimator.predict()
            innovation = z - h @ estimator.x
            expected = h @ estimator.P @ h.T + np.diag(variance)
            nis.append(float(innovation @ np.linalg.solve(expected, innovation)))
            estimator.correct(estimator.expect(z, h), np.diag(variance), learn_bias=True)
        error = estimator.x - truth
        nees.append(float(error @ np.linalg.solve(estimator.P, error)))
    # χ² of k degrees of freedom has mean k and variance 2 k; 3.29 σ are 99.9 %.
    assert np.mean(nees) == pytest.approx(7.0, abs=3.29 * math.sqrt(2 * 7 / runs))
    assert np.mean(nis) == pytest.approx(6.0, abs=3.29 * math.sqrt(2 * 6 / (runs * steps)))
