"""What is kept over a restart, and what becomes of broken files and disks."""

import logging
import os
import shutil
from pathlib import Path
from threading import Event

import pytest

from wackel_aggregator.store import Store, Taken
from wackel_schemas import wire
from wackel_schemas.health import Health, Transition


def health(number: int, changes: int = 1) -> Health:
    change = Transition(number=number, stamp=0, subject="s", before="a", after="b")
    return Health(stamp=number, level="ok", summary="", transitions=[change] * changes)


def slots(directory: Path) -> list[Path]:
    return sorted(directory.glob("robot.health.*"))


def test_there_is_nothing_at_first_and_the_directory_is_made(tmp_path: Path) -> None:
    with Store(tmp_path / "a/b", "robot") as store:
        assert store.load() is None


def test_what_was_prepared_survives_a_killed_process(tmp_path: Path) -> None:
    with Store(tmp_path / "state", "robot") as store:
        for number in range(20):
            store.prepare(wire.encode(health(number, changes=20 - number)))
            if number % 3 == 0:
                store.commit()
            killed = tmp_path / f"killed at {number}"
            shutil.copytree(tmp_path / "state", killed)
            with Store(killed, "robot") as other:
                assert other.load() == health(number, changes=20 - number)


def test_whatever_is_torn_by_a_loss_of_power_the_committed_state_is_there(tmp_path: Path) -> None:
    with Store(tmp_path, "robot") as store:
        for number in range(9):
            store.prepare(wire.encode(health(number)))
            if number == 4:
                store.commit()
                committed = [path.read_bytes() for path in slots(tmp_path)]
        untouched = [
            path
            for path, data in zip(slots(tmp_path), committed, strict=True)
            if path.read_bytes() == data
        ]
    assert len(untouched) == 1
    for path in slots(tmp_path):
        if path != untouched[0]:
            path.write_bytes(path.read_bytes()[:10] + b"\0" * 100)
    with Store(tmp_path, "robot") as store:
        assert store.load() == health(4)


def test_a_disk_that_hangs_holds_up_nobody_and_its_slot_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hanging = Event()

    def hang(slot: int) -> None:
        hanging.wait(10)
        fdatasync(slot)

    fdatasync = os.fdatasync
    monkeypatch.setattr(os, "fdatasync", hang)
    with Store(tmp_path, "robot") as store:
        store.prepare(wire.encode(health(0)))
        store.commit()
        before = [path.read_bytes() for path in slots(tmp_path)]
        for number in range(1, 9):
            store.prepare(wire.encode(health(number)))
            store.commit()
        after = [path.read_bytes() for path in slots(tmp_path)]
        assert [old for old, new in zip(before, after, strict=True) if old == new] == [before[0]]
        hanging.set()
    with Store(tmp_path, "robot") as store:
        assert store.load() == health(8)


@pytest.mark.parametrize("damage", ["garbage", "cut", "flipped", "foreign"])
def test_when_all_is_broken_it_is_set_aside_with_a_warning(
    tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    with Store(tmp_path, "robot") as store:
        for number in range(3):
            store.prepare(wire.encode(health(number)))
    for path in slots(tmp_path):
        data = path.read_bytes()
        broken = {
            "garbage": b"\xff" * 100,
            "cut": data[:-1],
            "flipped": data[:-1] + bytes([data[-1] ^ 1]) if data else b"",
            "foreign": b"{}",
        }
        path.write_bytes(broken[damage])
    with caplog.at_level(logging.WARNING), Store(tmp_path, "robot") as store:
        assert store.load() is None
        assert caplog.text.count("is broken") == 1
        assert (tmp_path / "robot.broken").read_bytes()
        store.prepare(wire.encode(health(5)))
    with Store(tmp_path, "robot") as store:
        assert store.load() == health(5)


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
        store.prepare(wire.encode(health(1)))
        store.commit()
    assert caplog.text.count("will not outlive") == 1


def test_a_full_disk_is_told_once_and_costs_only_the_memory(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(4):
        (tmp_path / f"robot.health.{number}").symlink_to("/dev/full")
    with Store(tmp_path, "robot") as store:
        assert store.load() is None
        for number in range(5):
            store.prepare(wire.encode(health(number)))
            store.commit()
    assert caplog.text.count("No space left") == 1
