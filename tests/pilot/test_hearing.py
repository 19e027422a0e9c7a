"""A robot that says nothing for two seconds is gone; a hiccup is none."""

from wackel_pilot.hearing import LOOK_S, Hearing


def looks(seconds: float) -> int:
    return round(seconds / LOOK_S)


def test_a_bus_that_has_fallen_silent_is_told() -> None:
    hearing = Hearing({"left": 100.0, "right": 100.0})
    for _ in range(looks(10)):
        hearing.heard("left")
        hearing.heard("right")
        assert hearing.look() == []
    quiet = looks(2) - 1  # the latest look has counted, too
    for _ in range(quiet):
        hearing.heard("left")
        assert hearing.look() == []
    hearing.heard("left")
    assert hearing.look() == ["right"]


def test_a_gateway_that_is_restarted_in_time_is_no_silence() -> None:
    hearing = Hearing({"main": 100.0})
    for _ in range(5):
        assert [hearing.look() for _ in range(looks(1.9))] == [[]] * looks(1.9)
        hearing.heard("main")


def test_a_slow_bus_may_be_silent_for_longer() -> None:
    hearing = Hearing({"main": 0.5})
    assert [hearing.look() for _ in range(looks(8))] == [[]] * looks(8)
    assert hearing.look() == ["main"]
