"""The bank against the same likelihood written down plainly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wackel_diagnoser.bank import WIDE, Bank
from wackel_kinematics.array import Floats


def plainly(z: Floats, h: Floats, variance: Floats) -> float:
    """ln p(z), with the twist integrated out."""
    weight = np.diag(1.0 / variance)
    normal = h.T @ weight @ h + WIDE * np.eye(3)
    twist = np.linalg.solve(normal, h.T @ weight @ z)
    misfit = z @ weight @ z - twist @ normal @ twist
    return float(-0.5 * (np.log(variance).sum() + np.linalg.slogdet(normal)[1] + misfit))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(4, 20), st.integers(2, 12))
def test_likelihoods_are_those_of_the_definition(seed: int, rows: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    z, h = rng.normal(size=rows), rng.normal(size=(rows, 3))
    h[rows // 2 :] *= rng.integers(0, 2)  # rows that are none on the twist
    variance = rng.uniform(0.01, 2.0, rows)
    size = rng.uniform(0.0, 2.0, rows)
    spread = rng.uniform(0.0, 4.0, (count, rows)) * rng.integers(0, 2, (count, rows))
    spread[0] = 0.0
    found = Bank(spread).evaluate(z, h, variance, size)
    expected = [plainly(z, h, variance + each * size**2) for each in spread]
    assert found - found[0] == pytest.approx(np.array(expected) - expected[0], abs=1e-6)


def test_covariance_and_estimate_are_those_of_nothing_wrong() -> None:
    rng = np.random.default_rng(1)
    z, h, variance = rng.normal(size=9), rng.normal(size=(9, 3)), rng.uniform(0.1, 1.0, 9)
    bank = Bank(np.zeros((2, 9)))
    bank.evaluate(z, h, variance, np.ones(9))
    normal = h.T @ np.diag(1 / variance) @ h + WIDE * np.eye(3)
    assert bank.covariance() == pytest.approx(np.linalg.inv(normal))
    assert bank.covariance() @ bank.right() == pytest.approx(
        np.linalg.solve(normal, h.T @ (z / variance))
    )
