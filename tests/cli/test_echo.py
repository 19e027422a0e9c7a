"""`wackel echo`: messages and rates, readable or as JSON, whatever comes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import Rendezvous
from wackel_cli.echo import main, table
from wackel_cli.lines import as_json, as_text, clock_time, printable
from wackel_cli.rates import Rates
from wackel_node.config import RobotConfig, dump
from wackel_node.link import Link
from wackel_schemas import wire
from wackel_schemas.bus import (
    BusCommand,
    BusState,
    BusStatistics,
    Chunk,
    ResponseTime,
    ServoGoal,
    ServoState,
    Transaction,
)
from wackel_schemas.drive import (
    Exclusion,
    Exclusions,
    ImuSample,
    Odometry,
    OdometryRequest,
    PoseSet,
    TwistCommand,
)
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.health import Health, Heartbeat
from wackel_schemas.inputs import Inputs, InputStream
from wackel_schemas.keys import HEALTH, TOPICS
from wackel_schemas.message import Message
from wackel_schemas.residuals import HypothesisState, Residuals

MESSAGES: dict[str, tuple[Message, str]] = {
    "bus/main/transaction": (
        Transaction(
            stamp=1,
            purpose="cycle",
            instruction=bytes.fromhex("ff ff fd 00 fe 0a 00 82 84 00 04 00 01 02 ce fa"),
            sent_ns=160_000,
            chunks=[Chunk(at_ns=900_000, data=bytes(15))],
            expected=[1, 2],
            expected_bytes=30,
            deadline_ns=2_000_000,
            ended_ns=2_000_000,
            baud_rate=1_000_000,
            response_times=[ResponseTime(id=1, ns=700_000)],
        ),
        "cycle sync read  16 B out, 15 B in  1 of 2 answered  2.00 ms",
    ),
    "bus/main/state": (
        BusState(
            stamp=1,
            servos=[
                ServoState(id=1, position=0.5, velocity=-0.25, voltage=11.9, temperature=40.0),
                ServoState(id=2, alert=True, error=4),
            ],
        ),
        "1: +0.500 rad -0.250 rad/s 11.9 V 40 °C  2: ALERT error 4",
    ),
    "bus/main/statistics": (
        BusStatistics(
            stamp=1,
            mode="poll",
            port="/dev/ttyUSB0",
            connected=False,
            baud_rate=1_000_000,
            transactions=100,
            incomplete=3,
            stray_bytes=2,
            zero_bytes=1,
            cycle_rate=99.96,
            bus_load=0.42,
        ),
        "poll /dev/ttyUSB0 NOT CONNECTED 100.0 Hz  load 42%  100 transactions, 3 incomplete  "
        "3 bytes outside valid packets",
    ),
    "bus/legs/statistics": (
        BusStatistics(
            stamp=1,
            mode="proxy",
            port="/dev/ttyUSB1",
            connected=True,
            baud_rate=1_000_000,
            transactions=100,
            bus_load=0.42,
        ),
        "proxy /dev/ttyUSB1 load 42%  100 transactions, 0 incomplete  "
        "0 bytes outside valid packets",
    ),
    "bus/main/command": (
        BusCommand(stamp=1, goals=[ServoGoal(id=3), ServoGoal(id=5)], timeout_s=0.5),
        "goals for 3, 5 for 0.5 s",
    ),
    "imu/body": (
        ImuSample(stamp=1, angular_velocity=(0.01, -0.02, 1.5)),
        "turns +0.0100 -0.0200 +1.5000 rad/s",
    ),
    "command/twist": (
        TwistCommand(stamp=1, vx=0.5, vy=0.0, omega=-0.1),
        "vx +0.500 vy +0.000 m/s  omega -0.1000 rad/s",
    ),
    "odometry": (
        Odometry(
            stamp=1,
            x=1.0,
            y=-2.0,
            theta=0.5,
            vx=0.1,
            vy=0.0,
            omega=0.0,
            pose_covariance=[0.0] * 9,
            twist_covariance=[0.0] * 9,
            valid=False,
            reason="one wheel is left",
        ),
        "at +1.000 -2.000 m, +0.5000 rad  vx +0.100 vy +0.000 m/s  omega +0.0000 rad/s  "
        "NOT VALID: one wheel is left",
    ),
    "odometry/pose_set": (
        PoseSet(stamp=1, request=OdometryRequest(operation="set_pose", x=1.0, theta=0.5)),
        "set to +1.000 +0.000 m, +0.5000 rad",
    ),
    "exclusions": (
        Exclusions(
            stamp=1,
            excluded=[Exclusion(component="drive/wheel/left", fault="sensor", reason="it slips")],
        ),
        "drive/wheel/left (it slips)",
    ),
    "residuals": (
        Residuals(
            stamp=1,
            signature="000101",
            hypotheses=[
                HypothesisState(components=["wheel/w3/drive"], fault="actuator", probability=0.993)
            ],
            alarm=0.25,
        ),
        "signature 000101  alarm 25%  likeliest: wheel/w3/drive (99%)  verdict: sound",
    ),
    "fault/classifier": (
        FaultReport(
            stamp=1,
            code="cable_break",
            component="bus/main/cable/3-7",
            status="active",
            confidence=0.98,
            message="The cable is disconnected.",
            remedy="Exchange it.",
            evidence=Evidence(summary="7 and those behind it are silent"),
            since=1,
            repeated=True,
        ),
        "active cable_break bus/main/cable/3-7 (98%) (repeated): The cable is disconnected.",
    ),
    "inputs/odometry/main": (
        Inputs(
            stamp=1,
            streams=[
                InputStream(key="imu/body", boot=5, seq=7),
                InputStream(key="bus/main/state", boot=4, seq=1),
            ],
            order=[0, 1, 0],
        ),
        "took in 3 messages of bus/main/state, imu/body",
    ),
    "health": (Health(stamp=1, level="fault", summary="1 fault"), "fault: 1 fault"),
    "alive/gateway/main": (
        Heartbeat(stamp=1, state="crashed", period_s=0.5, pid=1, received=7, lost=2, reason="Boom"),
        "crashed  7 received  2 lost  Boom",
    ),
}


@pytest.mark.parametrize("key", MESSAGES)
def test_a_message_of_each_topic_is_one_readable_line(key: str) -> None:
    message, line = MESSAGES[key]
    assert as_text(key, wire.encode(message)) == line


def test_no_topic_is_forgotten() -> None:
    assert {type(message) for message, _ in MESSAGES.values()} == {
        topic.message for topic in TOPICS
    }


@pytest.mark.parametrize("key", MESSAGES)
def test_a_line_of_json_holds_the_key_and_the_whole_message(key: str) -> None:
    message, _ = MESSAGES[key]
    line = json.loads(as_json(key, wire.encode(message)))
    assert line["key"] == key
    assert line["message"]["stamp"] == 1


@pytest.mark.parametrize(
    ("key", "payload", "text", "error"),
    [
        ("bus/main/state", b"\xc1\x02", "no BusState: ", "no BusState: "),
        ("camera/front", b"\x01\x02", "2 bytes  01 02", "not a topic of wackel"),
    ],
)
def test_what_is_not_understood_is_shown_with_its_bytes(
    key: str, payload: bytes, text: str, error: str
) -> None:
    assert as_text(key, payload).startswith(text)
    assert payload.hex(" ") in as_text(key, payload)
    line = json.loads(as_json(key, payload))
    assert line["error"].startswith(error)
    assert "message" not in line


def test_text_from_the_network_cannot_steer_the_terminal() -> None:
    assert printable("a\x1b[2Jb\nc") == "a\N{REPLACEMENT CHARACTER}[2Jb\N{REPLACEMENT CHARACTER}c"


@given(key=st.sampled_from(sorted(MESSAGES)), payload=st.binary(max_size=200))
def test_any_bytes_on_any_topic_give_one_line(key: str, payload: bytes) -> None:
    assert "\n" not in as_text(key, payload)
    json.loads(as_json(key, payload))


@pytest.mark.parametrize("stamp_ns", [0, -(2**63), 2**63, 10**30])
def test_any_stamp_can_be_shown(stamp_ns: int) -> None:
    assert clock_time(stamp_ns)


def test_rates_count_intervals_losses_and_age_from_report_to_report() -> None:
    rates = Rates()
    for number, at_s in ((0, 10.0), (1, 10.1), (4, 10.4)):
        header = Message(stamp=int(at_s * 1e9), boot=1, seq=number)
        rates.add("bus/main/state", 100, header, at_s, header.stamp + 2_000_000)
    (rate,) = rates.take(0.5)
    assert rate.hz == pytest.approx(6.0)
    assert rate.shortest_s == pytest.approx(0.1)
    assert rate.longest_s == pytest.approx(0.3)
    assert rate.age_s == pytest.approx(0.002)
    assert rate.bytes_per_s == pytest.approx(600.0)
    assert rate.lost == 2
    (rate,) = rates.take(0.5)
    assert (rate.hz, rate.shortest_s, rate.age_s, rate.lost) == (0.0, None, None, 0)


def test_a_publisher_that_started_anew_has_lost_nothing() -> None:
    rates = Rates()
    rates.add("health", 1, Message(stamp=0, boot=1, seq=0), 0.0, 0)
    rates.add("health", 1, Message(stamp=0, boot=2, seq=50), 1.0, 0)
    (rate,) = rates.take(1.0)
    assert rate.lost == 0


def test_strangers_on_any_number_of_keys_cost_a_bounded_memory() -> None:
    rates = Rates()
    for number in range(5000):
        rates.add(f"x/{number}", 1, None, 0.0, 0)
    assert len(rates.take(1.0)) == 1024


def test_the_table_of_rates_has_a_line_for_each_key() -> None:
    rates = Rates()
    rates.add("bus/main/state", 1000, Message(stamp=0, seq=0), 0.0, 1_500_000)
    rates.add("bus/main/state", 1000, Message(stamp=0, seq=1), 0.005, 1_500_000)
    rates.add("camera", 5, None, 0.0, 0)
    heading, state, camera = table(rates.take(1.0)).splitlines()
    assert heading.split() == ["key", "Hz", "interval", "ms", "age", "ms", "kB/s", "lost"]
    assert state.split() == ["bus/main/state", "2.0", "5.0", "…", "5.0", "1.5", "2.0", "0"]
    assert camera.split() == ["camera", "1.0", "-", "-", "0.0", "0"]


@pytest.mark.parametrize("count", ["0", "-1", "x", "1.5"])
def test_a_count_that_is_none_is_refused(count: str) -> None:
    with pytest.raises(SystemExit) as end:
        main([f"--count={count}"])
    assert end.value.code == 2


def echo(config: RobotConfig, directory: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    path = directory / "robot.toml"
    path.write_text(dump(config))
    return subprocess.run(
        [sys.executable, "-m", "wackel_cli", "echo", "--config", path, *arguments],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )


@pytest.mark.process
def test_the_latest_health_is_shown_at_once(rendezvous: Rendezvous, tmp_path: Path) -> None:
    with Link(rendezvous.config, "peer") as link:
        link.publisher(HEALTH).put(Health(stamp=1, level="warning", summary="a loose contact"))
        done = echo(rendezvous.config, tmp_path, "health", "-n", "1")
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.rstrip().endswith("health  warning: a loose contact")
        done = echo(rendezvous.config, tmp_path, "--json", "-n", "1")
        assert json.loads(done.stdout)["message"]["summary"] == "a loose contact"


@pytest.mark.process
def test_a_wrong_pattern_and_an_absent_robot_are_told(
    robot_config: RobotConfig, tmp_path: Path
) -> None:
    done = echo(robot_config, tmp_path, "bus//state")
    assert done.returncode == 2
    assert "'bus//state' is no key expression" in done.stderr
    done = echo(robot_config, tmp_path)
    assert done.returncode == 3
    assert done.stderr.startswith("wackel echo: no robot at tcp/")
