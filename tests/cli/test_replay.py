"""`wackel replay`: the same recording gives the same faults, and those of the live services."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from tests.classifier.rig import EPOCH_NS, Rig, chain
from tests.conftest import Rendezvous, wait_until
from wackel_cli.comparison import differences
from wackel_cli.replay import main
from wackel_node.config import ConfigError, RobotConfig, dump
from wackel_node.errors import NotWritable
from wackel_node.link import Link
from wackel_node.listen import header_of
from wackel_recording.about import About
from wackel_recording.reader import open_recordings
from wackel_recording.writer import RecordingWriter
from wackel_schemas import wire
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.health import Heartbeat
from wackel_schemas.keys import ALIVE
from wackel_schemas.message import Message

CONFIG = RobotConfig(robot="testbot", buses={"main": chain(6)})
BREAK = "bus/main/cable/3-4"


def write(path: Path, messages: list[tuple[str, bytes]], config: RobotConfig = CONFIG) -> Path:
    """A recording with 10 ms from message to message."""
    about = About(
        robot="testbot", config=dump(config), version="1", started_ns=EPOCH_NS, session=path.name
    )
    writer = RecordingWriter(path, about)
    for number, (key, payload) in enumerate(messages):
        writer.add(key, EPOCH_NS + number * 10_000_000, payload, header_of(key, payload))
    writer.close()
    return path


@pytest.fixture(scope="module")
def traffic() -> list[tuple[str, bytes]]:
    """Transactions of a chain whose third cable breaks for a while, and the live conclusions."""
    rig = Rig(CONFIG.buses["main"], 1)
    beat = Heartbeat(stamp=EPOCH_NS, boot=9, state="ready", period_s=0.5, pid=1)
    messages = [("alive/classifier/main", wire.encode(beat))]
    reports = 0
    for phase, seconds in enumerate((1.0, 1.0, 2.0)):
        if phase == 1:
            rig.inject("break", 4)
        elif phase == 2:
            rig.bus.heal()
        for transaction in rig.traffic(seconds):
            messages.append(("bus/main/transaction", wire.encode(transaction)))
            for report in rig.classifier.step(transaction):
                report.boot, report.seq = 9, reports
                reports += 1
                messages.append(("fault/classifier", wire.encode(report)))
                report.repeated = True
                messages.append(("fault/classifier", wire.encode(report)))
    return messages


def changed(
    messages: list[tuple[str, bytes]], change: Callable[[FaultReport], None]
) -> list[tuple[str, bytes]]:
    """The same recording, had the first live conclusion been another."""
    at = next(n for n, (key, _) in enumerate(messages) if key.startswith("fault/"))
    report = wire.decode(messages[at][1], FaultReport)
    change(report)
    return [*messages[:at], (messages[at][0], wire.encode(report)), *messages[at + 1 :]]


def test_the_faults_of_a_recording_are_named_and_two_runs_are_the_same_byte_for_byte(
    tmp_path: Path, traffic: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "run.mcap", traffic)
    outputs = []
    for name in ("first", "second"):
        assert main([str(path), "--json", "-o", str(tmp_path / name)]) == 0
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1] == (tmp_path / "first").read_text()
    assert (tmp_path / "first").read_bytes() == (tmp_path / "second").read_bytes()
    reports = [json.loads(line) for line in outputs[0].splitlines()]
    changes = [(r["code"], r["component"], r["status"]) for r in reports]
    assert ("cable_break", BREAK, "active") in changes
    assert ("cable_break", BREAK, "healed") in changes
    assert all(r.get("evidence") for r in reports)


def test_for_people_a_fault_is_a_line(
    tmp_path: Path, traffic: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(write(tmp_path / "run.mcap", traffic))]) == 0
    output = capsys.readouterr()
    line = next(line for line in output.out.splitlines() if "active  cable_break" in line)
    assert "The cable between servo 3 and servo 4 on bus main is disconnected" in line
    assert 1.0 <= float(line.split()[0]) < 2.0
    assert " times real time" in output.err
    assert "" not in output.err.splitlines()


def test_a_recording_of_live_services_compares_equal(
    tmp_path: Path, traffic: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(write(tmp_path / "run.mcap", traffic)), "--compare"]) == 0
    assert " 0 differences from " in capsys.readouterr().err


def spoil_field(report: FaultReport) -> None:
    report.evidence.values["answers"] = -1


def spoil_component(report: FaultReport) -> None:
    report.component = "bus/main/servo/6"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (spoil_field, ["evidence.values.answers: live -1, replayed "]),
        (spoil_component, ["bus/main/servo/6 active: only live", "active: only replayed"]),
    ],
)
def test_a_difference_is_shown_by_path_and_fails(
    tmp_path: Path,
    traffic: list[tuple[str, bytes]],
    capsys: pytest.CaptureFixture[str],
    change: Callable[[FaultReport], None],
    expected: list[str],
) -> None:
    path = write(tmp_path / "run.mcap", changed(traffic, change))
    assert main([str(path), "--compare"]) == 1
    output = capsys.readouterr().out
    assert all(text in output for text in expected)


def test_a_conclusion_that_was_on_its_way_when_recording_ended_is_no_difference(
    tmp_path: Path, traffic: list[tuple[str, bytes]]
) -> None:
    first = next(n for n, (key, _) in enumerate(traffic) if key.startswith("fault/"))
    path = write(tmp_path / "run.mcap", traffic[:first])
    assert main([str(path), "--compare"]) == 0


def test_without_live_conclusions_there_is_nothing_to_compare(
    tmp_path: Path, traffic: list[tuple[str, bytes]]
) -> None:
    transactions = [(key, payload) for key, payload in traffic if key.startswith("bus/")]
    path = write(tmp_path / "run.mcap", transactions)
    with pytest.raises(ValueError, match="no live service was recorded"):
        main([str(path), "--compare"])


def test_what_is_not_used_is_counted_with_the_reason(
    tmp_path: Path, traffic: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    messages = [
        *traffic,
        ("bus/main/transaction", b"\xc1"),
        ("bus/main/transaction", wire.encode(Message(stamp=1))),
        ("bus/leg/transaction", traffic[1][1]),
    ]
    path = write(tmp_path / "run.mcap", messages)
    path.write_bytes(path.read_bytes()[:-500])
    assert main([str(path)]) == 0
    errors = capsys.readouterr().err
    assert "bus/main/transaction: 2 messages not used: no Transaction: " in errors
    assert "bus/leg/transaction: 1 messages not used: the configuration has no such bus" in errors
    assert f"{path}: " in errors.splitlines()[-1]


def test_the_configuration_of_another_robot_is_told_as_such(
    tmp_path: Path, traffic: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "run.mcap", traffic)
    config = tmp_path / "robot.toml"
    for robot, doubts in (("testbot", []), ("walker", [f"{path} is of robot 'testbot'"])):
        config.write_text(dump(msgspec.structs.replace(CONFIG, robot=robot)))
        assert main([str(path), "--config", str(config)]) == 0
        told = capsys.readouterr().err.splitlines()
        doubtful = [line.partition(",")[0] for line in told if "of robot" in line]
        assert doubtful == doubts


def test_another_configuration_can_be_tried(
    tmp_path: Path, traffic: list[tuple[str, bytes]], capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "run.mcap", traffic, RobotConfig(robot="testbot"))
    assert main([str(path)]) == 0
    output = capsys.readouterr()
    assert output.out == ""
    assert "the configuration has no such bus" in output.err
    config = tmp_path / "robot.toml"
    config.write_text(dump(CONFIG))
    assert main([str(path), "--config", str(config)]) == 0
    assert "cable_break" in capsys.readouterr().out
    with pytest.raises(ConfigError, match="no such file"):
        main([str(path), "--config", str(tmp_path / "none.toml")])


@pytest.mark.parametrize(
    "options",
    [
        ["-o", "run.mcap"],
        ["--odometry", "./link.mcap"],
        ["-o", "hard.mcap"],
        ["-o", "x", "--odometry", "x"],
        ["--config", "robot.toml", "-o", "robot.toml"],
    ],
)
def test_a_recording_is_not_written_over_nor_a_file_twice(
    options: list[str],
    tmp_path: Path,
    traffic: list[tuple[str, bytes]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path / "run.mcap", traffic)
    before = path.read_bytes()
    (tmp_path / "link.mcap").symlink_to(path)
    (tmp_path / "robot.toml").write_text(dump(CONFIG))
    (tmp_path / "hard.mcap").hardlink_to(path)
    with pytest.raises(NotWritable, match=f"{options[-1].removeprefix('./')}: .*name another file"):
        main(["run.mcap", *options])
    assert path.read_bytes() == before
    assert (tmp_path / "robot.toml").stat().st_size
    assert not (tmp_path / "x").exists()


def report(code: str, bus: str = "main", confidence: float = 0.5) -> FaultReport:
    return FaultReport(
        stamp=1,
        code=code,
        component=f"bus/{bus}/servo/1",
        status="active",
        confidence=confidence,
        message="",
        remedy="",
        evidence=Evidence(summary=""),
        since=1,
    )


def test_only_within_a_bus_is_there_an_order() -> None:
    live = [report("noise"), report("noise", "leg"), report("overload")]
    assert differences(live, [live[1], live[0], live[2]]) == []
    assert len(differences(live, [live[2], live[1], live[0]])) == 2


def test_a_report_more_shifts_none_of_the_others() -> None:
    live = [report("noise"), report("overload", confidence=0.25)]
    replayed = [report("stray_data"), report("noise"), report("overload")]
    found = [str(difference) for difference in differences(live, replayed)]
    assert found == [
        "1 stray_data bus/main/servo/1 active: only replayed",
        "2 overload bus/main/servo/1 active: confidence: live 0.25, replayed 0.5",
    ]


@pytest.mark.process
def test_live_services_and_replay_conclude_the_same_from_the_same_input(
    rendezvous: Rendezvous, tmp_path: Path, traffic: list[tuple[str, bytes]]
) -> None:
    inputs = [(key, payload) for key, payload in traffic if key.startswith("bus/")]
    config = RobotConfig(robot="testbot", buses=CONFIG.buses, zenoh=rendezvous.config.zenoh)
    robot_toml = tmp_path / "robot.toml"
    robot_toml.write_text(dump(config))
    source = write(tmp_path / "source.mcap", inputs, config)
    again = tmp_path / "again.mcap"
    common = ["--config", str(robot_toml)]

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, "-m", "wackel_cli", *arguments, *common])

    ready: set[str] = set()

    def beat(key: str, heartbeat: Heartbeat) -> None:
        if heartbeat.state == "ready":
            ready.add(key)

    classifier, recorder = start("classifier"), start("record", "-o", str(again))
    try:
        with Link(config) as link:
            link.subscribe(ALIVE, beat)
            wait_until(lambda: len(ready) == 2, 20, meanwhile=lambda: link.pump(0.05))
        assert start("play", str(source), "--speed", "5").wait(60) == 0
        wait_until(lambda: inputs[-1] in recorded(again), 20)
        recorder.send_signal(signal.SIGINT)
        assert recorder.wait(10) == 0
    finally:
        for process in (classifier, recorder):
            process.terminate()
            process.wait(10)
    assert main([str(again), "--compare", "-o", str(tmp_path / "replayed")]) == 0
    assert '"cable_break"' in (tmp_path / "replayed").read_text()
    assert [each for each in recorded(again) if each[0].startswith("bus/")] == inputs


def recorded(path: Path) -> list[tuple[str, bytes]]:
    (recording,) = open_recordings([path])
    return [(entry.key, entry.payload) for entry in recording.entries()]
