"""A wrong configuration is told in one line that names the key, what is there, what is allowed."""

import json
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wackel_node.config import (
    BusConfig,
    ConfigError,
    LooseContactConfig,
    RobotConfig,
    ServoConfig,
    dump,
    load,
    parse,
)
from wackel_protocols.dynamixel2 import control_table

BUS = '[buses.main]\nport = "/dev/ttyUSB0"\n'

MISTAKES = {
    'robot = "My Robot"': "robot = 'My Robot': allowed is a name of a-z, 0-9, - and _ that starts "
    "with a letter or digit",
    "robot = 3": "robot = 3: allowed is a name of a-z, 0-9, - and _ that starts with a letter or "
    "digit",
    "rob = 1": "rob: unknown key; did you mean robot?",
    "zorro = 1": "zorro: unknown key; known are robot, buses, drive, gyros, zenoh, classifier, "
    "recorder, state_directory",
    "buses = 3": "buses = 3: allowed is a table",
    "[buses.main]": "buses.main.port is missing: allowed is the path of a serial port such as "
    "'/dev/ttyUSB0'",
    '[buses.main]\nport = ""': "buses.main.port = '': allowed is the path of a serial port such as "
    "'/dev/ttyUSB0'",
    '[buses.main]\nport = "a\\u0000"': r"buses.main.port = 'a\x00': allowed is the path of a "
    "serial port such as '/dev/ttyUSB0'",
    BUS + 'proxy_port = "\\u0000"': r"buses.main.proxy_port = '\x00': allowed is a path, or '' for "
    "none; no path has a NUL",
    'state_directory = "\\u0000"': r"state_directory = '\x00': allowed is a path, or '' for none; "
    "no path has a NUL",
    'recorder.directory = "\\u0000"': r"recorder.directory = '\x00': allowed is a path, or '' for "
    "none; no path has a NUL",
    BUS + "baudrate = 3": "buses.main.baudrate: unknown key; did you mean baud_rate?",
    BUS + 'baud_rate = "fast"': "buses.main.baud_rate = 'fast': allowed are 9600, 57600, 115200, "
    "1000000, 2000000, 3000000, 4000000, 4500000, 6000000, 10500000",
    BUS + "baud_rate = 12345": "buses.main.baud_rate = 12345: allowed are 9600, 57600, 115200, "
    "1000000, 2000000, 3000000, 4000000, 4500000, 6000000, 10500000",
    BUS + 'mode = "pol"': "buses.main.mode = 'pol': allowed are 'poll', 'proxy', 'tap'",
    BUS + "rate = 0": "buses.main.rate = 0: allowed is a number, above 0 … 2000",
    BUS + "rate = true": "buses.main.rate = true: allowed is a number, above 0 … 2000",
    BUS + "nominal_voltage = nan": "buses.main.nominal_voltage = nan: allowed is a number greater "
    "than 0",
    BUS + "nominal_voltage = 1e300": "buses.main.nominal_voltage = 1e+300: allowed is a number "
    "greater than 0, of a size below 1e+18",
    "recorder.max_s = inf": "recorder.max_s = inf: allowed is a number greater than 0, of a "
    "size below 1e+18",
    BUS + "rate = 1e300": "buses.main.rate = 1e+300: allowed is a number, above 0 … 2000",
    BUS + "fast_sync_read = 1": "buses.main.fast_sync_read = 1: allowed are true and false",
    BUS + "servos = 1": "buses.main.servos = 1: allowed is a list",
    BUS + "servos = [{id = 1}, {id = 253}]": "buses.main.servos[1].id = 253: allowed is a whole "
    "number, 0 … 252",
    BUS + "servos = [{id = 1}, {id = 1}]": "buses.main.servos: id 1 stands there twice; every id "
    "is used once a bus",
    BUS + 'mode = "proxy"': "buses.main.proxy_port is missing: mode = 'proxy' needs the path at "
    "which your software opens the port",
    BUS + '[buses.arm]\nport = "/dev/ttyUSB0"': "buses.arm.port = '/dev/ttyUSB0': bus main has it "
    "already",
    '[buses."l r"]\nport = "x"': "buses.'l r': allowed is a name of a-z, 0-9, - and _ that starts "
    "with a letter or digit",
    "zenoh.lease_ms = 1": "zenoh.lease_ms = 1: allowed is a whole number, 100 … 60000",
    'zenoh.endpoint = "localhost"': "zenoh.endpoint = 'localhost': allowed is a Zenoh endpoint "
    "such as 'tcp/127.0.0.1:7447'",
    "classifier.loose_contact.evenness = 7": "classifier.loose_contact.evenness = 7: allowed is a "
    "number, 0 … 1",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_told_by_key_value_and_what_is_allowed(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(text)
    assert str(caught.value) == f"robot.toml: {MISTAKES[text]}"


@pytest.mark.parametrize("text", ["=", "a = [", "a = " + "[" * 9999, "a = " + "9" * 9999, "\0"])
def test_what_is_no_toml_is_told_in_one_line(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^robot.toml: not TOML: [^\n]+\Z"):
        parse(text)


def test_a_file_that_is_not_there_is_told_with_the_way_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file; `wackel scan --write"):
        load(tmp_path / "robot.toml")


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a = '\xff'"])
def test_a_file_that_is_no_text_is_told(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="cannot be read"):
        load(path)


def test_a_byte_order_mark_of_windows_does_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text('robot = "walker"', encoding="utf-8-sig")
    assert load(path).robot == "walker"


def test_a_directory_in_the_files_place_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load(tmp_path)


def test_an_empty_file_has_every_default() -> None:
    assert parse("") == RobotConfig()


# Beyond the basic plane JSON's escapes are not TOML's, which is a matter of this test alone.
plain = st.text(st.characters(exclude_categories=["Cs"], max_codepoint=0xFFFF), max_size=8)
paths = plain.filter(lambda path: "\0" not in path)
configs = st.builds(
    RobotConfig,
    robot=st.from_regex(r"\A[a-z0-9][a-z0-9_-]*\Z"),
    buses=st.dictionaries(
        st.from_regex(r"\A[a-z0-9][a-z0-9_-]*\Z"),
        st.builds(
            BusConfig,
            port=paths.filter(bool),
            servos=st.lists(
                st.builds(ServoConfig, id=st.integers(0, 252), role=plain),
                max_size=4,
                unique_by=lambda servo: servo.id,
            ),
            return_delay_us=st.none() | st.integers(0, 508),
            nominal_voltage=st.none() | st.floats(1e-9, 1e9),
            rate=st.floats(0, 2000, exclude_min=True),
        ),
        max_size=3,
    ).filter(lambda buses: len({bus.port for bus in buses.values()}) == len(buses)),
    state_directory=paths,
)


@settings(max_examples=60, deadline=None)
@given(configs)
def test_what_is_printed_reads_back_as_the_same(config: RobotConfig) -> None:
    assert parse(dump(config)) == config


KEYS = [
    *("robot", "buses", "zenoh", "classifier", "recorder", "state_directory"),
    *("main", "port", "baud_rate", "mode", "rate", "servos", "id", "power", "endpoint", "lease_ms"),
    *LooseContactConfig.__struct_fields__,
]
values = st.recursive(
    st.booleans()
    | st.integers()
    | st.integers(0, 253)
    | st.floats()
    | plain
    | st.sampled_from(["poll", "proxy", "dynamixel2", "tcp/127.0.0.1:7447"])
    | st.just(10**400),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(KEYS) | plain, inner, max_size=4)
    ),
    max_leaves=12,
)
trees = st.dictionaries(st.sampled_from(KEYS) | plain, values, max_size=4)
bus_trees = st.dictionaries(st.sampled_from([*BusConfig.__struct_fields__, "x"]), values)


@settings(max_examples=300, deadline=None)
@given(trees | bus_trees.map(lambda bus: {"buses": {"main": {"port": "p", **bus}}}))
def test_any_tree_is_a_configuration_or_one_line(tree: dict[str, Any]) -> None:
    text = _as_toml(tree)
    try:
        config = parse(text)
    except ConfigError as error:
        assert str(error).startswith("robot.toml: ")
        assert "not TOML" not in str(error)
        assert len(str(error).splitlines()) == 1
        assert len(str(error)) < 500
    else:
        assert parse(dump(config)) == config


def _as_toml(tree: dict[str, Any]) -> str:
    """Inline tables only, since a list may mix what has no other spelling."""

    def text(item: Any) -> str:
        match item:
            case dict():
                return "{" + ", ".join(f"{text(k)} = {text(v)}" for k, v in item.items()) + "}"
            case list():
                return "[" + ", ".join(map(text, item)) + "]"
            case float():
                return repr(item)
            case _:
                return json.dumps(item).replace("\x7f", "\\u007f")

    return "\n".join(f"{text(key)} = {text(item)}" for key, item in tree.items())


def test_values_without_a_place_in_a_configuration_are_told() -> None:
    with pytest.raises(ConfigError, match=rf"robot = {date(1979, 5, 27)}: allowed is a name"):
        parse("robot = 1979-05-27")


def test_a_model_that_is_in_no_table_is_told_with_what_is_similar() -> None:
    servo = '[[buses.a.servos]]\nid = 1\nmodel = "XM430-W21"'
    with pytest.raises(ConfigError, match=r"buses\.a\.servos\[0\]\.model: .*XM430-W210"):
        parse(f'[buses.a]\nport = "/dev/x"\n{servo}')


@given(name=st.text(max_size=12))
def test_any_model_name_is_taken_or_refused(name: str) -> None:
    text = dump(
        RobotConfig(buses={"a": BusConfig(port="p", servos=[ServoConfig(id=1, model=name)])})
    )
    try:
        model = control_table.configured(parse(text).buses["a"].servos[0].model)
    except ConfigError as error:
        assert "servos[0].model" in str(error)
    else:
        assert model.registers


def test_a_bus_is_not_faster_than_its_servos() -> None:
    servo = '[[buses.a.servos]]\nid = 1\nmodel = "XL-320"'
    with pytest.raises(ConfigError, match=r"baud_rate = 3000000: servo 1, a XL-320, .* 1000000"):
        parse(f'[buses.a]\nport = "/dev/x"\nbaud_rate = 3_000_000\n{servo}')
    assert parse(f'[buses.a]\nport = "/dev/x"\n{servo}').buses["a"].ids() == (1,)
