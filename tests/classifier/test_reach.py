"""Interruptions that end: which cable, told from who was silent at the same time."""

from tests.classifier.rig import chain
from wackel_classifier.chain import Chain
from wackel_classifier.reach import GONE_NS, NEVER_NS, Interruption, Reach

MS = 1_000_000
LOST = 1e-3


def reach(power: str) -> Reach:
    followed = Reach(Chain("main", chain(6, power=power)))
    followed.heard(range(6), 0)
    return followed


def interrupted(followed: Reach, silent: range, *, asked: range, lasted_ms: int) -> None:
    """Some are silent for so long, asked every 10 ms; the others of ``asked`` answer."""
    for now_ms in range(10, lasted_ms, 10):
        for place in asked:
            if place in silent:
                followed.missed(place, now_ms * MS, now_ms, LOST)
            else:
                followed.answered(place, now_ms * MS)


def test_all_behind_a_cable_were_silent_for_a_moment() -> None:
    followed = reach("adapter")
    interrupted(followed, range(3, 6), asked=range(6), lasted_ms=60)
    followed.answered(3, 60 * MS)
    assert followed.interrupted == Interruption(3, whole=False, lasted_ns=50 * MS)
    assert not followed.waiting


def test_the_cable_is_open_where_the_servo_before_was_not_asked() -> None:
    followed = reach("adapter")
    interrupted(followed, range(2, 6), asked=range(3, 6), lasted_ms=60)
    followed.answered(3, 60 * MS)
    assert followed.interrupted == Interruption(None, whole=False, lasted_ns=50 * MS)


def test_servos_that_start_anew_name_the_cable_behind_them_if_supply_comes_from_there() -> None:
    followed = reach("far")
    interrupted(followed, range(4), asked=range(6), lasted_ms=400)
    followed.answered(0, 400 * MS)
    assert followed.interrupted == Interruption(4, whole=False, lasted_ns=390 * MS)


def test_a_flicker_is_too_short_to_tell_whose_supply_failed() -> None:
    followed = reach("far")
    interrupted(followed, range(4), asked=range(6), lasted_ms=60)
    followed.answered(0, 60 * MS)
    assert followed.interrupted == Interruption(None, whole=False, lasted_ns=50 * MS)


def test_one_servo_that_misses_some_answers_is_no_interruption() -> None:
    followed = reach("adapter")
    interrupted(followed, range(2, 3), asked=range(6), lasted_ms=60)
    followed.answered(2, 60 * MS)
    assert followed.interrupted is None


def test_time_alone_changes_nothing_once_all_is_told() -> None:
    followed = reach("adapter")
    assert followed.findings(0, jammed=False) == []
    assert followed.due_ns == NEVER_NS
    interrupted(followed, range(2, 3), asked=range(6), lasted_ms=100)
    followed.findings(100 * MS, jammed=False)
    assert followed.due_ns == GONE_NS
    interrupted(followed, range(2, 3), asked=range(6), lasted_ms=600)
    findings = followed.findings(600 * MS, jammed=False)
    assert [finding.code for finding in findings] == ["servo_silent"]
    assert followed.due_ns == NEVER_NS


def test_who_is_not_heard_for_a_second_is_told_however_weak_the_evidence() -> None:
    followed = reach("adapter")
    almost_all_lost = 0.95
    for now_ms in range(100, 1200, 100):
        followed.missed(1, now_ms * MS, now_ms, almost_all_lost)
        followed.asked(4, now_ms * MS, now_ms)  # damaged, or without a turn
        followed.heard((0, 2, 3, 5), now_ms * MS)
        told = followed.findings(now_ms * MS, jammed=False)
        assert bool(told) == (now_ms >= 1100), now_ms
    assert [(finding.code, finding.component) for finding in told] == [
        ("servo_unheard", "bus/main/servo/2"),
        ("servo_unheard", "bus/main/servo/5"),
    ]
    followed.heard((4,), 1200 * MS)
    followed.answered(1, 1200 * MS)
    assert followed.findings(1200 * MS, jammed=False) == []


def test_a_servo_whose_silence_has_a_name_is_not_told_twice() -> None:
    for silent, code in ((range(2, 3), "servo_silent"), (range(3, 6), "cable_break")):
        followed = reach("adapter")
        interrupted(followed, silent, asked=range(6), lasted_ms=3000)
        assert [f.code for f in followed.findings(3000 * MS, jammed=False)] == [code]
