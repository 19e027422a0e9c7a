"""Scenario files, and what the running virtual robot does on request."""

from pathlib import Path

import pytest

from tests.virtual.material import MS, ids, raw
from wackel_node.config import ConfigError, RobotConfig
from wackel_protocols.dynamixel2 import packet
from wackel_schemas.virtual import Injection, VirtualRequest
from wackel_virtual import scenario
from wackel_virtual.service import obey

_WHOLE = """
seed = 7
loss = 0.0005
latency_ms = 1

[buses.legs]
port = "/tmp/legs"
baud_rate = 2000000
return_delay_us = 0
servos = [{ id = 4 }, { id = 2 }, { id = 9 }]

[[faults]]
kind = "break"
servo = 9
start_s = 2
duration_s = 3

[[faults]]
kind = "noise"
"""


def test_a_scenario_is_a_robot_and_what_goes_wrong_when():
    parsed = scenario.parse_scenario(_WHOLE)
    assert parsed.seed == 7
    assert parsed.faults == [
        Injection(kind="break", bus="legs", servo=9, start_s=2, duration_s=3),
        Injection(kind="noise", bus="legs", value=1e-5),
    ]
    bus = parsed.make()["legs"]
    request = packet.sync_read([4, 2, 9], 132, 4)

    def answered(at_s):
        return ids(bus.exchange(round(at_s * 1e9), request, 20 * MS, 2_000_000))

    assert answered(1) == [4, 2, 9]
    assert answered(4) == [4, 2]
    assert [fault.kind for fault in bus.active()] == ["break", "noise"]
    assert answered(6) == [4, 2, 9]


def test_a_scenario_without_a_robot_runs_the_usual_chain():
    parsed = scenario.parse_scenario("")
    (config,) = parsed.config.buses.values()
    assert config.ids() == tuple(range(1, 13))
    assert config.port == "wackel-bus"


def test_a_scenario_finds_its_robot_beside_it(tmp_path: Path):
    (tmp_path / "robot.toml").write_text('[buses.arm]\nport = "a"\nservos = [{ id = 3 }]\n')
    (tmp_path / "scenario.toml").write_text(
        'robot = "robot.toml"\n[[faults]]\nkind = "silent"\nservo = 3\n'
    )
    parsed = scenario.load_scenario(tmp_path / "scenario.toml")
    assert parsed.faults == [Injection(kind="silent", bus="arm", servo=3)]


_TWO_BUSES = "[buses.a]\nport = 'a'\nservos = [{id = 1}]\n[buses.b]\nport = 'b'\n"


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("seed = x", "s.toml: not TOML"),
        ("sed = 1", "sed"),
        ("loss = 2", "loss"),
        ("[[faults]]\nservo = 1", "faults[0]"),
        ("[[faults]]\nkind = 'break'\nservos = 1", "faults[0].servos"),
        ("[[faults]]\nkind = 'brake'\nservo = 1", "s.toml: faults[0]: kind 'brake' is unknown"),
        ("[[faults]]\nkind = 'break'\nservo = 77", "servo 77 is not on this bus"),
        ("[[faults]]\nkind = 'noise'\nstart_s = -1", "faults[0].start_s"),
        ("[[faults]]\nkind = 'noise'\nbus = 'x'", "there is no bus 'x'; there are main"),
        (_TWO_BUSES + "[[faults]]\nkind = 'noise'", "faults[0]: name the bus; there are a, b"),
        ("robot = 'r.toml'\n" + _TWO_BUSES, "robot and buses exclude each other"),
        ("taps = { x = 't' }", "s.toml: taps: there is no bus 'x'; there are main"),
        ("taps = { main = 'wackel-bus' }", "taps: main = 'wackel-bus': the port is taken"),
        ("robot = 'nowhere.toml'", "nowhere.toml: no such file"),
        ("[buses.a]\nport = 'a'\nservos = [{id = 1}, {id = 1}]", "id 1 stands there twice"),
    ],
)
def test_a_wrong_scenario_gets_one_line_that_names_the_place(text, error):
    with pytest.raises(ConfigError) as caught:
        scenario.parse_scenario(text, Path("s.toml"))
    assert error in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_scenario_may_have_a_second_adapter_that_only_listens():
    parsed = scenario.parse_scenario("taps = { b = 'tap' }\n" + _TWO_BUSES)
    assert parsed.taps == {"b": "tap"}
    for name, bus in parsed.make().items():
        bus.transmit(0, packet.ping(1), 1_000_000)
        assert bool(bus.overheard(9 * MS)) is (name == "b")


def test_an_unknown_model_is_named_with_its_bus():
    text = "[buses.a]\nport = 'a'\nservos = [{ id = 1, model = 'XM999' }]"
    with pytest.raises(ConfigError, match=r"buses\.a\.servos\[0\]\.model: no model"):
        scenario.parse_scenario(text).make()


def test_a_byte_order_mark_of_windows_does_no_harm(tmp_path: Path):
    path = tmp_path / "scenario.toml"
    path.write_text("seed = 7", encoding="utf-8-sig")
    assert scenario.load_scenario(path).seed == 7


def test_a_missing_file_is_said_so(tmp_path: Path):
    with pytest.raises(ConfigError, match="cannot be read"):
        scenario.load_scenario(tmp_path / "none.toml")


def test_buses_of_one_robot_have_different_randomness():
    servos = "servos = [{ id = 1 }, { id = 2 }]"
    text = f"[buses.a]\nport = 'a'\n{servos}\n[buses.b]\nport = 'b'\n{servos}\n"
    one, other = scenario.parse_scenario(text).make().values()
    request = packet.read(1, 132, 4)
    assert raw(one.exchange(MS, request, 9 * MS)) != raw(other.exchange(MS, request, 9 * MS))


def requested(*requests, text=_TWO_BUSES):
    parsed = scenario.parse_scenario(text)
    buses = parsed.make()
    return [obey(request, buses, parsed.config) for request in requests]


def test_requests_inject_list_and_heal():
    injected, listed, healed, nothing = requested(
        VirtualRequest(operation="inject", injection=Injection(kind="break", bus="a", servo=1)),
        VirtualRequest(operation="list"),
        VirtualRequest(operation="heal", injection=Injection(kind="break", servo=1)),
        VirtualRequest(operation="heal"),
    )
    assert injected.text == "injected break at servo 1 on bus a"
    assert listed.active == injected.active == [Injection(kind="break", bus="a", servo=1)]
    assert (healed.text, healed.active) == ("healed break at servo 1 on bus a", [])
    assert (nothing.ok, nothing.text) == (True, "nothing to heal")


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (VirtualRequest(operation="inject"), "inject needs an injection"),
        (VirtualRequest(operation="inject", injection=Injection(kind="noise")), "name the bus"),
        (
            VirtualRequest(operation="inject", injection=Injection(kind="oops", bus="a")),
            "kind 'oops' is unknown",
        ),
        (
            VirtualRequest(operation="heal", injection=Injection(kind="", bus="x")),
            "there is no bus 'x'",
        ),
    ],
)
def test_a_request_that_cannot_be_obeyed_is_refused_with_a_reason(request_, text):
    (reply,) = requested(request_)
    assert not reply.ok
    assert reply.text.startswith(text)


def test_a_robot_without_buses_gets_the_usual_one():
    assert list(scenario.of_robot(RobotConfig(), 3).make()) == ["main"]


_ON_WHEELS = """
robot = "robot.toml"

[[faults]]
kind = "break"
servo = 3
start_s = 1

[[faults]]
kind = "wheel_blocked"
wheel = "left"
start_s = 2
"""
_ROBOT = """
[buses.legs]
port = "unused"
return_delay_us = 0
servos = [{ id = 1 }, { id = 2 }, { id = 3 }]

[drive]
kind = "differential"
wheels = [
    { name = "left", x = 0, y = 0.2, radius = 0.05, bus = "legs", drive = 1 },
    { name = "right", x = 0, y = -0.2, radius = 0.05, bus = "legs", drive = 2 },
]
"""


def on_wheels(directory: Path, text: str = _ON_WHEELS) -> scenario.Scenario:
    (directory / "robot.toml").write_text(_ROBOT)
    return scenario.parse_scenario(text, directory / "broken.toml")


def test_faults_of_the_bus_and_of_the_drive_share_a_file(tmp_path):
    parsed = on_wheels(tmp_path)
    buses = parsed.make()
    drive = parsed.make_drive(buses)
    active = {}
    for second in (1.5, 2.5):
        buses["legs"].advance(round(second * 1e9))
        drive.advance(round(second * 1e9))
        reply = obey(VirtualRequest(operation="list"), buses, parsed.config, drive)
        active[second] = [(fault.kind, fault.bus, fault.wheel) for fault in reply.active]
    assert active[1.5] == [("break", "legs", None)]
    assert active[2.5] == [("break", "legs", None), ("wheel_blocked", "", "left")]


def test_faults_of_the_drive_are_injected_and_healed_on_request(tmp_path):
    parsed = on_wheels(tmp_path, 'robot = "robot.toml"')
    buses = parsed.make()
    drive = parsed.make_drive(buses)

    def ask(operation, **injection):
        request = VirtualRequest(operation=operation, injection=Injection(**injection))
        reply = obey(request, buses, parsed.config, drive)
        drive.advance(drive.move_ns())
        return reply

    reply = ask("inject", kind="wheel_blocked", wheel="right")
    assert (reply.ok, reply.text) == (True, "injected wheel_blocked at wheel right")
    assert ask("inject", kind="break", servo=2).text == "injected break at servo 2 on bus legs"
    assert ask("heal", kind="", servo=2).text == "healed break at servo 2 on bus legs"
    assert ask("heal", kind="", wheel="left").text == "nothing to heal"
    assert ask("heal", kind="", wheel="right").text == "healed wheel_blocked at wheel right"
    refused = ask("inject", kind="steering_blocked", wheel="left")
    assert (refused.ok, refused.text) == (
        False,
        "steering_blocked: no wheel of this robot has a steering of its own",
    )
    assert not ask("inject", kind="break", servo=2, wheel="left").ok


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ('kind = "wheel_blocked"', "needs a wheel; there are left, right"),
        ('kind = "wheel_blocked"\nwheel = "front"', "no wheel 'front'"),
        ('kind = "push"\nvalue = -1', "must be from 0 to 10"),
        ('kind = "noise"\nwheel = "left"', "leave out the wheel"),
    ],
)
def test_a_wrong_fault_of_the_drive_is_refused_with_its_place(fault, text, tmp_path):
    with pytest.raises(ConfigError, match=r"faults\[0\].*" + text):
        on_wheels(tmp_path, f'robot = "robot.toml"\n[[faults]]\n{fault}\n')


def test_a_robot_without_wheels_has_no_drive_to_break():
    assert scenario.parse_scenario("").make_drive({}) is None
    with pytest.raises(ConfigError, match=r"the robot has no \[drive\]"):
        scenario.parse_scenario('[[faults]]\nkind = "push"')


def test_the_example_in_the_documentation_is_a_scenario():
    example = Path(__file__).parents[2] / "docs" / "examples" / "broken-cable.toml"
    kinds = [fault.kind for fault in scenario.load_scenario(example).faults]
    assert kinds == ["loose_contact", "break"]
