"""`wackel top`: what a person sees of a robot's state, at any size of the terminal."""

import json
import math
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.text import Text

from tests.conftest import Rendezvous
from wackel_cli.robot_model import RobotModel
from wackel_cli.robot_screen import render
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, dump
from wackel_node.link import Link
from wackel_schemas.bus import (
    BusState,
    BusStatistics,
    ResponseTime,
    ServoState,
    ServoStatistics,
    Transaction,
)
from wackel_schemas.drive import InputState, Odometry
from wackel_schemas.fault_codes import FAULT_CODES, message
from wackel_schemas.health import FaultRecord, FaultStatus, Health, ServiceHealth
from wackel_schemas.keys import HEALTH
from wackel_schemas.wire import Rejected

STAMP = 1_700_000_000_000_000_000
CABLE = "bus/main/cable/3-4"


def config(servos: int) -> RobotConfig:
    chain = [ServoConfig(id=n, model="XM430-W210", role=f"joint {n}") for n in range(1, servos + 1)]
    return RobotConfig(robot="testbot", buses={"main": BusConfig(port="/dev/ttyX", servos=chain)})


def record(code: str, where: str, status: FaultStatus = "confirmed", **more: str) -> FaultRecord:
    return FaultRecord(
        code=code,
        component=where,
        source="classifier",
        severity=FAULT_CODES[code].severity,
        status=status,
        message=message(code, where),
        remedy=FAULT_CODES[code].remedy,
        confidence=0.98,
        first=STAMP - 12 * 10**9,
        last=STAMP - 2 * 10**9,
        **more,
    )


def health(
    *faults: FaultRecord, level: str = "fault", summary: str = "a cable is broken"
) -> Health:
    services = [
        ServiceHealth(name="gateway/main", status="ready", since=0),
        ServiceHealth(name="classifier/main", status="dead", since=0, reason="gone"),
    ]
    return Health(
        stamp=STAMP,
        level=level,  # type: ignore[arg-type]
        summary=summary,
        capabilities={"can_command": False},
        faults=list(faults),
        services=services,
    )


def seen(servos: int = 6, silent_from: int = 99, faults: Health | None = None) -> RobotModel:
    """Two seconds of a chain at 100 Hz, in which the servos of one id and above stay silent."""
    model = RobotModel(config(servos))
    ids = range(1, servos + 1)
    model.count(0.0)
    for second in (0, 1):
        counters = [
            ServoStatistics(id=n, expected=100 * second, received=100 * second * (n < silent_from))
            for n in ids
        ]
        statistics = BusStatistics(
            stamp=1,
            mode="poll",
            port="/dev/ttyX",
            connected=True,
            baud_rate=1_000_000,
            cycle_rate=100.0,
            bus_load=0.25,
            servos=counters,
        )
        model.on_statistics("main", statistics, second + 0.5)
    for cycle in range(200):
        now_s = cycle / 100
        answers = [n for n in ids if n < silent_from]
        transaction = Transaction(
            stamp=1,
            purpose="cycle",
            instruction=b"",
            sent_ns=0,
            chunks=[],
            expected=list(ids),
            expected_bytes=0,
            deadline_ns=0,
            ended_ns=0,
            baud_rate=1_000_000,
            response_times=[ResponseTime(id=n, ns=n * 250_000) for n in answers],
        )
        model.on_transaction("main", transaction, now_s)
        state = BusState(
            stamp=1,
            servos=[ServoState(id=n, position=n / 8, voltage=11.9, alert=n == 2) for n in answers],
        )
        model.on_state("main", state, now_s)
        if cycle == 99:
            model.count(1.0)
    model.count(2.0)
    if faults is not None:
        model.on_health(faults, 1.9)
    return model


def screen(model: RobotModel, width: int = 80, height: int = 24, now_s: float = 2.0) -> list[str]:
    return [line.plain.rstrip() for line in render(model, now_s, width, height)]


def line_with(lines: list[str], *words: str) -> str:
    found = [line for line in lines if all(word in line for word in words)]
    assert len(found) == 1, (words, lines)
    return found[0]


def columns(line: str) -> str:
    return " ".join(line.split())


def test_the_first_line_tells_level_robot_summary_and_what_is_lost() -> None:
    lines = screen(seen(faults=health()))
    assert lines[0] == " FAULT  testbot  a cable is broken  cannot: command"


def test_a_bus_shows_mode_port_rate_load_and_loss() -> None:
    lines = screen(seen(silent_from=4))
    assert lines[1] == "bus main  poll /dev/ttyX 1 Mbit/s  100.0 Hz  load 25%  loss 50%"


def test_a_bus_of_another_master_shows_no_rate_of_its_own() -> None:
    model = seen()
    statistics = model.buses["main"].statistics
    assert statistics is not None
    model.on_statistics("main", msgspec.structs.replace(statistics, mode="tap"), 2.0)
    assert screen(model)[1] == "bus main  tap /dev/ttyX 1 Mbit/s  load 25%  loss 0.0%"


def test_a_long_role_has_the_room_that_faults_leave() -> None:
    role = "left front ankle, roll"
    model = seen()
    servo = model.buses["main"].servos[3]
    servo.config = msgspec.structs.replace(servo.config, role=role)
    assert line_with(screen(model), role)
    model.on_health(health(record("contact_resistance", CABLE)), 1.9)
    assert line_with(screen(model), "left fr…")
    assert line_with(screen(model), "╳●  4", "contact_resistance")
    assert line_with(screen(model, width=100), role)


def test_servos_stand_in_cable_order_with_rate_response_time_loss_and_values() -> None:
    lines = screen(seen())
    servos = [line for line in lines if "joint" in line]
    assert [line.split()[1] for line in servos] == ["1", "2", "3", "4", "5", "6"]
    assert columns(servos[2]) == "│● 3 XM430-W210 joint 3 100.0 0.75 0.0% +0.375 11.9 -"


@pytest.mark.parametrize(
    ("position", "shown"),
    [(-0.5, "-0.500"), (1234.56, "+1234"), (12345.6, "+12345"), (123456.7, "+1e+05")],
)
def test_no_digit_before_the_decimal_point_is_cut_off(position: float, shown: str) -> None:
    model = seen()
    state = BusState(stamp=1, servos=[ServoState(id=1, position=position, temperature=104.0)])
    model.on_state("main", state, 1.9)
    assert columns(line_with(screen(model), "joint 1")).endswith(f" {shown} 11.9 104")


def test_a_faulty_cable_is_marked_where_it_leads_to_and_silent_servos_tell_since_when() -> None:
    model = seen(silent_from=4, faults=health(record("cable_break", CABLE)))
    lines = screen(model)
    assert columns(line_with(lines, "joint 4")) == (
        "╳○ 4 XM430-W210 joint 4 never - 100% - - - cable_break"
    )
    assert line_with(lines, "joint 3").startswith(" │●")
    assert "3 s" in line_with(screen(model, now_s=5.0), "joint 3")


def test_an_active_fault_shows_confidence_since_message_and_remedy() -> None:
    lines = screen(seen(faults=health(record("cable_break", CABLE))))
    assert line_with(lines, "▲ cable_break", "98%", "12 s")
    assert line_with(lines, "The cable between servo 3 and servo 4 on bus main is disconnected")
    assert line_with(lines, "→ Push both plugs of this cable home")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (record("noise", "bus/main", "pending"), ["noise", "not confirmed yet"]),
        (record("noise", "bus/main", "unknown"), ["noise", "its source classifier is silent"]),
        (record("noise", "bus/main", "healed"), ["✓ healed 2 s ago: noise, bus main"]),
        (
            record("packet_loss", "bus/main/servo/3", inhibited_by=f"{CABLE}/cable_break"),
            ["packet_loss, servo 3 on bus main: follows from cable_break, the cable between"],
        ),
    ],
)
def test_faults_in_other_states_say_so(fault: FaultRecord, words: list[str]) -> None:
    assert line_with(screen(seen(faults=health(fault)), width=120), *words)


def test_suspects_are_named() -> None:
    fault = record("servo_silent", "bus/main/servo/6")
    fault.suspects = ["bus/main/cable/5-6"]
    lines = screen(seen(faults=health(fault)))
    assert line_with(lines, "It may also be the cable between servo 5 and servo 6 on bus main.")


def test_services_that_are_not_ready_come_first_and_ready_ones_are_counted_when_narrow() -> None:
    model = seen(faults=health())
    assert screen(model)[-1] == "services  classifier/main dead (gone)  gateway/main ready"
    assert screen(model, width=50)[-1] == "services  classifier/main dead (gone)  1 ready"


def test_old_health_is_unknown_and_told_with_its_age() -> None:
    lines = screen(seen(faults=health()), now_s=9.9)
    assert lines[0] == " UNKNOWN  testbot  health is 8 s old; then: a cable is broken"
    assert line_with(lines, "bus main", "8 s old")


def test_before_anything_is_heard_it_says_so() -> None:
    lines = screen(RobotModel(config(2)))
    assert "no health yet: does the aggregator run?" in lines[0]
    assert lines[1] == "bus main  nothing heard yet"
    assert "no bus is heard of yet" in screen(RobotModel(RobotConfig()))[1]


@pytest.mark.parametrize(("servos", "as_table"), [(12, True), (20, False)])
def test_a_chain_too_long_for_a_table_becomes_compact_and_leaves_room_for_the_fault(
    servos: int, as_table: bool
) -> None:
    lines = screen(seen(servos, faults=health(record("cable_break", CABLE))))
    assert any("joint" in line for line in lines) is as_table
    assert len(lines) <= 24
    assert line_with(lines, "→ Push both plugs of this cable home")
    assert any("╳● " in line and "cable_break" in line for line in lines)


def test_faults_beyond_the_terminal_are_counted() -> None:
    faults = [record(code, "bus/main") for code in ("noise", "stray_data", "permanent_jammer")]
    lines = screen(seen(12, faults=health(*faults)))
    assert len(lines) == 24
    assert line_with(lines, "… ", " more lines")


@settings(max_examples=50, deadline=None)
@given(width=st.integers(1, 300), height=st.integers(0, 100), servos=st.integers(0, 30))
def test_it_never_exceeds_the_terminal(width: int, height: int, servos: int) -> None:
    model = RobotModel(config(servos))
    model.on_health(health(record("cable_break", CABLE), record("noise", "bus/main", "healed")), 0)
    lines = render(model, 1.0, width, height)
    assert len(lines) <= height
    assert all(line.cell_len <= width for line in lines)


def test_text_from_the_network_cannot_steer_the_terminal() -> None:
    lines = screen(seen(faults=health(summary="\x1b[2J\x07 gone")))
    assert "\x1b" not in "".join(lines)


def test_a_robot_without_configuration_is_learnt_from_its_messages() -> None:
    model = RobotModel(RobotConfig())
    model.on_state("arm", BusState(stamp=1, servos=[ServoState(id=9, position=1.0)]), 0.0)
    assert list(model.buses["arm"].servos) == [9]


def test_what_makes_no_sense_is_rejected() -> None:
    model = RobotModel(RobotConfig())
    with pytest.raises(Rejected, match="999 is no id of a servo"):
        model.on_state("arm", BusState(stamp=1, servos=[ServoState(id=999)]), 0.0)
    with pytest.raises(Rejected, match="is one too many"):
        for number in range(100):
            model.on_state(f"b{number}", BusState(stamp=1, servos=[]), 0.0)


def test_loss_is_counted_anew_after_the_gateway_restarted() -> None:
    model = RobotModel(config(1))

    def statistics(boot: int, expected: int, received: int) -> BusStatistics:
        counters = [ServoStatistics(id=1, expected=expected, received=received)]
        return BusStatistics(
            stamp=1,
            boot=boot,
            mode="poll",
            port="",
            connected=True,
            baud_rate=57600,
            servos=counters,
        )

    for boot, expected, received in ((1, 100, 100), (1, 200, 150), (2, 10, 10)):
        model.on_statistics("main", statistics(boot, expected, received), 0.0)
    assert model.buses["main"].servos[1].loss is None
    model.on_statistics("main", statistics(2, 110, 85), 1.0)
    assert model.buses["main"].servos[1].loss == pytest.approx(0.25)


def test_for_programs_there_is_json() -> None:
    snapshot = json.loads(seen(faults=health(record("cable_break", CABLE))).as_json(2.5))
    assert snapshot["health"]["faults"][0]["code"] == "cable_break"
    assert snapshot["health_age_s"] == pytest.approx(0.6)
    servo = snapshot["buses"]["main"]["servos"][2]
    assert (servo["id"], servo["hz"], servo["position"]) == (3, 100.0, 0.375)


@pytest.mark.process
def test_once_shows_the_latched_health_of_a_running_robot(
    rendezvous: Rendezvous, tmp_path: Path
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(dump(rendezvous.config))
    with Link(rendezvous.config, "peer") as link:
        link.publisher(HEALTH).put(health(summary="nothing to see"))
        for arguments, expected in (
            (["--once"], "nothing to see"),
            (["--once", "--json"], '"summary":"nothing to see"'),
        ):
            done = subprocess.run(
                [sys.executable, "-m", "wackel_cli", "top", "--config", path, *arguments],
                capture_output=True,
                text=True,
                timeout=30,
                check=False,
            )
            assert (done.returncode, done.stderr) == (0, "")
            assert expected in done.stdout


def on_wheels(*faults: FaultRecord, valid: bool = True) -> RobotModel:
    """A robot that drives, with six servos that answer."""
    model = seen()
    model.wheels = ["front", "left", "right"]
    model.on_odometry(
        Odometry(
            stamp=STAMP,
            x=1.234,
            y=-0.5,
            theta=math.pi / 2,
            vx=0.3,
            vy=0.4,
            omega=-0.1,
            pose_covariance=[0.0] * 9,
            twist_covariance=[0.0] * 9,
            valid=valid,
            reason="" if valid else "no wheels",
        ),
        1.9,
    )
    model.on_health(health(*faults), 1.9)
    return model


def plain(model: RobotModel, now_s: float = 2.0, width: int = 100, height: int = 24) -> list[str]:
    return [line.plain for line in render(model, now_s, width, height)]


def test_a_robot_on_wheels_shows_where_it_is_and_how_it_moves() -> None:
    lines = plain(on_wheels())
    assert lines[1] == "drive  at +1.23 -0.50 m, +90°  0.50 m/s  -6 °/s"
    assert lines[2].rstrip() == "wheels  ● front  ● left  ● right"
    assert not any(line.startswith("drive") for line in plain(seen()))


def test_faults_of_the_drive_stand_at_their_wheels() -> None:
    lines = plain(
        on_wheels(
            record("wheel_blocked", "wheel/left/drive"),
            record("gyro_frozen", "gyro/body"),
        )
    )
    assert "● left drive: wheel_blocked  ● right" in lines[2]
    assert lines[2].endswith("● gyro/body: gyro_frozen")


def style_of(line: Text, words: str) -> str:
    """How words stand in a line."""
    spans = [span for span in line.spans if words in line.plain[span.start : span.end]]
    assert spans, (words, line)
    return str(spans[-1].style)


def dots(line: Text) -> list[str]:
    """How the dots of a line stand there."""
    spans = [span for span in line.spans if "●" in line.plain[span.start : span.end]]
    return [str(span.style) for span in spans]


@pytest.mark.parametrize("height", [24, 8])
def test_what_a_silent_source_has_said_is_neither_a_fault_for_certain_nor_well(height: int) -> None:
    model = on_wheels(
        record("wheel_blocked", "wheel/left/drive", "unknown"),
        record("gyro_frozen", "gyro/body", "unknown"),
        record("noise", "bus/main", "unknown"),
        record("overload", "bus/main/servo/3", "unknown"),
    )
    _, _, wheels, bus, *chain = render(model, 2.0, 100, height)
    (servo,) = (line for line in chain if "●  3" in line.plain)
    for line, words in (
        (wheels, "drive: wheel_blocked"),
        (wheels, "gyro/body: gyro_frozen"),
        (bus, "noise"),
        (servo, "overload"),
    ):
        assert style_of(line, words) == "magenta"
    assert dots(wheels) == ["green", "magenta", "green", "magenta"]


def test_a_wheel_whose_values_are_missing_is_not_well() -> None:
    model = on_wheels(record("cable_break", CABLE))
    assert model.odometry is not None
    model.odometry.inputs = [
        InputState(name="wheel/front/roll", result="rejected"),
        InputState(name="wheel/left/roll", result="used"),
        InputState(name="wheel/left/slide", result="missing"),
    ]
    wheels = render(model, 2.0, 100, 24)[2]
    assert "● left no values  ● right" in wheels.plain
    assert dots(wheels) == ["green", "magenta", "green"]


def test_a_fault_for_certain_is_worse_than_one_whose_source_is_silent() -> None:
    blocked = record("wheel_blocked", "wheel/left/drive")
    slipping = record("wheel_free", "wheel/left/drive", "unknown")
    wheels = render(on_wheels(slipping, blocked), 2.0, 100, 24)[2]
    assert style_of(wheels, "wheel_free") == "magenta"
    assert dots(wheels) == ["green", "bold red", "green"]


def test_a_pose_that_is_old_or_not_valid_says_so() -> None:
    assert plain(on_wheels(), now_s=10.0)[1].endswith("8 s old")
    assert plain(on_wheels(valid=False))[1].endswith("not valid: no wheels")
    nothing = seen()
    nothing.wheels = ["left"]
    assert "does the odometry run" in plain(nothing)[1]


@pytest.mark.parametrize(("width", "height"), [(80, 24), (40, 10), (20, 3)])
def test_the_drive_fits_every_terminal(width: int, height: int) -> None:
    lines = plain(on_wheels(), width=width, height=height)
    assert len(lines) <= height
    assert max(map(len, lines)) <= width


def test_a_drive_is_part_of_the_json() -> None:
    told = json.loads(on_wheels().as_json(2.0))
    assert told["wheels"] == ["front", "left", "right"]
    assert told["odometry"]["x"] == 1.234
    assert told["odometry_age_s"] == 0.1
