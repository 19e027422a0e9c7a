"""Whose answers arrive as wrecks: the module by itself."""

from random import Random

from hypothesis import given
from hypothesis import strategies as st

from tests.classifier.rig import chain
from wackel_classifier.chain import Chain
from wackel_classifier.duplicates import Duplicates

SERVOS = 6
ANSWERS = ("wreck", "ping", "values", "silent")


def followed(servos: int = SERVOS) -> Duplicates:
    return Duplicates(Chain("main", chain(servos)))


def ask(duplicates: Duplicates, position: int, answer: str) -> None:
    match answer:
        case "wreck":
            duplicates.wreck(position, 1)
        case "ping" | "values":
            duplicates.intact(position, values=answer == "values")
        case "silent":
            duplicates.silent(position)


def told(duplicates: Duplicates) -> list[str]:
    return [finding.component for finding in duplicates.findings()]


def test_wrecks_in_a_row_convict_and_intact_values_acquit() -> None:
    duplicates = followed()
    for _ in range(13):
        ask(duplicates, 2, "wreck")
    assert told(duplicates) == []
    ask(duplicates, 2, "wreck")
    assert told(duplicates) == ["bus/main/servo/3"]
    ask(duplicates, 2, "values")
    assert told(duplicates) == ["bus/main/servo/3"]  # one may slip through
    for _ in range(6):
        ask(duplicates, 2, "values")
    assert told(duplicates) == []
    assert not duplicates.suspected


def test_intact_pings_between_wrecked_reads_do_not_acquit() -> None:
    duplicates = followed()
    for _ in range(60):
        ask(duplicates, 2, "wreck")
        for _ in range(4):
            ask(duplicates, 2, "ping")
    assert told(duplicates) == ["bus/main/servo/3"]


def test_damage_loss_and_contacts_are_no_second_servo() -> None:
    shares = {  # wreck, intact values, silent
        "noise": (0.3, 0.68, 0.02),
        "a line that damages as much as it loses": (0.2, 0.6, 0.2),
        "a contact that sparks": (0.25, 0.0, 0.75),
    }
    for name, weights in shares.items():
        duplicates, random = followed(), Random(name)
        for _ in range(50_000):
            (answer,) = random.choices(("wreck", "values", "silent"), weights)
            ask(duplicates, 3, answer)
            assert told(duplicates) == [], name


def test_wrecks_of_most_servos_are_the_lines() -> None:
    duplicates = followed()
    for position in range(4):
        for _ in range(20):
            ask(duplicates, position, "wreck")
    assert told(duplicates) == []


@given(
    st.lists(
        st.tuples(st.integers(0, SERVOS - 1), st.sampled_from(ANSWERS)),
        max_size=200,
    )
)
def test_whoever_is_told_is_suspected_and_nobody_is_told_without_wrecks(
    answers: list[tuple[int, str]],
) -> None:
    duplicates = followed()
    for position, answer in answers:
        ask(duplicates, position, answer)
    wrecked = {position for position, answer in answers if answer == "wreck"}
    positions = {int(component.rsplit("/", 1)[1]) - 1 for component in told(duplicates)}
    assert positions <= wrecked
    assert all(duplicates.suspected >> position & 1 for position in positions)
