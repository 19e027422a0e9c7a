"""The record of which robots have driven without a fault."""

from pathlib import Path

import pytest

from tests.bench.alarms import Driven, keep, known
from tests.bench.fresh import fingerprint
from tests.diagnoser.fleet import Member


def test_what_is_kept_is_known_again(tmp_path: Path) -> None:
    alarms = {0: [], 1: ["gyro_deviates gyro/body after 39.3 s"], 2: [], 5: [], 7: []}
    driven = {
        number: Driven(number, Member.of("now", number), said) for number, said in alarms.items()
    }
    path = tmp_path / "alarms.json"
    keep(path, "now", driven.values())
    assert known(path, "now") == driven


def test_robots_of_other_code_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "alarms.json"
    assert known(path, "now") == {}
    keep(path, "before", [Driven(0, Member.of("before", 0), [])])
    assert known(path, "now") == {}


@pytest.mark.parametrize(
    "record",
    ["", "{", "[]", "{}", '{"code": "now", "driven": 3, "alarms": {}}', '{"code": "now"}', "\xff"],
)
def test_a_damaged_record_is_said_to_be_one(tmp_path: Path, record: str) -> None:
    path = tmp_path / "alarms.json"
    path.write_bytes(record.encode("latin-1"))
    with pytest.raises(SystemExit, match="damaged"):
        known(path, "now")


def test_only_what_robots_are_driven_with_makes_hours_void(tmp_path: Path) -> None:
    core, shell, test = (tmp_path / name for name in ("core.py", "service.py", "test_core.py"))
    core.write_text("limit = 1\n")
    before = fingerprint([tmp_path])
    core.write_text("limit = 1  # why\n")
    shell.write_text("limit = 2\n")
    test.write_text("limit = 3\n")
    assert fingerprint([tmp_path]) == before
    core.write_text("limit = 4\n")
    assert fingerprint([tmp_path]) != before
