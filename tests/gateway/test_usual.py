"""When an answer departs from what is usual, and how long that is news."""

from random import Random

from hypothesis import given
from hypothesis import strategies as st

from wackel_gateway.usual import Usual


def learned(seed: int = 1) -> Usual:
    usual, random = Usual(), Random(seed)
    for _ in range(50):
        usual.departs(round(random.gauss(500_000, 12_000)))
    return usual


def test_the_scatter_of_a_quiet_host_does_not_depart() -> None:
    random = Random(2)
    usual = learned()
    assert not any(usual.departs(round(random.gauss(500_000, 12_000))) for _ in range(10_000))


def test_a_single_outlier_departs_once_and_changes_nothing() -> None:
    usual = learned()
    assert usual.departs(3_000_000)
    assert not usual.departs(500_000)
    assert usual.departs(800_000)
    assert usual.outliers == 2


def test_a_change_that_stays_departs_a_few_times_and_is_usual_then() -> None:
    for changed in (800_000, 250_000):
        usual = learned()
        departures = [usual.departs(changed) for _ in range(30)]
        assert sum(departures) == 8
        assert not any(departures[9:])


def test_answers_of_an_adapter_that_holds_them_back_soon_are_usual() -> None:
    random = Random(3)
    usual = learned()
    departures = sum(usual.departs(random.randrange(500_000, 16_500_000)) for _ in range(1000))
    assert departures < 60


@given(st.lists(st.integers(0, 10**10), max_size=200))
def test_whatever_comes_is_followed_up_a_limited_number_of_times(samples: list[int]) -> None:
    usual = Usual()
    in_row = 0
    for sample in samples:
        in_row = in_row + 1 if usual.departs(sample) else 0
        assert in_row <= 8
