"""A lost port is tried less and less often, and believed once it has spoken or lasted."""

from wackel_gateway.recovery import Recovery

MS = 1_000_000


def test_a_port_that_only_opens_is_tried_less_and_less_often() -> None:
    recovery = Recovery()
    pauses_ms = []
    for second in range(8):
        recovery.opened(second * 1000 * MS)
        assert not recovery.back((second * 1000 + 900) * MS, heard=False)
        pauses_ms.append(recovery.lose() // MS)
    assert pauses_ms == [50, 100, 200, 400, 800, 1000, 1000, 1000]


def test_it_is_back_once_when_it_has_been_heard_or_has_lasted() -> None:
    for passed_ms, heard in ((1, True), (1000, False)):
        recovery = Recovery()
        recovery.lose()
        recovery.lose()
        recovery.opened(0)
        assert recovery.lost
        assert recovery.back(passed_ms * MS, heard=heard)
        assert not recovery.lost
        assert not recovery.back(passed_ms * MS, heard=heard)
        assert recovery.lose() == 50 * MS


def test_what_was_never_lost_does_not_come_back() -> None:
    recovery = Recovery()
    recovery.opened(0)
    assert not recovery.back(5000 * MS, heard=True)
