"""What the commands' shared arguments take."""

import argparse
from pathlib import Path

import pytest

from wackel_node.arguments import above_zero, add_config_first, count, id_list


def test_ids_are_written_as_people_write_them() -> None:
    assert id_list("1-3,7,2") == [1, 2, 3, 7]
    for nonsense, why in {
        "": "no id",
        "a": "no id",
        "1-": "no id",
        "-1": "no id",
        "253": "0 to 252",
        "3-253": "0 to 252",
        "5-2": "begins with the lower",
    }.items():
        with pytest.raises(argparse.ArgumentTypeError, match=why):
            id_list(nonsense)


def test_what_can_only_be_above_zero_is_so() -> None:
    assert (above_zero("0.5"), count("3")) == (0.5, 3)
    for nonsense in ("0", "-5", "nan", "inf", "x", ""):
        with pytest.raises(argparse.ArgumentTypeError, match="above zero"):
            above_zero(nonsense)
        with pytest.raises(argparse.ArgumentTypeError, match="above zero"):
            count(nonsense)


def test_what_is_too_large_is_told_how_large_it_may_be() -> None:
    assert above_zero("1e6") == 1e6
    for much in ("1e300", "1e7", "inf"):
        with pytest.raises(argparse.ArgumentTypeError, match=f"'{much}': .* up to 1000000"):
            above_zero(much)


def test_a_configuration_may_stand_first_or_behind_its_option() -> None:
    parser = argparse.ArgumentParser()
    add_config_first(parser)
    parser.add_argument("--other", action="store_true")
    for arguments in (["r.toml"], ["--config", "r.toml"], ["--other", "--config", "r.toml"]):
        assert parser.parse_args(arguments).config == Path("r.toml"), arguments
    assert parser.parse_args(["--other"]).config is None
