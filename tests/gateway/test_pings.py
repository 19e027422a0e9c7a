from collections import Counter

from wackel_gateway.pings import Pings
from wackel_gateway.presence import Chain, Presence
from wackel_gateway.roster import Member
from wackel_node.config import ServoConfig


def chain(*ids: int) -> Chain:
    return {
        servo_id: Presence(Member(ServoConfig(id=servo_id)), place)
        for place, servo_id in enumerate(ids)
    }


def pinged(pings: Pings, count: int) -> list[int]:
    """The silent servos that are pinged next, none of which answers."""
    ids = []
    for _ in range(count):
        job = pings.next_silent(0)
        assert job is not None
        pings.missed(job.ids[0])
        ids.append(job.ids[0])
    return ids


def all_silent(servos: Chain) -> Pings:
    pings = Pings(servos)
    while (job := pings.next_fresh(0)) is not None:
        pings.missed(job.ids[0])
    return pings


def test_at_the_start_all_are_pinged_in_cable_order() -> None:
    pings = Pings(chain(3, 1, 2))
    jobs = [pings.next_fresh(0) for _ in range(4)]
    assert [job and job.ids for job in jobs] == [(3,), (1,), (2,), None]


def test_one_that_must_wait_lets_the_others_go_first() -> None:
    servos = chain(1, 2)
    servos[1].not_before_ns = 100
    pings = Pings(servos)
    first, second = pings.next_fresh(50), pings.next_fresh(50)
    assert first is not None
    assert first.ids == (2,)
    assert second is None
    third = pings.next_fresh(100)
    assert third is not None
    assert third.ids == (1,)


def test_those_whose_silence_tells_most_come_first_until_they_are_convicted() -> None:
    servos = chain(1, 2, 3, 4, 5)
    pings = all_silent(servos)
    servos[3].present = True
    pings.silent.remove(3)
    # 1 and 2 have one behind them that answers, and 4 is the first of those at the end.
    assert Counter(pinged(pings, 9)) == {1: 3, 2: 3, 4: 3}
    assert Counter(pinged(pings, 8)) == {1: 2, 2: 2, 4: 2, 5: 2}


def test_an_answer_makes_all_silent_ones_fresh_again() -> None:
    pings = all_silent(chain(1, 2, 3))
    pings.silent.remove(2)
    pings.answered(2)
    assert list(pings.fresh) == [1, 3]
    assert not pings.silent


def test_who_waits_already_is_not_queued_twice() -> None:
    pings = all_silent(chain(1, 2))
    pings.add(1)
    assert not pings.fresh
    pings.silent.remove(1)
    pings.answered(1)
    pings.add(1)
    assert list(pings.fresh) == [2, 1]


def test_after_a_restart_nobody_is_convicted() -> None:
    servos = chain(1, 2, 3)
    pings = all_silent(servos)
    pinged(pings, 12)
    pings.restart()
    while (job := pings.next_fresh(0)) is not None:
        pings.missed(job.ids[0])
    # None answers, so the first one's silence tells most.
    assert pinged(pings, 4) == [1, 1, 1, 2]
