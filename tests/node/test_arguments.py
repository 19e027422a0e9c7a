"""What the commands' shared arguments take."""

import argparse

import pytest

from wackel_node.arguments import id_list


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
