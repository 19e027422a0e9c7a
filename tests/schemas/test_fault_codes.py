"""Every fault says what it is and what to do."""

import string

import pytest

from wackel_schemas import component
from wackel_schemas.fault_codes import EXPLAINS, FAULT_CODES, message


@pytest.mark.parametrize("code", FAULT_CODES)
def test_every_code_has_a_text_that_names_its_component_and_a_remedy(code: str) -> None:
    entry = FAULT_CODES[code]
    names = {name for _, name, _, _ in string.Formatter().parse(entry.text) if name}
    assert "component" in names
    assert entry.text.endswith(".")
    assert len(entry.remedy) > 20
    assert entry.remedy.endswith(".")
    text = message(code, "bus/main/servo/3", **dict.fromkeys(names - {"component"}, "X"))
    assert "servo 3 on bus main" in text.lower()
    assert "{" not in text


@pytest.mark.parametrize("code", FAULT_CODES)
def test_every_time_of_a_code_is_sensible(code: str) -> None:
    entry = FAULT_CODES[code]
    assert 0 <= entry.debounce_s < entry.window_s
    assert entry.heal_s >= 0


def test_only_known_codes_explain_and_are_explained() -> None:
    for code, followers in EXPLAINS.items():
        assert code in FAULT_CODES
        assert followers <= set(FAULT_CODES)
        assert code not in followers


def test_explanations_do_not_go_in_circles() -> None:
    def below(code: str) -> set[str]:
        found = set(EXPLAINS.get(code, ()))
        return found | {deeper for follower in found for deeper in below(follower)}

    for code in EXPLAINS:
        assert code not in below(code)


def test_components_are_spoken_as_people_speak() -> None:
    assert component.in_words(component.cable("main", 3, 7)) == (
        "the cable between servo 3 and servo 7 on bus main"
    )
    assert component.in_words(component.cable("main", None, 1)) == (
        "the cable between the adapter and servo 1 on bus main"
    )
    assert component.in_words(component.servo("legs", 4)) == "servo 4 on bus legs"
    assert component.in_words(component.adapter("legs")) == "the adapter of bus legs"
    assert component.in_words(component.supply("legs")) == "the supply of bus legs"
    assert component.in_words(component.bus("legs")) == "bus legs"
    assert component.in_words(component.service("gateway/main")) == "the service gateway/main"
    assert component.in_words("something/new") == "something/new"


def test_a_code_that_is_not_in_the_table_has_no_message() -> None:
    with pytest.raises(KeyError):
        message("made_up", "bus/main")
