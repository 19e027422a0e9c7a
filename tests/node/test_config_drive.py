"""[drive] and [gyros]: what is wrong with them is told in one line."""

import pytest

from wackel_node.config import ConfigError, dump, parse

BUS = '[buses.main]\nport = "p"\nservos = [{id = 1}, {id = 2}, {id = 3}]\n'


def wheel(**changes: object) -> str:
    fields = {"name": "a", "x": 0.0, "y": 0.2, "radius": 0.05, "bus": "main", "drive": 1}
    fields |= changes
    lines = [
        f"{key} = {value!r}".replace("'", '"') for key, value in fields.items() if value is not None
    ]
    return "[[drive.wheels]]\n" + "\n".join(lines) + "\n"


def drive(*wheels: str, kind: str = "differential", more: str = "") -> str:
    return BUS + f'[drive]\nkind = "{kind}"\n{more}\n' + "".join(wheels)


def gyro(registers: str = "", **fields: object) -> str:
    lines = [f"{key} = {value!r}" for key, value in fields.items()]
    table = f"[gyros.body.registers]\n{registers}\n" if registers else ""
    return BUS + "[gyros.body]\n" + "\n".join(lines) + "\n" + table


LEFT, RIGHT = wheel(), wheel(name="b", y=-0.2, drive=2)


MISTAKES = {
    drive(LEFT, RIGHT, kind="tank"): "drive.kind = 'tank': allowed are 'ackermann', "
    "'differential', 'mecanum', 'omni', 'steered', 'tricycle'",
    drive(): "drive.wheels: kind 'differential' needs 2 or more, each with drive and none with "
    "steering",
    drive(LEFT, LEFT): "drive.wheels: name 'a' stands there twice",
    drive(LEFT, wheel(name="b", drive=2)): "drive.wheels: the left and the right wheels must stand "
    "apart (y)",
    drive(LEFT, wheel(name="b", y=-0.2)): "drive.wheels[1]: servo 1 on bus main moves wheel 'a'",
    drive(LEFT, wheel(name="b", y=-0.2, drive=9)): "drive.wheels[1]: there is no servo 9 on bus "
    "main",
    drive(LEFT, wheel(name="b", y=-0.2, bus="x")): "drive.wheels[1]: there is no bus 'x'; known "
    "are main",
    drive(LEFT, wheel(name="b", x=None, drive=2)): "drive.wheels[1] needs its place: either x and "
    "y, or l and alpha",
    drive(LEFT, wheel(name="b", l=1.0, drive=2)): "drive.wheels[1] needs its place: either x and "
    "y, or l and alpha",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, direction=0)): "drive.wheels[1].direction = 0: "
    "allowed are 1, -1",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, direction=10**19)): "drive.wheels[1].direction = "
    "10000000000000000000: allowed are 1, -1",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, radius=0)): "drive.wheels[1].radius = 0: allowed "
    "is a number, above 0 … 1 m",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, radius=33)): "drive.wheels[1].radius = 33: "
    "allowed is a number, above 0 … 1 m",
    drive(LEFT, wheel(name="b", y=-120, drive=2)): "drive.wheels[1].y = -120: allowed is a number, "
    "-10 … 10 m",
    drive(LEFT, wheel(name="b", x=None, y=None, l=120, alpha=0, drive=2)): "drive.wheels[1].l = "
    "120: allowed is a number, 0 … 10 m",
    drive(LEFT, wheel(name="b", x=None, y=None, l=0.2, alpha=-90, drive=2)): "drive.wheels[1]"
    ".alpha = -90: allowed is a number, -10 … 10 rad",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, heading=45)): "drive.wheels[1].heading = 45: "
    "allowed is a number, -10 … 10 rad",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, steering_offset=45)): "drive.wheels[1]"
    ".steering_offset = 45: allowed is a number, -10 … 10 rad",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, roller=45)): "drive.wheels[1].roller = 45: "
    "allowed is a number, -1.39626 … 1.39626 rad",
    drive(LEFT, RIGHT, more="track = 240"): "drive.track = 240: allowed is a number, above 0 … "
    "10 m",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, steering_bus="main")): "drive.wheels[1]"
    ".steering_bus is useless without steering",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, heading=0.5)): "drive.wheels[1].heading: the "
    "wheels of a differential drive roll forward",
    drive(LEFT, wheel(name="b", y=-0.2, drive=2, roller=0.5)): "drive.wheels[1].roller: a drive of "
    "kind 'differential' has none",
    drive(LEFT, RIGHT, kind="steered"): "drive.wheels: kind 'steered' needs 3 or more, each with "
    "the ids drive and steering",
    drive(LEFT, RIGHT, kind="tricycle"): "drive.wheels: kind 'tricycle' needs 3 or more, one of "
    "them with steering, and one with drive",
    drive(LEFT, RIGHT, kind="ackermann"): "drive.wheels: kind 'ackermann' needs 4 or more, two of "
    "them with steering, and one with drive",
    drive(LEFT, RIGHT, kind="omni"): "drive.wheels: kind 'omni' needs 3 or more, each with drive "
    "and none with steering",
    drive(LEFT, RIGHT, wheel(name="c", drive=3), kind="mecanum"): "drive.wheels[0].roller is "
    "missing: the angle of the rollers, mostly ±0.7854 (pi/4)",
    drive(
        *(wheel(name=n, x=0.0, y=0.0, drive=i) for i, n in enumerate("abc", 1)), kind="omni"
    ): "drive.wheels: at least one must stand away from the origin",
    drive(
        *(wheel(name=n, y=i, drive=i) for i, n in enumerate("abc", 1)), kind="omni", more="track=1"
    ): "drive.track: a drive of kind 'omni' has none",
    gyro(source="bus"): "gyros.body.bus is missing: source = 'bus' needs it",
    gyro(source="bus", bus="main", id=200): "gyros.body.registers is missing: source = 'bus' needs "
    "it",
    gyro("z = { address = 68 }"): "gyros.body.registers is useless without source = 'bus'",
    gyro(
        "z = { address = 68 }", source="bus", bus="leg", id=200
    ): "gyros.body.bus = 'leg': there is no such bus in mode poll; known are main",
    gyro("z = { address = 68 }", source="bus", bus="main", id=3): "gyros.body.id = 3: bus main has "
    "a servo of this id",
    gyro(
        "x = { address = 60 }", source="bus", bus="main", id=200
    ): "gyros.body.registers: axis 'z' points up, so z must be there",
    gyro(
        "z = { address = 68 }\nx = { address = 0 }", source="bus", bus="main", id=200
    ): "gyros.body.registers: they must lie within 64 bytes, to be read in one go",
    gyro("z = { address = 68 }", source="bus", bus="main", id=200, rate=400): "gyros.body.rate = "
    "400: it is read in every cycle of bus main, 100 a second",
    gyro("q = { address = 68 }"): "gyros.body.registers.q: allowed are 'x', 'y', 'z'",
    gyro("z = { address = 68, encoding = 'float' }"): "gyros.body.registers.z.encoding = 'float': "
    "allowed are 'float32', 'int16', 'int32'",
    gyro(
        "z = { address = 68, encoding = 'int16' }", source="bus", bus="main", id=200
    ): "gyros.body.registers.z.scale is missing: encoding = 'int16' needs rad/s for a value of 1",
    gyro(
        "z = { address = 68, encoding = 'int32' }", source="bus", bus="main", id=200
    ): "gyros.body.registers.z.scale is missing: encoding = 'int32' needs rad/s for a value of 1",
    gyro(
        "z = { address = 68, scale = 0.0 }", source="bus", bus="main", id=200
    ): "gyros.body.registers.z.scale = 0: the gyro would always show that it stands",
    gyro(source="iio"): "gyros.body.device is missing: source = 'iio' needs it",
    gyro(device="bmi160"): "gyros.body.device is useless without source = 'iio'",
    '[gyros.body]\naxis = "up"': "gyros.body.axis = 'up': allowed are '-x', '-y', '-z', 'x', "
    "'y', 'z'",
    "[gyros.body]\nnoise_density = 0": "gyros.body.noise_density = 0: allowed is a number greater "
    "than 0",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_told_by_its_place(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(text)
    assert str(caught.value) == f"robot.toml: {MISTAKES[text]}"


def placed(kind: str, *wheels: dict[str, object]) -> str:
    """A drive whose wheels differ from one another as told; no bus says which servos there are."""
    each = (wheel(name=f"w{i}", drive=i, **told) for i, told in enumerate(wheels))
    return drive(*each, kind=kind).replace("servos", "# servos")


def corners(*rollers: float) -> list[dict[str, object]]:
    """Of a square; front left, front right, rear left, rear right."""
    places = [(0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1)]
    return [{"x": x, "y": y, "roller": r} for (x, y), r in zip(places, rollers, strict=True)]


THIRD = 2.0944  # rad
SAME_PLACE = "'w0' and 'w2' stand in one place"
SAME_WAY = "all push in the same direction, so the robot cannot go sideways to it (heading)"
SAME_POINT = "all push through the same point, so they cannot turn the robot (heading, roller)"
IMMOBILE = {
    placed(
        "steered", *({"x": x, "y": 0.0, "steering": i} for i, x in ((4, 0.1), (5, 0.2), (6, 0.1)))
    ): SAME_PLACE,
    placed("omni", *({"x": x, "heading": THIRD * x} for x in (1, 2, 1))): SAME_PLACE,
    placed("omni", *({"y": y, "heading": 0.0} for y in (1, 2, 3))): SAME_WAY,
    placed("omni", *({"y": y, "heading": 3.1416 * y} for y in (1, 2, 3))): SAME_WAY,
    placed(
        "omni",
        *({"x": None, "y": None, "l": 1, "alpha": a, "heading": a} for a in (0, THIRD, -THIRD)),
    ): SAME_POINT,
    placed("mecanum", *corners(0.785, -0.785, -0.785, 0.785)): SAME_POINT,
}


@pytest.mark.parametrize("text", IMMOBILE)
def test_a_drive_that_cannot_move_in_all_its_ways_is_refused(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(text)
    assert str(caught.value) == f"robot.toml: drive.wheels: {IMMOBILE[text]}"


def test_rollers_that_form_an_x_move_it() -> None:
    assert parse(placed("mecanum", *corners(-0.785, 0.785, 0.785, -0.785))).drive is not None


def test_what_is_printed_with_all_defaults_reads_as_the_same() -> None:
    config = parse(drive(LEFT, RIGHT, more="track = 0.5") + "[gyros.body]\naxis = '-x'\n")
    assert config.drive is not None
    assert config.gyros["body"].axis == "-x"
    assert parse(dump(config)) == config


def test_a_gyro_on_a_bus_is_printed_and_read_again() -> None:
    config = parse(gyro("z = { address = 68 }", source="bus", bus="main", id=200))
    register = config.gyros["body"].registers["z"]
    assert (register.end, register.factor) == (72, 1.0)
    assert parse(dump(config)) == config
