import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings

from tests.kinematics.geometry import moving_drives, ring
from wackel_kinematics.array import Floats
from wackel_kinematics.candidates import AT_CONTACT, COINCIDENT, Candidates
from wackel_kinematics.drive import Drive
from wackel_kinematics.inverse import inverse
from wackel_kinematics.layouts import ackermann, mecanum_rectangle, tricycle
from wackel_kinematics.planar import instantaneous_centre
from wackel_kinematics.signatures import as_text, steering_signatures
from wackel_kinematics.wheel import Placement, steered

CIRCLE = np.array([1.5, 0.0, 1.5])
"""The paper's test drive: 1 m radius at 1.5 m/s (section 5)."""


def by_hand(drive: Drive, steering: Floats, wheel_rate: Floats) -> list[Floats]:
    """Equation 9 for one pair and wheel after another."""
    rows, values = drive.rows(steering), drive.values(wheel_rate)
    found = []
    for k, l in combinations(range(drive.n), 2):  # noqa: E741 - the paper's name
        line = np.cross(rows[k], rows[l])
        found += [line * values[drive.n + w] / (rows[drive.n + w] @ line) for w in (k, l)]
    return found


def test_three_wheels_give_six_candidates_in_the_paper_s_order() -> None:
    candidates = Candidates(ring(3))
    assert candidates.labels == ("(1,2;1)", "(1,2;2)", "(1,3;1)", "(1,3;3)", "(2,3;2)", "(2,3;3)")
    assert candidates.k.tolist() == [0, 0, 0, 0, 1, 1]
    assert candidates.l.tolist() == [1, 1, 2, 2, 2, 2]
    assert candidates.w.tolist() == [0, 1, 0, 2, 1, 2]


@pytest.mark.parametrize("n", [3, 4, 5, 8])
def test_every_pair_gives_two_candidates(n: int) -> None:
    assert len(Candidates(ring(n))) == n * (n - 1)


@pytest.mark.parametrize("n", [3, 4, 8])
def test_all_candidates_at_once_are_equation_9_one_by_one(n: int) -> None:
    drive = ring(n)
    steering = inverse(drive, CIRCLE, np.zeros(n)).steering + np.linspace(-0.1, 0.2, n)
    rate = np.linspace(3, 7, n)
    found = Candidates(drive).twists(drive.rows(steering), drive.values(rate))
    np.testing.assert_allclose(found, by_hand(drive, steering, rate))


@settings(max_examples=100)
@given(moving_drives())
def test_candidates_agree_when_wheels_are_consistent(moving: tuple[Drive, Floats]) -> None:
    drive, twist = moving
    motion = inverse(drive, twist, np.zeros(drive.n))
    candidates = Candidates(drive)
    rows = drive.rows(motion.steering)
    usable = ~candidates.singularities(rows).any
    found = candidates.twists(rows, drive.values(motion.wheel_rate))[usable]
    np.testing.assert_allclose(found, np.broadcast_to(twist, found.shape), atol=1e-8)


def test_a_line_of_two_wheels_turns_about_the_crossing_of_their_axles() -> None:
    drive = ring(3)
    rows = drive.rows(inverse(drive, CIRCLE, np.zeros(3)).steering)
    centres = instantaneous_centre(Candidates(drive).lines(rows))
    np.testing.assert_allclose(centres, np.broadcast_to([0.0, 1.0], (6, 2)), atol=1e-12)


@settings(max_examples=50)
@given(moving_drives())
def test_the_lever_is_the_distance_of_the_contact_to_the_other_axle(
    moving: tuple[Drive, Floats],
) -> None:
    drive, twist = moving
    steering = inverse(drive, twist, np.zeros(drive.n)).steering
    candidates = Candidates(drive)
    other = np.where(candidates.w == candidates.k, candidates.l, candidates.k)
    axle = (drive.alpha + steering)[other]
    apart = drive.xy[candidates.w] - drive.xy[other]
    distance = np.abs(np.cos(axle) * apart[:, 1] - np.sin(axle) * apart[:, 0])
    np.testing.assert_allclose(
        np.abs(candidates.levers(drive.rows(steering))), distance, atol=1e-12
    )


def test_a_centre_at_a_contact_spoils_only_candidates_that_roll_on_that_wheel() -> None:
    drive = ring(3)
    x, y = drive.xy[0]
    # The wheel there may point anywhere except at the others, which would be kind B.
    heading = drive.heading(inverse(drive, np.array([y, -x, 1.0]), np.zeros(3)).steering)
    heading[0] = 0.1
    singular = Candidates(drive).singularities(drive.rows(drive.steering(heading)))
    assert as_text(singular.at_contact) == "101000"
    assert not singular.coincident.any()


def test_axles_that_coincide_spoil_the_pair_and_nothing_else() -> None:
    drive = Drive([steered(Placement.cartesian(*xy), 0.05) for xy in [(0, 1), (0, -1), (-1, 0)]])
    rows = drive.rows(inverse(drive, np.array([0.3, 0.0, 1.0]), np.zeros(3)).steering)
    singular = Candidates(drive).singularities(rows)
    assert as_text(singular.coincident) == "110000"
    assert not singular.at_contact.any()
    assert as_text(singular.any) == "110000"


def test_kind_a_is_not_asked_of_a_pair_without_a_definite_centre() -> None:
    drive = Drive([steered(Placement.cartesian(0, y), 0.05) for y in (1, -1)])
    # Turned off the common line by 1°, the second axle meets the first at its own contact.
    rows = drive.rows(drive.steering(np.radians([0.0, 1.0])))
    singular = Candidates(drive).singularities(rows)
    assert as_text(singular.coincident) == "11"
    assert as_text(singular.at_contact) == "00"


def test_parallel_axles_apart_are_no_singularity() -> None:
    drive = ring(4)
    motion = inverse(drive, np.array([1.0, 0.3, 0.0]), np.zeros(4))
    candidates = Candidates(drive)
    rows = drive.rows(motion.steering)
    assert not candidates.singularities(rows).any.any()
    found = candidates.twists(rows, drive.values(motion.wheel_rate))
    np.testing.assert_allclose(found, np.broadcast_to([1.0, 0.3, 0.0], (12, 3)), atol=1e-12)


def test_thresholds_do_not_depend_on_the_size_of_the_robot() -> None:
    heading = np.array([0.1, 0.6, -1.9, 2.5])
    verdicts = []
    for size in (0.01, 0.3, 100.0):
        drive = ring(4, l_m=size)
        verdicts.append(Candidates(drive).singularities(drive.rows(drive.steering(heading))).any)
    assert (verdicts[0] == verdicts[1]).all()
    assert (verdicts[1] == verdicts[2]).all()


def test_kind_b_begins_at_its_threshold() -> None:
    """Two wheels opposite each other on a circle of radius L, one axle turned off their line.

    Unit rows along both axles are [0, 1, 0] and, turned by δ, [−sin δ, cos δ, sin δ] / √(1 + sin²δ)
    in scaled columns: ‖Σ‖ = √2 sin δ / √(1 + sin²δ).
    """
    drive = Drive([steered(Placement.cartesian(0, y), 0.05) for y in (1, -1)])
    edge = math.asin(COINCIDENT / math.sqrt(2 - COINCIDENT**2))
    for turn, singular in [(edge * 0.99, True), (edge * 1.01, False)]:
        rows = drive.rows(drive.steering(np.array([0.0, turn])))
        assert Candidates(drive).singularities(rows).coincident.all() == singular


def test_kind_a_begins_at_its_threshold() -> None:
    """Wheel 1 ahead at L = 1 m, the centre of rotation d beside its contact: ξ = [0, d − 1, 1].

    Its roll row [0, 1, 1] / √2 sees d / √2 of ξ, whose length is √((1 − d)² + 1).
    """
    drive = Drive([steered(Placement.cartesian(*xy), 0.05) for xy in [(1, 0), (-0.6, 0.8)]])
    verdicts = set()
    for d in np.linspace(0.05, 0.15, 21):
        rows = drive.rows(inverse(drive, np.array([0.0, d - 1.0, 1.0]), np.zeros(2)).steering)
        found = Candidates(drive).singularities(rows).at_contact.tolist()
        assert found == [d / math.sqrt(2 * ((1 - d) ** 2 + 1)) < AT_CONTACT, False]
        verdicts.add(found[0])
    assert verdicts == {True, False}


def test_dependent_rows_have_no_candidate() -> None:
    drive = Drive([steered(Placement.cartesian(*xy), 0.05) for xy in [(0, 1), (0, -1), (-1, 0)]])
    candidates = Candidates(drive)
    rows = drive.rows(drive.steering(np.zeros(3)))
    assert np.isnan(candidates.twists(rows, drive.values(np.ones(3)))[:2]).all()
    assert np.isnan(candidates.noise_gains(rows)[:2]).all()
    assert np.isnan(candidates.sensitivities(rows)[:2]).all()
    assert np.isfinite(candidates.twists(rows, drive.values(np.ones(3)))[2:]).all()


def test_a_steering_angle_that_is_no_number_makes_its_candidates_singular() -> None:
    drive = ring(3)
    steering = inverse(drive, CIRCLE, np.zeros(3)).steering
    candidates = Candidates(drive)
    assert not candidates.singularities(drive.rows(steering)).any.any()
    singular = candidates.singularities(drive.rows(steering + np.array([0.0, np.nan, 0.0])))
    np.testing.assert_array_equal(singular.any, steering_signatures(candidates)[1])


@settings(max_examples=50)
@given(moving_drives())
def test_sensitivities_predict_how_errors_move_candidates(moving: tuple[Drive, Floats]) -> None:
    drive, twist = moving
    candidates = Candidates(drive)
    motion = inverse(drive, twist, np.zeros(drive.n))
    rows, values = drive.rows(motion.steering), drive.values(motion.wheel_rate)
    usable = ~candidates.singularities(rows).any
    rolling = values[drive.n :]
    gains = candidates.sensitivities(rows)[usable]
    k, l, w = (wheels[usable] for wheels in (candidates.k, candidates.l, candidates.w))  # noqa: E741
    size = 1e-7
    for i in range(drive.n):
        turned, faster = motion.steering.copy(), motion.wheel_rate.copy()
        turned[i] += size
        faster[i] += size
        by_steering = candidates.twists(drive.rows(turned), values)[usable] - twist
        expected = gains[..., 0] * (rolling[i] * (k == i))[:, None]
        expected = expected + gains[..., 1] * (rolling[i] * (l == i))[:, None]
        np.testing.assert_allclose(by_steering / size, expected, rtol=1e-3, atol=1e-3)
        by_drive = candidates.twists(rows, drive.values(faster))[usable] - twist
        expected = gains[..., 2] * (drive.roll_radius[i] * (w == i))[:, None]
        np.testing.assert_allclose(by_drive / size, expected, rtol=1e-3, atol=1e-3)


def test_sensitivities_invert_the_three_rows() -> None:
    drive = ring(4)
    rows = drive.rows(np.array([0.1, 0.9, -0.4, 2.0]))
    candidates = Candidates(drive)
    for i, gain in enumerate(candidates.sensitivities(rows)):
        three = rows[[candidates.k[i], candidates.l[i], 4 + candidates.w[i]]]
        np.testing.assert_allclose(gain @ three, np.eye(3), atol=1e-12)


def test_the_noise_gain_is_the_error_for_a_rolling_error_of_one() -> None:
    drive = ring(4)
    rows = drive.rows(np.array([0.1, 0.9, -0.4, 2.0]))
    candidates = Candidates(drive)
    rolling = candidates.sensitivities(rows)[..., 2] * [1.0, 1.0, drive.length_m]
    np.testing.assert_allclose(candidates.noise_gains(rows), np.linalg.norm(rolling, axis=-1))


def test_a_recording_gives_what_its_samples_give() -> None:
    drive = ring(4)
    candidates = Candidates(drive)
    rows = drive.rows(np.linspace(-3, 3, 24).reshape(2, 3, 4))
    values = drive.values(np.linspace(-5, 5, 24).reshape(2, 3, 4))
    for at in np.ndindex(2, 3):
        np.testing.assert_array_equal(
            candidates.twists(rows, values)[at], candidates.twists(rows[at], values[at])
        )
        for whole, alone in zip(
            candidates.singularities(rows), candidates.singularities(rows[at]), strict=True
        ):
            np.testing.assert_array_equal(whole[at], alone)
        np.testing.assert_array_equal(
            candidates.sensitivities(rows)[at], candidates.sensitivities(rows[at])
        )
        np.testing.assert_array_equal(
            candidates.noise_gains(rows)[at], candidates.noise_gains(rows[at])
        )


def test_drives_with_fixed_wheels_have_the_candidates_their_rows_allow() -> None:
    drive = ackermann(wheelbase_m=0.5, track_m=0.4, radius_m=0.1)
    candidates = Candidates(drive)
    assert candidates.labels == ("(1,3;3)", "(1,4;4)", "(2,3;3)", "(2,4;4)", "(3,4;3)", "(3,4;4)")
    along = np.array([0.7, 0.0, 0.9])
    motion = inverse(drive, along, drive.steering(np.zeros(4)))
    rows = drive.rows(motion.steering)
    singular = candidates.singularities(rows)
    assert as_text(singular.coincident) == "000011"
    found = candidates.twists(rows, drive.values(motion.wheel_rate))[~singular.any]
    np.testing.assert_allclose(found, np.broadcast_to(along, (4, 3)), atol=1e-12)


def test_a_tricycle_has_a_candidate_with_each_rear_wheel() -> None:
    assert Candidates(tricycle(0.5, 0.4, 0.1)).labels == ("(1,2;1)", "(1,3;1)")


def test_a_drive_without_slide_rows_has_no_candidates() -> None:
    drive = mecanum_rectangle(0.6, 0.4, 0.1)
    candidates = Candidates(drive)
    rows = drive.rows(np.zeros((5, 4)))
    assert len(candidates) == 0
    assert candidates.twists(rows, drive.values(np.ones((5, 4)))).shape == (5, 0, 3)
    assert candidates.singularities(rows).any.shape == (5, 0)
