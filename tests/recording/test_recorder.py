"""The recorder as a process on a real robot link: what it keeps, whatever happens to it."""

import os
import re
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.conftest import Rendezvous, wait_until
from tests.terminal import on_terminal
from wackel_node.config import RobotConfig, dump, parse
from wackel_node.errors import FAILED
from wackel_node.link import Link
from wackel_recorder.__main__ import main
from wackel_recording.reader import Entry, Recording, open_recordings
from wackel_schemas import wire
from wackel_schemas.bus import BusState
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Health
from wackel_schemas.keys import FAULT, HEALTH, STATE
from wackel_schemas.message import Message

STATE_KEY = "bus/main/state"


@contextmanager
def recorder(
    config: RobotConfig, directory: Path, *arguments: str
) -> Iterator[subprocess.Popen[bytes]]:
    """A recorder, killed at the end if it still runs; its log is in :func:`log_of`."""
    directory.mkdir()
    path = directory.parent / "robot.toml"
    path.write_text(dump(config))
    command = [sys.executable, "-m", "wackel_recorder", "--config", path, "-o", directory]
    with (directory.parent / "log").open("wb") as log:
        process = subprocess.Popen([*command, *arguments], stderr=log)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def on_a_terminal(config: RobotConfig, directory: Path) -> tuple[subprocess.Popen[bytes], int]:
    """A recorder into ``out``; see :func:`on_terminal`."""
    path = directory / "robot.toml"
    path.write_text(dump(config))
    output = directory / "out"
    return on_terminal(
        sys.executable, "-m", "wackel_recorder", "--config", str(path), "-o", str(output)
    )


def log_of(directory: Path) -> str:
    return (directory.parent / "log").read_text()


class Publishing:
    """States of bus main, one every few ms while something else is waited for."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._publisher = link.publisher(STATE, bus="main")
        self.sent = 0

    def __call__(self) -> None:
        self._publisher.put(BusState(stamp=self._link.clock.now_ns(), servos=[]))
        self.sent += 1
        self._link.pump(0.005)


def recorded(directory: Path) -> list[Entry]:
    """What a reader finds now, possibly while it is written."""
    if not any(path.stat().st_size for path in directory.glob("*.mcap")):
        return []
    return [entry for each in open_recordings([directory]) for entry in each.entries()]


def numbers(directory: Path) -> list[int]:
    return [
        wire.decode(entry.payload, Message).seq
        for entry in recorded(directory)
        if entry.key == STATE_KEY
    ]


def single(directory: Path) -> Recording:
    (recording,) = open_recordings([directory])
    return recording


@pytest.mark.process
def test_what_is_published_is_recorded_without_gaps_until_it_is_stopped(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    directory = tmp_path / "out"
    with (
        Link(rendezvous.config) as link,
        recorder(rendezvous.config, directory) as process,
    ):
        publish = Publishing(link)
        wait_until(lambda: len(numbers(directory)) > 50, meanwhile=publish)
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
    found = numbers(directory)
    assert found == list(range(found[0], found[-1] + 1))
    recording = single(directory)
    assert parse(recording.about.config) == rendezvous.config
    assert recording.damage == []
    (path,) = directory.iterdir()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert "wackel/testbot/alive/recorder/main" in {c.topic for c in summary.channels.values()}


@pytest.mark.process
def test_a_recorder_killed_without_warning_loses_at_most_the_last_second(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    directory = tmp_path / "out"
    with (
        Link(rendezvous.config) as link,
        recorder(rendezvous.config, directory) as process,
    ):
        publish = Publishing(link)
        wait_until(lambda: len(numbers(directory)) > 50, meanwhile=publish)
        last_ns = link.clock.now_ns()
        process.kill()
        process.wait()
    states = [entry for entry in recorded(directory) if entry.key == STATE_KEY]
    assert states[-1].stamp_ns > last_ns - 1_000_000_000
    (told,) = single_damage(directory)
    # Killed while it writes, it leaves half of the last chunk.
    assert "it was not finished" in told or "nothing can be read behind" in told


def single_damage(directory: Path) -> list[str]:
    recording = single(directory)
    list(recording.entries())
    return recording.damage


@pytest.mark.process
def test_a_recorder_that_joins_late_has_the_latest_health(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    directory = tmp_path / "out"
    with Link(rendezvous.config, "peer") as link:
        link.publisher(HEALTH).put(Health(stamp=5, level="warning", summary="a cable"))
        with recorder(rendezvous.config, directory) as process:
            wait_until(lambda: any(e.key == "health" for e in recorded(directory)))
            process.terminate()
            process.wait(10)
    (entry,) = [entry for entry in recorded(directory) if entry.key == "health"]
    assert wire.decode(entry.payload, Health).summary == "a cable"


@pytest.mark.process
def test_only_the_topics_asked_for_are_recorded_and_each_message_once(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    directory = tmp_path / "out"
    patterns = ("--topics", "bus/*/state", "bus/main/**")
    with (
        Link(rendezvous.config) as link,
        recorder(rendezvous.config, directory, *patterns) as process,
    ):
        publish = Publishing(link)
        wait_until(lambda: len(numbers(directory)) > 20, meanwhile=publish)
        process.terminate()
        process.wait(10)
    found = numbers(directory)
    assert len(found) == len(set(found)) == len(recorded(directory))


@pytest.mark.process
def test_garbage_and_foreign_keys_are_kept_and_counted(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    directory = tmp_path / "out"
    with (
        Link(rendezvous.config) as link,
        recorder(rendezvous.config, directory) as process,
    ):
        publish = Publishing(link)
        wait_until(lambda: bool(numbers(directory)), meanwhile=publish)
        link.session.put("wackel/testbot/bus/main/state", b"\xc1garbage")
        link.session.put("wackel/testbot/camera/front", b"jpeg")
        wait_until(
            lambda: any(entry.key == "camera/front" for entry in recorded(directory)),
            meanwhile=publish,
        )
        process.terminate()
        process.wait(10)
    assert b"\xc1garbage" in [entry.payload for entry in recorded(directory)]
    assert "1 on keys that are not wackel's; 1 not understood, kept as they came" in log_of(
        directory
    )


def path_sizes(directory: Path) -> int:
    return sum(path.stat().st_size for path in directory.iterdir())


@pytest.mark.process
def test_a_disk_that_takes_no_more_is_told_and_the_service_lives_on(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    directory = tmp_path / "out"
    with (
        Link(rendezvous.config) as link,
        recorder(rendezvous.config, directory) as process,
    ):
        publish = Publishing(link)
        told: list[FaultReport] = []
        link.subscribe(FAULT, lambda _, report: told.append(report))
        wait_until(lambda: bool(numbers(directory)), meanwhile=publish)
        largest = path_sizes(directory) + 4096  # no file may grow beyond
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (largest, resource.RLIM_INFINITY))
        wait_until(
            lambda: "recording pauses, next attempt in 5 s" in log_of(directory), meanwhile=publish
        )
        assert "File too large" in log_of(directory)
        wait_until(lambda: bool(told), meanwhile=publish)
        assert (told[0].code, told[0].status) == ("recording_paused", "active")
        assert "File too large" in told[0].message
        unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, unlimited)
        before = numbers(directory)
        wait_until(lambda: len(numbers(directory)) > len(before), limit_s=20, meanwhile=publish)
        wait_until(lambda: told[-1].status == "healed", meanwhile=publish)
        process.terminate()
        assert process.wait(10) == FAILED
    assert numbers(directory)[: len(before)] == before
    words = re.search(r"(\d+) messages, .*\d lost to a disk that did not take", log_of(directory))
    assert words is not None
    assert 0 < int(words[1]) <= len(recorded(directory))


@pytest.mark.process
@pytest.mark.usefixtures("hangup_counts")
def test_when_its_terminal_is_closed_the_file_is_finished(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    process, terminal = on_a_terminal(rendezvous.config, tmp_path)
    shown = ""
    while shown.count("\x1b[K") < 2:
        shown += os.read(terminal, 4096).decode()
    os.close(terminal)
    assert process.wait(10) == 0
    assert single_damage(tmp_path / "out") == []
    assert recorded(tmp_path / "out")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--max-size", "much"], "'much' is no number above zero with one of the units k, M, G"),
        (["--max-size", "5"], "is no number above zero with one of the units k, M, G"),
        (["--max-duration", "0h"], "is no number above zero with one of the units s, min, h"),
        (["--max-duration", "1e999s"], "is no number above zero with one of the units s, min, h"),
    ],
)
def test_wrong_arguments_are_explained(
    capsys: pytest.CaptureFixture[str], arguments: list[str], reason: str
) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert reason in capsys.readouterr().err


@pytest.mark.process
@pytest.mark.parametrize(
    ("output", "pattern", "reason"),
    [
        ("file/below", "**", "cannot record:"),
        ("out", "/bus", "'/bus' is no key expression"),
    ],
)
def test_what_cannot_be_recorded_is_told_at_once(
    robot_config: RobotConfig, tmp_path: Path, output: str, pattern: str, reason: str
) -> None:
    (tmp_path / "file").write_text("")
    path = tmp_path / "robot.toml"
    path.write_text(dump(robot_config))
    command = [sys.executable, "-m", "wackel_cli", "record", "--config", path]
    done = subprocess.run(
        [*command, "-o", tmp_path / output, "--topics", pattern],
        check=False,
        stderr=subprocess.PIPE,
        text=True,
        timeout=20,
    )
    assert done.returncode in (1, 2)
    assert done.stderr.startswith(f"wackel record: {reason}")
    assert done.stderr.count("\n") == 1


@pytest.mark.process
def test_on_a_narrow_terminal_the_progress_stays_on_one_line(
    rendezvous: Rendezvous, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    process, terminal = on_a_terminal(rendezvous.config, tmp_path)
    shown = ""
    while shown.count("\x1b[K") < 3:
        shown += os.read(terminal, 4096).decode()
    process.terminate()
    assert process.wait(10) == 0
    os.close(terminal)
    lines = [line.partition("\x1b[K")[0] for line in shown.split("\r") if "\x1b[K" in line]
    assert all("messages" in line and len(line) < 40 for line in lines)
