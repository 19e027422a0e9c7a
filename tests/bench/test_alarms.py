"""The record of which robots have driven without a fault."""

from pathlib import Path

import pytest

from tests.bench.alarms import Driven, Job, keep, known


def test_what_is_kept_is_known_again(tmp_path: Path) -> None:
    alarms = {0: [], 1: ["gyro_deviates gyro/body after 39.3 s"], 2: [], 5: [], 7: []}
    driven = {number: Driven(Job.of(number), said) for number, said in alarms.items()}
    path = tmp_path / "alarms.json"
    keep(path, "now", driven.values())
    assert known(path, "now") == driven


def test_robots_of_other_code_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "alarms.json"
    assert known(path, "now") == {}
    keep(path, "before", [Driven(Job.of(0), [])])
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
