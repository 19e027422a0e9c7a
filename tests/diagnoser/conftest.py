"""A robot that its diagnoser is acquainted with, from which tests go their own ways."""

import pytest

from tests.diagnoser.rig import SEED, SHORT_WARM_UP_S, Rig


@pytest.fixture(scope="session")
def warm() -> Rig:
    """Not to be changed: each test drives a copy."""
    rig = Rig.of(SEED)
    rig.drive(SHORT_WARM_UP_S)
    assert rig.reports == []
    return rig
