"""Stamps never run backwards, and follow a wall clock that was set."""

import time

import pytest

from wackel_node.clock import Clock


def test_stamps_are_utc_and_never_run_backwards() -> None:
    clock = Clock()
    stamps = [clock.now_ns() for _ in range(1000)]
    assert stamps == sorted(stamps)
    assert abs(stamps[-1] - time.time_ns()) < 1_000_000_000


def test_both_hands_of_an_instant_show_the_same_moment() -> None:
    clock = Clock()
    instant = clock.instant()
    assert clock.stamp_ns(instant.monotonic_ns) == instant.utc_ns


def test_a_clock_that_was_set_is_followed_and_one_that_drifts_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    real = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: real() + 50_000_000)
    assert clock.follow() == 0
    year = 365 * 86400 * 1_000_000_000
    monkeypatch.setattr(time, "time_ns", lambda: real() + year)
    assert abs(clock.follow() - year) < 1_000_000_000
    assert abs(clock.now_ns() - real() - year) < 1_000_000_000
    assert clock.follow() == 0
