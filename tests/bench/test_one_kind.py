"""How surely a share is known."""

import pytest
from scipy.stats import binom

from tests.bench.one_kind import bounds


@pytest.mark.parametrize(("count", "of"), [(1, 3), (93, 100), (962, 1000), (1999, 2000)])
def test_what_was_seen_is_as_unlikely_as_said_at_the_bounds(count: int, of: int) -> None:
    low, high = bounds(count, of)
    assert low < count / of < high
    assert binom.sf(count - 1, of, low) == pytest.approx(0.025)
    assert binom.cdf(count, of, high) == pytest.approx(0.025)


def test_none_and_all_leave_one_side_open() -> None:
    assert bounds(0, 10)[0] == 0.0
    assert bounds(0, 10)[1] == pytest.approx(1.0 - bounds(10, 10)[0])
    assert bounds(10, 10)[1] == 1.0
