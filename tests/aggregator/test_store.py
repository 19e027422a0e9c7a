"""What is kept over a restart, and what becomes of a broken file."""

import logging
import shutil
from pathlib import Path

import pytest

from wackel_aggregator.state import State
from wackel_aggregator.store import Store, Taken
from wackel_schemas.health import Transition


def state(number: int) -> State:
    change = Transition(number=number, stamp=0, subject="s", before="a", after="b")
    return State(transitions=[change], faults=[])


def test_there_is_nothing_at_first_and_the_directory_is_made(tmp_path: Path) -> None:
    with Store(tmp_path / "a/b", "robot") as store:
        assert store.load() is None


def test_what_was_prepared_survives_a_killed_process(tmp_path: Path) -> None:
    with Store(tmp_path / "state", "robot") as store:
        store.prepare(state(1))
        store.commit()
        store.prepare(state(2))
        shutil.copytree(tmp_path / "state", tmp_path / "as it was when killed")
    with Store(tmp_path / "as it was when killed", "robot") as store:
        assert store.load() == state(2)


def test_a_new_file_that_lost_power_falls_back_to_the_one_before(tmp_path: Path) -> None:
    with Store(tmp_path, "robot") as store:
        store.prepare(state(1))
    (tmp_path / "robot.health.new").write_bytes(b"wackel health 1\n\0\0\0\0\0\0\0")
    with Store(tmp_path, "robot") as store:
        assert store.load() == state(1)


@pytest.mark.parametrize("damage", ["empty", "garbage", "cut", "flipped"])
def test_a_broken_file_is_set_aside_with_a_warning(
    tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    with Store(tmp_path, "robot") as store:
        store.prepare(state(1))
    path = tmp_path / "robot.health"
    data = path.read_bytes()
    broken = {
        "empty": b"",
        "garbage": b"\xff" * 100,
        "cut": data[:-1],
        "flipped": data[:-1] + bytes([data[-1] ^ 1]),
    }[damage]
    path.write_bytes(broken)
    with caplog.at_level(logging.WARNING), Store(tmp_path, "robot") as store:
        assert store.load() is None
        assert "broken" in caplog.text
        assert (tmp_path / "robot.broken").read_bytes() == broken
        store.prepare(state(5))
    with Store(tmp_path, "robot") as store:
        assert store.load() == state(5)


def test_a_second_aggregator_of_the_same_robot_is_refused(tmp_path: Path) -> None:
    with Store(tmp_path, "robot"):
        with pytest.raises(Taken, match="another aggregator"):
            Store(tmp_path, "robot")
        with Store(tmp_path, "other"):
            pass
    with Store(tmp_path, "robot"):
        pass


def test_a_directory_that_cannot_be_made_costs_only_the_memory(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    with Store(tmp_path / "file" / "below", "robot") as store:
        assert store.load() is None
        store.prepare(state(1))
        store.commit()
    assert caplog.text.count("will not outlive") == 1


def test_a_disk_that_fails_later_costs_only_the_memory(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Store(tmp_path / "d", "robot") as store:
        (tmp_path / "d").rename(tmp_path / "moved")
        store.prepare(state(1))
        store.prepare(state(2))
        store.commit()
    assert caplog.text.count("will not outlive") == 1
