from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_classifier.loose_contact import (
    Cause,
    Event,
    FailureWindow,
    Mark,
    evenness,
    judge,
)


def test_the_thesis_worked_example_is_as_even_as_printed() -> None:
    assert evenness(12, 5, 4 + 1 + 3 + 1 + 1) == pytest.approx(0.571, abs=5e-4)


def test_a_window_fed_with_the_worked_example_gives_its_rate_and_evenness() -> None:
    window = FailureWindow(12)
    for sample, answered in enumerate([1, 0, 1, 1, 1, 0, 0, 1, 1, 0, 0, 0]):
        if not answered:
            window.fail(sample)
    window.expire(11)
    assert window.rate == pytest.approx(0.5)
    assert window.evenness == pytest.approx(0.571, abs=5e-4)


def test_failures_in_one_lump_are_not_even_at_all() -> None:
    window = FailureWindow(200)
    for sample in range(100, 120):
        window.fail(sample)
    assert window.evenness == 0.0


def test_failures_as_far_apart_as_possible_are_nearly_wholly_even() -> None:
    window = FailureWindow(200)
    for sample in range(0, 200, 10):
        window.fail(sample)
    assert window.evenness > 0.85


def test_two_failures_say_nothing_about_evenness() -> None:
    window = FailureWindow(200)
    window.fail(1)
    window.fail(100)
    assert window.evenness == 0.0


@given(st.lists(st.integers(0, 400), unique=True).map(sorted))
def test_the_window_kept_up_to_date_equals_one_counted_anew(samples: list[int]) -> None:
    window = FailureWindow(100)
    for sample in samples:
        window.fail(sample)
        window.expire(sample)
    kept = [sample for sample in samples if samples and sample > samples[-1] - 100]
    distances = [b - a for a, b in pairwise(kept)]
    assert len(window) == len(kept)
    assert window.rate == pytest.approx(len(kept) / 100)
    assert window.evenness == pytest.approx(evenness(100, len(distances), sum(distances)))


def test_losses_that_come_together_are_bursts_and_regular_ones_are_not() -> None:
    bursts, scattered = FailureWindow(200), FailureWindow(200)
    for sample in (1, 2, 3, 4, 80, 81, 82, 83, 160, 161, 162, 163):
        bursts.fail(sample)
    for sample in range(0, 200, 15):
        scattered.fail(sample)
    assert bursts.bursts
    assert not scattered.bursts


def silent(position: int, *, first: bool = False) -> Event:
    return Event(position, Mark.QUIET, run=True, alone=False, first=first)


def test_silence_from_one_servo_on_is_the_cable_that_leads_to_it() -> None:
    verdict = judge(Counter({silent(4): 9, silent(6): 2}), 10, 0.05)
    assert verdict is not None
    assert (verdict.cause, verdict.places) == (Cause.CONTACT, (4,))
    assert verdict.confidence > 0.95


def test_a_few_ordinary_losses_nearer_to_the_adapter_do_not_move_the_place() -> None:
    ordinary = Event(1, Mark.DAMAGED, run=False, alone=False, first=False)
    verdict = judge(Counter({silent(4): 12, ordinary: 2}), 10, 0.15)
    assert verdict is not None
    assert (verdict.cause, verdict.places) == (Cause.CONTACT, (4,))


def test_one_servo_that_is_lost_while_those_behind_it_answer_is_that_servo() -> None:
    lost = Event(4, Mark.QUIET, run=False, alone=False, first=False)
    damaged = Event(4, Mark.DAMAGED, run=False, alone=False, first=False)
    verdict = judge(Counter({lost: 5, damaged: 5}), 10, 0.05)
    assert verdict is not None
    assert (verdict.cause, verdict.places) == (Cause.SERVO, (4,))


def test_damage_of_all_servos_alike_is_the_bus() -> None:
    events = Counter(
        {Event(p, Mark.DAMAGED, run=False, alone=False, first=False): 2 for p in range(10)}
    )
    verdict = judge(events, 10, 0.05)
    assert verdict is not None
    assert verdict.cause is Cause.BUS


def test_two_bad_cables_are_both_named() -> None:
    verdict = judge(Counter({silent(2): 12, silent(7): 12}), 10, 0.02)
    assert verdict is not None
    assert set(verdict.places) == {2, 7}


def test_without_failures_there_is_no_verdict() -> None:
    assert judge(Counter(), 10, 0.1) is None


def test_a_second_bad_cable_that_is_possible_stays_a_suspect_until_it_is_refuted() -> None:
    few = judge(Counter({silent(2): 6, silent(7): 2}), 10, 0.02)
    assert few is not None
    assert few.places == (2,)
    assert (Cause.CONTACT, 7) in few.others
    # One more elsewhere behind the first cable makes it less probable, but does not refute it.
    more = judge(Counter({silent(2): 9, silent(7): 2, silent(5): 1}), 10, 0.02)
    assert more is not None
    assert (Cause.CONTACT, 7) in more.with_doubts_of(few).others


def test_ordinary_losses_do_not_make_a_second_bad_cable() -> None:
    ordinary = Event(1, Mark.DAMAGED, run=False, alone=False, first=False)
    verdict = judge(Counter({silent(5): 35, ordinary: 2}), 7, 0.2)
    assert verdict is not None
    assert verdict.places == (5,)
