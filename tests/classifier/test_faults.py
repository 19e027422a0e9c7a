"""Each fault on the virtual bus: what the classifier calls it, and where."""

import math

import pytest

from tests.classifier.rig import Rig, chain
from wackel_schemas.bus import ServoGoal
from wackel_schemas.fault_codes import FAULT_CODES

SERVOS = 8


def healthy(seed: int = 1, loss: float = 0.0005, **settings: object) -> Rig:
    rig = Rig(chain(SERVOS, **settings), seed, loss=loss)
    rig.run(1.5)
    assert rig.reports == []
    return rig


@pytest.mark.parametrize(
    ("kind", "servo", "value", "code", "component", "seconds"),
    [
        ("break", 5, None, "cable_break", "cable/4-5", 1.0),
        ("silent", 5, None, "servo_silent", "servo/5", 1.0),
        ("duplicate_id", 5, None, "duplicate_id", "servo/5", 1.0),
        ("power_off", None, None, "lost_signal", "", 1.0),
        ("loose_contact", 5, 8.0, "loose_contact", "cable/4-5", 10.0),
        ("rhythmic_jammer", None, None, "rhythmic_jammer", "", 0.5),
        ("rhythmic_jammer", 3, None, "rhythmic_jammer", "servo/3", 1.0),
        ("permanent_jammer", None, None, "permanent_jammer", "", 0.5),
        ("permanent_jammer", 3, None, "permanent_jammer", "servo/3", 2.0),
        ("noise", None, 2e-4, "noise", "", 10.0),
        ("loss", None, 0.05, "packet_loss", "", 10.0),
        ("loss", 4, 0.2, "packet_loss", "servo/4", 10.0),
        ("slow", 4, 0.001, "slow_servo", "servo/4", 4.0),
        ("undervoltage", 4, 8.0, "undervoltage", "servo/4", 1.5),
        ("undervoltage", None, 8.0, "low_supply", "supply", 1.5),
        ("contact_resistance", 5, 4.0, "contact_resistance", "cable/4-5", 4.0),
        ("overload", 4, None, "overload", "servo/4", 1.5),
        ("hardware_error", 4, None, "overheating", "servo/4", 1.5),
        ("latency_timer", None, 16, "latency_timer", "adapter", 2.0),
    ],
)
def test_each_fault_is_named_with_its_place(  # noqa: PLR0917
    kind: str, servo: int | None, value: float | None, code: str, component: str, seconds: float
) -> None:
    rig = healthy()
    rig.inject(kind, servo, value)
    rig.run(seconds)
    assert rig.active() == [(code, f"bus/main/{component}".rstrip("/"))]
    [report] = rig.classifier.active()
    assert report.remedy == FAULT_CODES[code].remedy
    assert report.evidence.transaction is not None
    assert report.evidence.summary
    assert 0.5 < report.confidence <= 1.0
    assert report.since <= report.stamp


def test_a_wrong_return_delay_is_proved_by_its_register() -> None:
    rig = Rig(chain(SERVOS), 1)
    rig.inject("return_delay", 3, 100)
    rig.run(2.0)
    assert ("return_delay", "bus/main/servo/3") in rig.active()


def test_values_that_do_not_follow_their_goals_are_frozen() -> None:
    def goals(seconds: float) -> list[ServoGoal]:
        if seconds < 0.5:
            return [ServoGoal(id=i, torque_enabled=True) for i in range(1, SERVOS + 1)]
        return [ServoGoal(id=i, position=math.sin(5 * seconds)) for i in range(1, SERVOS + 1)]

    rig = Rig(chain(SERVOS), 1, goals=goals)
    rig.run(2.0)
    rig.inject("frozen", 4)
    rig.run(1.5)
    assert rig.active() == [("frozen_values", "bus/main/servo/4")]


def test_a_servo_at_rest_is_not_frozen() -> None:
    rig = Rig(chain(SERVOS), 1)
    rig.inject("frozen", 4)
    rig.run(5.0)
    assert rig.active() == []


def test_the_last_servo_and_its_cable_cannot_be_told_apart_and_that_is_said() -> None:
    rig = healthy()
    rig.inject("silent", SERVOS)
    rig.run(1.0)
    [report] = rig.classifier.active()
    assert (report.code, report.component) == ("cable_break", f"bus/main/cable/{SERVOS - 1}-8")
    assert report.suspects == [f"bus/main/servo/{SERVOS}"]
    assert report.confidence < 0.7


def test_with_supply_from_the_far_end_any_break_silences_all_and_every_cable_is_suspect() -> None:
    rig = healthy(power="far")
    rig.inject("break", 5)
    rig.run(1.0)
    [report] = rig.classifier.active()
    assert report.code == "lost_signal"
    assert "bus/main/cable/4-5" in report.suspects
    assert "bus/main/supply" in report.suspects


@pytest.mark.parametrize("jammer", ["rhythmic_jammer", "permanent_jammer"])
def test_a_jammer_does_not_hide_a_break(jammer: str) -> None:
    rig = healthy()
    rig.inject(jammer)
    rig.inject("break", 5)
    rig.run(2.0)
    assert set(rig.active()) == {(jammer, "bus/main"), ("cable_break", "bus/main/cable/4-5")}


def test_a_silent_servo_before_a_break_is_named_beside_it() -> None:
    rig = healthy()
    rig.inject("silent", 2)
    rig.inject("break", 6)
    rig.run(3.0)
    assert set(rig.active()) == {
        ("servo_silent", "bus/main/servo/2"),
        ("cable_break", "bus/main/cable/5-6"),
    }


@pytest.mark.parametrize(
    ("kind", "servo", "value", "seconds"),
    [
        ("break", 5, None, 1.0),
        ("silent", 5, None, 1.0),
        ("power_off", None, None, 1.0),
        ("rhythmic_jammer", None, None, 1.0),
        ("permanent_jammer", 3, None, 2.0),
        ("loose_contact", 5, 8.0, 5.0),
        ("noise", None, 2e-4, 3.0),
        ("slow", 4, 0.001, 4.0),
        ("latency_timer", None, 16, 2.0),
    ],
)
def test_what_is_repaired_is_reported_as_healed(
    kind: str, servo: int | None, value: float | None, seconds: float
) -> None:
    rig = healthy()
    rig.inject(kind, servo, value)
    rig.run(seconds)
    assert rig.active()
    rig.bus.heal()
    healed = [report for report in rig.run(14.0) if report.status == "healed"]
    assert healed
    assert rig.active() == []


def test_ordinary_loss_is_no_fault() -> None:
    rig = Rig(chain(SERVOS), 5, loss=0.001)
    rig.run(30.0)
    assert rig.reports == []


def test_a_bus_without_configured_servos_still_shows_what_needs_no_order() -> None:
    rig = healthy()
    known = rig.classifier
    rig.classifier = type(known)("main", chain(0), rig.limits)
    rig.inject("permanent_jammer")
    rig.run(0.5)
    assert rig.active() == [("permanent_jammer", "bus/main")]


@pytest.mark.parametrize("seed", range(6))
def test_a_cable_that_was_off_once_and_is_put_back_is_no_loose_contact(seed: int) -> None:
    rig = Rig(chain(12, rate=100.0), seed)
    rig.run(1.0)
    rig.inject("break", 5)
    rig.run(6.0)
    rig.bus.heal()
    assert {report.code for report in rig.run(12.0)} == {"cable_break"}
    assert rig.active() == []


@pytest.mark.parametrize("seed", range(3))
def test_a_cable_that_was_put_back_twice_hides_no_other_contact_for_long(seed: int) -> None:
    rig = healthy(seed)
    for _ in range(2):
        rig.inject("break", 6)
        rig.run(2.0)
        rig.bus.heal()
        rig.run(2.0)
    put_back = ("loose_contact", "bus/main/cable/5-6")
    assert rig.active() == [put_back]
    rig.inject("loose_contact", 3, 8.0)
    rig.run(12.0)
    assert set(rig.active()) == {put_back, ("loose_contact", "bus/main/cable/2-3")}
    since = {report.component: report.since for report in rig.classifier.active()}
    assert since["bus/main/cable/2-3"] > since["bus/main/cable/5-6"]


@pytest.mark.parametrize("seed", range(6))
def test_a_loose_contact_goes_on_being_told_while_another_cable_is_unplugged(seed: int) -> None:
    rig = healthy(seed)
    rig.inject("loose_contact", 3, 8.0)
    rig.run(10.0)
    loose = ("loose_contact", "bus/main/cable/2-3")
    assert rig.active() == [loose]
    for _ in range(3):
        rig.inject("break", 6)
        rig.run(4.0)
        assert set(rig.active()) >= {loose, ("cable_break", "bus/main/cable/5-6")}
        rig.bus.heal("break", 6)
        rig.run(4.0)
    assert set(rig.active()) == {loose, ("loose_contact", "bus/main/cable/5-6")}
    assert not any(
        report.status == "healed" for report in rig.reports if report.component == loose[1]
    )


@pytest.mark.parametrize("kind", ["duplicate_id", "rhythmic_jammer", "permanent_jammer"])
def test_what_befalls_a_bus_next_makes_no_cable_loose_that_was_unplugged_once(kind: str) -> None:
    for seed in range(8):
        rig = healthy(seed)
        rig.inject("break", 6)
        rig.run(0.6)
        rig.bus.heal()
        rig.run(1.0)
        rig.inject(kind, 4 if kind == "duplicate_id" else None)
        rig.run(0.3 + 0.1 * seed)
        rig.bus.heal()
        rig.run(5.0)
        assert {report.code for report in rig.reports} <= {"cable_break", kind}


@pytest.mark.parametrize("seed", range(4))
def test_a_silent_servo_where_most_answers_are_lost_never_leaves_the_bus_healthy(seed: int) -> None:
    rig = Rig(chain(SERVOS), seed)
    rig.run(2.0)
    rig.inject("loss", None, 0.7)
    rig.inject("silent", 4)
    rig.run(1.2)
    blamed_s = rig.seconds
    for _ in range(1000):
        rig.run(0.01)
        blamed = [code for code, _ in rig.active() if FAULT_CODES[code].severity == "fault"]
        if blamed:
            blamed_s = rig.seconds
        # Health holds a fault for so long after it is over; the classifier looks every 50 ms.
        assert rig.seconds - blamed_s <= FAULT_CODES["cable_break"].heal_s + 0.05
