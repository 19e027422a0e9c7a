"""``wackel up``: what it starts, restarts, shows, and leaves behind (nothing)."""

import contextlib
import io
import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec
import pytest

from tests.conftest import Rendezvous, killed_after, wait_until
from wackel_cli.supervisor import (
    FIRST_DELAY_S,
    LONGEST_DELAY_S,
    SOUND_LIFE_S,
    Backoff,
    Change,
    Job,
    Supervisor,
)
from wackel_cli.up import is_news, rendezvous, robot_jobs, show_json, show_text
from wackel_node.config import BusConfig, RecorderConfig, RobotConfig, ZenohConfig, dump
from wackel_node.config_drive import GyroConfig
from wackel_node.link import Link
from wackel_node.session import NotReached, session
from wackel_schemas import keys
from wackel_schemas.health import Heartbeat


def test_the_delay_doubles_up_to_a_bound_and_is_forgotten_after_a_sound_life() -> None:
    backoff = Backoff()
    delays = [backoff.after(0.1) for _ in range(9)]
    assert delays[:3] == [FIRST_DELAY_S, 2 * FIRST_DELAY_S, 4 * FIRST_DELAY_S]
    assert delays[-1] == LONGEST_DELAY_S
    assert backoff.after(SOUND_LIFE_S) == FIRST_DELAY_S


def test_a_robot_consists_of_a_gateway_a_bus_and_one_of_each_other_service() -> None:
    config = RobotConfig(buses={"left": BusConfig(port="a"), "right": BusConfig(port="b")})
    path = Path("robot.toml")
    gateways = ["gateway/left", "gateway/right"]
    readers = ["classifier/main", "aggregator/main"]
    assert [job.name for job in robot_jobs(config, path)] == [*gateways, *readers]
    everything = robot_jobs(config, path, virtual=True, record=True)
    names = ["virtual/main", *gateways, *readers, "recorder/main"]
    assert [job.name for job in everything] == names
    assert [job.after for job in everything if job.name in gateways] == [("virtual/main",)] * 2
    recorded = msgspec.structs.replace(config, recorder=RecorderConfig(directory="r"))
    assert robot_jobs(recorded, path)[-1].name == "recorder/main"
    gateway = robot_jobs(config, path)[0]
    assert gateway.arguments == ("gateway", "--config", "robot.toml", "--bus", "left")
    assert gateway.after == ()


def test_a_recording_stands_in_for_the_gateways_once_all_others_listen() -> None:
    config = RobotConfig(buses={"left": BusConfig(port="a")})
    *readers, player = robot_jobs(config, Path("robot.toml"), recording=Path("walk.mcap"))
    assert [job.name for job in readers] == ["classifier/main", "aggregator/main"]
    assert player.arguments == ("play", "--config", "robot.toml", "walk.mcap")
    assert player.after == ("classifier/main", "aggregator/main")
    assert player.once


def test_two_processes_under_one_name_are_news_once_each() -> None:
    told: dict[int, str] = {}

    def beat(boot: int, state: Literal["starting", "ready", "stopping"]) -> bool:
        return is_news(Heartbeat(stamp=0, boot=boot, state=state, period_s=0.5, pid=1), told)

    assert beat(1, "starting")
    assert beat(1, "ready")
    assert not beat(1, "ready")
    assert beat(2, "ready")
    assert not any(beat(boot, "ready") for boot in (1, 2, 1, 2))
    assert beat(2, "stopping")
    assert beat(3, "ready")
    assert len(told) == 2


def test_text_from_the_network_cannot_steer_the_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    show_text("health", "fault", "a\x1b[2J\nb")
    assert capsys.readouterr().out.endswith(
        "a\N{REPLACEMENT CHARACTER}[2J\N{REPLACEMENT CHARACTER}b\n"
    )


class Writes(io.StringIO):
    """Keeps each write apart, as a file does where Python does not buffer."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[str] = []

    def write(self, text: str) -> int:
        self.seen.append(text)
        return len(text)


@pytest.mark.parametrize("show", [show_text, show_json])
def test_nothing_gets_between_a_line_and_its_end(
    show: Callable[[str, str, str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    output = Writes()
    monkeypatch.setattr(sys, "stdout", output)
    show("health", "ok", "All well")
    (line,) = output.seen
    assert line.endswith("\n")


def test_an_address_that_cannot_be_listened_at_is_told_as_such() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and never listens
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        config = RobotConfig(zenoh=ZenohConfig(endpoint=endpoint))
        with pytest.raises(NotReached, match="cannot listen at"), rendezvous(config, []):
            pass


# Real processes from here on.


def state(pid: int) -> str:
    """State letter of proc(5); empty if there is no such process."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    return ""


def is_running(pid: int) -> bool:
    return state(pid) not in ("", "Z")


class Story:
    """Runs a supervisor and keeps what it told."""

    def __init__(self, jobs: list[Job]) -> None:
        self.changes: list[Change] = []
        self.supervisor = Supervisor(jobs, self.changes.append)

    def wait_for(self, event: str, count: int = 1) -> Change:
        def happened() -> list[Change]:
            return [change for change in self.changes if change.event == event]

        wait_until(lambda: len(happened()) >= count, 30.0, self.turn)
        return happened()[count - 1]

    def turn(self) -> None:
        self.supervisor.step()
        time.sleep(0.01)


@pytest.fixture
def config(robot_config: RobotConfig) -> RobotConfig:
    return robot_config


@pytest.fixture
def path(config: RobotConfig, tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(dump(config))
    return path


def aggregator(path: Path) -> Job:
    return Job("aggregator/main", ("aggregator", "--config", str(path)))


@pytest.mark.process
def test_what_is_killed_is_started_again(path: Path) -> None:
    story = Story([aggregator(path)])
    with story.supervisor:
        first = story.wait_for("started")
        os.kill(first.pid, signal.SIGKILL)
        exited = story.wait_for("exited")
        assert (exited.pid, exited.detail) == (first.pid, "signal 9, restarting in 0.2 s")
        assert story.wait_for("started", 2).pid != first.pid
    assert story.changes[-1].event == "stopped"
    assert not is_running(story.changes[-1].pid)


def is_told_to_end(pid: int) -> bool:
    """Whether SIGTERM waits for a process that does not run now."""
    pending = re.search(r"ShdPnd:\s*(\w+)", Path(f"/proc/{pid}/status").read_text())
    return pending is not None and bool(int(pending[1], 16) >> (signal.SIGTERM - 1) & 1)


@pytest.mark.process
def test_hardware_is_stopped_once_nobody_reads_it_any_more(path: Path) -> None:
    hardware, reader = replace(aggregator(path), name="a", outlives=True), aggregator(path)
    story = Story([hardware, reader])
    with story.supervisor:
        first, second = story.wait_for("started").pid, story.wait_for("started", 2).pid
        for pid in (first, second):
            os.kill(pid, signal.SIGSTOP)
            wait_until(lambda pid=pid: state(pid) == "T")
        stopping = threading.Thread(target=story.supervisor.stop)
        stopping.start()
        wait_until(lambda: is_told_to_end(second))
        assert not is_told_to_end(first)
        os.kill(second, signal.SIGCONT)
        wait_until(lambda: not is_running(first) or is_told_to_end(first))
        assert not is_running(second)
        stopping.join()
    assert not is_running(first)


@pytest.mark.process
def test_all_are_stopped_even_if_nobody_can_be_told_any_more(path: Path) -> None:
    pids = []

    def on_change(change: Change) -> None:
        if change.event != "started":
            raise BrokenPipeError
        pids.append(change.pid)

    jobs = [replace(aggregator(path), name=name) for name in "ab"]
    with pytest.raises(BrokenPipeError), Supervisor(jobs, on_change):
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)  # so it has to be killed
    assert len(pids) == 2
    assert not any(map(is_running, pids))


@pytest.mark.process
def test_what_fails_again_and_again_is_tried_at_growing_distance() -> None:
    story = Story([Job("x", ("schema", "--check", "/nowhere"))])  # exit code 1
    with story.supervisor:
        story.wait_for("exited", 3)
    waits = [change.detail for change in story.changes if change.event == "exited"]
    assert waits == [f"exit code 1, restarting in {s} s" for s in ("0.2", "0.4", "0.8")]


@pytest.mark.process
def test_what_is_wrongly_configured_is_given_up(tmp_path: Path) -> None:
    story = Story([aggregator(tmp_path / "none.toml")])
    with story.supervisor:
        assert story.wait_for("given up").detail == "wrong usage or configuration"
        story.turn()
    assert [change.event for change in story.changes] == ["started", "given up"]


@pytest.mark.process
def test_what_comes_after_another_starts_when_that_is_ready() -> None:
    story = Story([Job("b", ("schema", "--help"), after=("a",), once=True)])
    with story.supervisor:
        story.turn()
        assert story.changes == []
        story.supervisor.ready("a")
        story.wait_for("finished")
        story.turn()
    assert [change.event for change in story.changes] == ["started", "finished"]


@pytest.mark.process
def test_what_waits_in_vain_starts_even_so() -> None:
    late = Job("b", ("schema", "--help"), after=("a",), patience_s=0.3, once=True)
    story = Story([late])
    with story.supervisor:
        story.turn()
        assert story.changes == []
        assert 0.0 < story.supervisor.wait_s() <= 0.3
        story.wait_for("finished")


def test_where_all_is_recorded_sensors_wait_until_everyone_listens() -> None:
    config = RobotConfig(
        buses={"main": BusConfig(port="p")},
        gyros={"body": GyroConfig(source="iio", device="d")},
    )
    listening = ("classifier/main", "aggregator/main", "recorder/main")
    waits = {job.name: job.after for job in robot_jobs(config, Path("r"), record=True)}
    assert waits["gateway/main"] == waits["imu/body"] == listening
    waits = {
        job.name: job.after for job in robot_jobs(config, Path("r"), record=True, virtual=True)
    }
    assert waits["virtual/main"] == listening
    assert waits["gateway/main"] == waits["imu/body"] == ("virtual/main",)
    jobs = robot_jobs(config, Path("r"), record=True)
    assert all(math.isfinite(job.patience_s) for job in jobs if job.after)  # control comes first
    assert not any(job.after for job in robot_jobs(config, Path("r")))


@pytest.mark.process
def test_what_does_not_stop_is_killed(path: Path) -> None:
    story = Story([aggregator(path)])
    with story.supervisor:
        pid = story.wait_for("started").pid
        os.kill(pid, signal.SIGSTOP)
        wait_until(lambda: state(pid) == "T")
    assert [change.event for change in story.changes] == ["started", "killed"]
    assert not is_running(pid)


Up = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def up(path: Path) -> Iterator[Up]:
    """Starts ``wackel up --json``; whatever is left of it is killed in the end."""
    started: list[subprocess.Popen[str]] = []

    def up(*arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "wackel_cli", "up", str(path), "--json", *arguments]
        started.append(
            subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
            )
        )
        return started[-1]

    yield up
    for process in started:
        process.kill()
        process.communicate()


def read_until(process: subprocess.Popen[str], event: str, *names: str) -> list[dict[str, str]]:
    """The lines until all named have told the event, in whatever order."""
    assert process.stdout is not None
    lines = []
    missing = set(names)
    with killed_after(process):
        for text in process.stdout:
            lines.append(json.loads(text))
            if lines[-1]["event"] == event:
                missing.discard(lines[-1]["name"])
            if not missing:
                return lines
    raise AssertionError(f"{missing} never {event}: {lines}")


def pids(lines: list[dict[str, str]]) -> list[int]:
    return [int(line["detail"].split()[1]) for line in lines if line["event"] == "started"]


@pytest.mark.process
@pytest.mark.usefixtures("hangup_counts")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_everything(up: Up, number: signal.Signals) -> None:
    process = up()
    lines = read_until(process, "ready", "aggregator/main")
    process.send_signal(number)
    lines += read_until(process, "stopped", "aggregator/main")
    assert process.wait(10) == 0
    assert len(pids(lines)) == 2  # no bus: classifier and aggregator
    assert not any(map(is_running, pids(lines)))


@pytest.mark.process
def test_nothing_is_left_when_up_itself_is_killed(up: Up) -> None:
    process = up()
    lines = read_until(process, "ready", "aggregator/main")
    process.kill()
    process.wait()
    children = pids(lines)
    assert children
    wait_until(lambda: not any(map(is_running, children)))


@pytest.mark.process
def test_a_killed_service_is_told_and_back_again(up: Up) -> None:
    process = up()
    lines = read_until(process, "ready", "aggregator/main")
    started = {line["name"]: line["detail"] for line in lines if line["event"] == "started"}
    os.kill(int(started["aggregator/main"].split()[1]), signal.SIGKILL)
    told = read_until(process, "ready", "aggregator/main")
    events = [line["event"] for line in told if line["name"] == "aggregator/main"]
    assert events[:2] == ["exited", "started"]


@pytest.mark.process
def test_a_second_up_of_the_same_robot_is_refused(up: Up) -> None:
    first = up()
    read_until(first, "ready", "aggregator/main")
    second = up()
    assert second.wait(20) == 1
    assert second.stderr is not None
    assert "robot testbot is up already (aggregator/main" in second.stderr.read()
    assert first.poll() is None


@pytest.mark.process
def test_what_else_is_there_already_joins(up: Up, rendezvous: Rendezvous, path: Path) -> None:
    options = ["--config", str(path), "-o", str(path.parent)]
    command = [sys.executable, "-m", "wackel_recorder", *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as recorder:
        try:
            assert recorder.stderr is not None
            assert "ready" in recorder.stderr.readline()
            process = up()
            read_until(process, "ready", "recorder/main", "aggregator/main")
        finally:
            recorder.kill()  # where a check has failed, it would be waited for in vain


@pytest.mark.process
@pytest.mark.parametrize("told", [True, False])
def test_a_rendezvous_that_listens_already_is_used(
    up: Up, rendezvous: Rendezvous, told: bool
) -> None:
    process = up(*(["--external-rendezvous"] if told else []))
    read_until(process, "ready", "aggregator/main")
    process.terminate()
    _, log = process.communicate(timeout=20)
    assert ("using the rendezvous that listens" in log) is not told
    assert rendezvous.session.is_closed() is False


@pytest.mark.process
def test_an_external_rendezvous_that_is_not_there_is_told(up: Up) -> None:
    process = up("--external-rendezvous")
    assert process.wait(20) == 3
    assert process.stderr is not None
    assert "no zenohd at tcp/127.0.0.1:" in process.stderr.read()


@pytest.mark.process
def test_services_go_on_without_their_rendezvous_and_find_a_new_one(
    config: RobotConfig, path: Path
) -> None:
    def hear_health() -> None:
        heard: list[str] = []
        with session(config, "router"), Link(config) as link:
            link.subscribe(keys.HEALTH, lambda key, _: heard.append(key))
            wait_until(lambda: bool(heard), 20.0, lambda: link.pump(0.05))

    story = Story([aggregator(path)])
    with story.supervisor:
        hear_health()
        hear_health()
    assert [change.event for change in story.changes] == ["started", "stopped"]
