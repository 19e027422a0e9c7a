from random import Random

import pytest

from wackel_classifier.loss import LossTest, threshold, wilson

ORDINARY = 0.001


def test_wilson_bounds_are_those_of_the_textbook() -> None:
    # Newcombe 1998, table I: 81 of 263 and 15 of 148.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)


def test_without_trials_every_rate_is_possible() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


def test_ordinary_loss_raises_no_alarm_in_a_hundred_hours() -> None:
    random = Random(1)
    test = LossTest(ORDINARY, threshold(20 * 3600, 0.001))
    # 100 requests a slot are what 20 servos get at 100 Hz; losses are few, so drawn by their gaps.
    slots, slot = 100 * 3600 * 20 // 100, 0  # a hundredth of the slots at a hundredfold weight
    while slot < slots:
        failures = sum(random.random() < ORDINARY for _ in range(100))
        test.add(failures, 100 - failures)
        assert not test.alarmed
        slot += 1


def test_noticeable_loss_raises_it_within_seconds() -> None:
    random = Random(2)
    test = LossTest(ORDINARY, threshold(20 * 3600, 0.001))
    slots = 0
    while not test.alarmed:
        failures = sum(random.random() < 0.05 for _ in range(5))  # one servo at 100 Hz
        test.add(failures, 5 - failures)
        slots += 1
    assert slots < 5 * 20


def test_an_alarm_ends_when_the_loss_does() -> None:
    test = LossTest(ORDINARY, 20.0)
    test.add(20, 0)
    assert test.alarmed
    for _ in range(100):
        test.add(0, 100)
    assert not test.alarmed


def test_a_rarer_false_alarm_needs_more_evidence() -> None:
    assert threshold(72_000, 0.0001) > threshold(72_000, 0.001)
