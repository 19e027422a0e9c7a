"""Who is connected, who has power, and at which voltage, along a chain of cables."""

import pytest

from wackel_virtual.chain import CABLE_OHM, Chain, voltages


@pytest.mark.parametrize(
    ("feed", "open_cables", "near", "powered"),
    [
        ("adapter", [], 4, "1111"),
        ("adapter", [2], 2, "1100"),
        ("adapter", [0], 0, "0000"),
        ("far", [2], 2, "0011"),
        ("far", [0], 0, "1111"),
        ("far", [1, 3], 1, "0001"),
        ("both", [2], 2, "1111"),
        ("both", [1, 3], 1, "1001"),
    ],
)
def test_a_broken_cable_takes_data_from_the_far_side_and_power_from_the_one_without_supply(
    feed, open_cables, near, powered
):
    chain = Chain(4, feed)
    chain.set(open_cables, supplied=True)
    assert chain.near == near
    assert chain.powered == [flag == "1" for flag in powered]
    assert chain.answering() == ("1" in powered[:near])


def test_without_supply_nobody_has_power():
    chain = Chain(3, "both")
    chain.set([], supplied=False)
    assert chain.powered == [False] * 3


def test_servos_hear_each_other_on_the_same_side_of_a_break():
    chain = Chain(4, "both")
    chain.set([2], supplied=True)
    assert chain.joined(0, 1)
    assert chain.joined(3, 2)
    assert not chain.joined(3, 1)


def test_voltage_falls_from_the_supply_on_with_the_current_of_those_behind():
    drops = [12.0 - volts for volts in voltages(12.0, "adapter", [1.0, 2.0, 3.0], {})]
    assert drops == pytest.approx([6 * CABLE_OHM, 11 * CABLE_OHM, 14 * CABLE_OHM])
    mirrored = voltages(12.0, "far", [3.0, 2.0, 1.0], {})
    assert mirrored == pytest.approx(voltages(12.0, "adapter", [1.0, 2.0, 3.0], {})[::-1])


def test_with_supply_at_both_ends_each_half_is_fed_from_its_own():
    volts = voltages(12.0, "both", [1.0] * 5, {})
    assert volts == pytest.approx(volts[::-1])
    assert min(volts) == volts[2]


def test_a_bad_contact_drops_voltage_by_the_current_through_it():
    healthy = voltages(12.0, "adapter", [0.5] * 4, {})
    bad = voltages(12.0, "adapter", [0.5] * 4, {2: 3.0})
    assert bad[:2] == healthy[:2]
    assert [h - b for h, b in zip(healthy[2:], bad[2:], strict=True)] == pytest.approx([3.0, 3.0])
