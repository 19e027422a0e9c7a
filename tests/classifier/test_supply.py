"""What voltages along the chain tell: the module by itself."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.classifier.rig import chain
from wackel_classifier.chain import Chain
from wackel_classifier.supply import Supply

STEP_NS = 10_000_000


class Bus:
    """Servos whose voltages are read one after the other."""

    def __init__(self, servos: int, power: str = "adapter") -> None:
        self.supply = Supply(Chain("main", chain(servos, power=power)), 12.0)
        self.now_ns = 0

    def read(
        self, *sweeps: list[float], undervoltage: tuple[int, ...] = ()
    ) -> list[tuple[str, str, list[str]]]:
        """What is found after these readings of all servos."""
        for volts in sweeps:
            for position, value in enumerate(volts):
                self.now_ns += STEP_NS
                self.supply.voltage(position, value, self.now_ns, self.now_ns)
        low = list(undervoltage)
        return [
            (finding.code, finding.component, finding.suspects)
            for finding in self.supply.findings(low, low, self.now_ns)
        ]


def test_a_drop_over_one_cable_counts_once_all_voltages_were_read_after_it() -> None:
    bus = Bus(4)
    assert bus.read([12.0, 11.9, 11.9, 11.9]) == []
    assert bus.read([12.0, 11.9, 11.0, 11.0]) == []
    assert bus.read([12.0, 11.9, 11.0, 11.0]) == [
        ("contact_resistance", "bus/main/cable/2-3", []),
    ]
    assert bus.read([12.0, 11.9, 11.9, 11.9]) == []


def test_voltages_that_sway_behind_it_do_not_move_the_verdict() -> None:
    bus = Bus(4, "far")
    swaying = ([7.8, 7.7, 11.9, 12.0], [10.2, 8.4, 11.9, 12.0], [8.4, 10.8, 11.8, 12.0])
    bus.read(swaying[0], swaying[0])
    for volts in swaying * 3:
        assert bus.read(volts) == [("contact_resistance", "bus/main/cable/2-3", [])]


def test_a_servo_in_the_middle_that_is_low_alone_is_no_cable() -> None:
    bus = Bus(5)
    for _ in range(3):
        assert bus.read([11.8, 11.6, 8.0, 11.4, 11.3]) == []


def test_the_last_servo_if_it_complains_and_stays_low_is_not_its_cable() -> None:
    bus = Bus(3)
    bus.read([12.0, 12.0, 12.0])
    assert bus.read(*[[12.0, 12.0, 8.0]] * 3, undervoltage=(2,)) == []
    suspect = ["bus/main/servo/3"]
    assert bus.read([12.0, 12.0, 8.0]) == [("contact_resistance", "bus/main/cable/2-3", suspect)]
    # Behind a bad contact the voltage changes with the current.
    swayed = bus.read([12.0, 12.0, 9.5], undervoltage=(2,))
    assert swayed == [("contact_resistance", "bus/main/cable/2-3", suspect)]


def test_all_low_is_the_supply() -> None:
    bus = Bus(3)
    assert bus.read(*[[9.0, 8.9, 8.9]] * 3) == [("low_supply", "bus/main/supply", [])]


def test_undervoltage_waits_until_the_voltages_were_compared() -> None:
    bus = Bus(3)
    assert bus.supply.settled_ns > 10**18  # nobody reads voltages: nothing to wait for
    bus.read([12.0, 12.0, 12.0])
    assert bus.supply.settled_ns == STEP_NS
    bus.read([12.0, 10.0, 10.0])
    assert bus.supply.settled_ns < 0
    bus.read([12.0, 10.0, 10.0])
    assert bus.supply.settled_ns > 0


@pytest.mark.parametrize("power", ["adapter", "far", "both"])
@given(
    servos=st.integers(1, 5),
    readings=st.lists(
        st.tuples(st.integers(0, 4), st.integers(0, 65535), st.integers(0, 10**11)), max_size=60
    ),
)
def test_any_readings_are_judged(
    power: str, servos: int, readings: list[tuple[int, int, int]]
) -> None:
    bus = Bus(servos, power)
    for place, raw, later_ns in readings:
        position = place % servos
        bus.now_ns += later_ns
        bus.supply.voltage(position, raw / 10, bus.now_ns, bus.now_ns)
        found = bus.supply.findings([position], [position], bus.now_ns)
        assert all(finding.summary for finding in found)
        if raw % 7 == 0:
            bus.supply.gone(position)
