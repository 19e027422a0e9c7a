"""Which measurements are believed."""

import math

import numpy as np
import pytest

from wackel_odometry.gate import gate

H = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
OPEN = np.eye(2) * 100.0  # a prediction that says next to nothing
NOISE = 0.01 * np.eye(4)


def test_measurements_that_agree_are_all_believed_whatever_was_predicted() -> None:
    verdict = gate(H @ [5.0, -3.0], H @ OPEN @ H.T, NOISE)
    assert all(verdict.accepted)
    assert verdict.innovation == pytest.approx(np.zeros(4), abs=0.02)


def test_the_one_that_contradicts_the_others_is_rejected() -> None:
    innovation = H @ [5.0, -3.0]
    innovation[1] += 2.0
    verdict = gate(innovation, H @ OPEN @ H.T, NOISE)
    assert verdict.accepted == [True, False, True, True]
    assert verdict.innovation[1] == pytest.approx(2.0, abs=0.02)
    assert verdict.sigma[1] == pytest.approx(np.sqrt(0.01 + 0.01 * 2 / 3), rel=0.01)


def test_several_are_rejected_one_after_the_other() -> None:
    innovation = np.array([0.0, 0.01, 0.0, -0.01, 0.0, 3.0, -2.0])
    verdict = gate(innovation, np.full((7, 7), 100.0), 0.01 * np.eye(7))
    assert verdict.accepted == [True] * 5 + [False] * 2


def test_with_nothing_beside_it_the_prediction_decides() -> None:
    for off, believed in ((0.39, True), (0.41, False)):
        verdict = gate(np.array([off]), np.array([[0.0]]), np.array([[0.01]]))
        assert verdict.accepted == [believed]


def test_no_measurement_at_all_is_no_error() -> None:
    verdict = gate(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)))
    assert len(verdict.accepted) == 0


def test_what_is_left_out_is_normal_with_the_sigma_that_is_told() -> None:
    rng = np.random.default_rng(1)
    prior = np.array([[0.5, 0.2], [0.2, 0.3]])
    root = np.linalg.cholesky(prior)
    scaled = []
    for _ in range(2000):
        innovation = H @ root @ rng.normal(size=2) + rng.normal(size=4) * 0.1
        verdict = gate(innovation, H @ prior @ H.T, NOISE)
        scaled.append(np.divide(verdict.innovation, verdict.sigma))
    # The mean of 2000 squares of normal numbers is within 1 ± 4 · √(2 / 2000).
    assert np.mean(np.square(scaled), axis=0) == pytest.approx(np.ones(4), abs=0.13)


def test_where_all_contradict_each_other_none_is_taken_out_if_they_may() -> None:
    innovation = np.array([0.6, -0.7, 0.5, -0.6, 0.7, -0.5, 0.0])
    narrow = gate(innovation, np.full((7, 7), 100.0), 0.01 * np.eye(7))
    assert not all(narrow.accepted)
    wide = gate(innovation, np.full((7, 7), 100.0), 0.01 * np.eye(7), most=1000.0)
    assert all(wide.accepted)
    assert wide.pulled > 40.0
    assert wide.sigma[0] == pytest.approx(math.sqrt(wide.pulled * 0.01 * 7 / 6), rel=0.01)
    most = gate(innovation, np.full((7, 7), 100.0), 0.01 * np.eye(7), most=2.0)
    assert most.pulled == 2.0


def test_one_that_contradicts_all_others_is_taken_out_even_so() -> None:
    innovation = np.array([0.01, 0.0, -0.01, 0.0, 0.01, 0.0, 3.0])
    verdict = gate(innovation, np.full((7, 7), 100.0), 0.01 * np.eye(7), most=1000.0)
    assert verdict.accepted == [True] * 6 + [False]
    assert verdict.pulled == 1.0


def test_what_pulled_of_late_still_counts() -> None:
    verdict = gate(np.zeros(7), np.full((7, 7), 100.0), 0.01 * np.eye(7), before=5.0, most=1000.0)
    assert verdict.pulled == 5.0
    assert gate(np.zeros(7), np.full((7, 7), 100.0), 0.01 * np.eye(7), before=5.0).pulled == 1.0
