"""Messages to drawings."""

import json
import re
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.odometry.simulation import BUS, START_NS
from tests.view.material import CONFIG, fault, health, odometry, residuals
from wackel_node.config import RobotConfig
from wackel_schemas import component
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.drive import Exclusion, InputState, Odometry
from wackel_schemas.residuals import Candidate, Residuals
from wackel_schemas.wire import Rejected
from wackel_view.core import (
    HEALTH,
    LOG,
    ODOMETRY,
    PATH,
    RESIDUALS,
    ROBOT,
    TOPICS,
    TRANSFORMS,
    VELOCITY,
    View,
)
from wackel_view.drawing import BAD, DOUBTFUL, GOOD, UNKNOWN
from wackel_view.layout import layout

LAYOUT = Path(__file__).parents[2] / "docs" / "view-layout.json"
REPEATED = (1.0, -2.5, float("nan"), float("inf"), 1e300, -1e300)


def shown(drawn: list[tuple[str, object]], topic: str) -> str:
    """What a topic gets, as text."""
    return "\n".join(repr(message) for name, message in drawn if name == topic)


def colour(view: View, odometry: Odometry, wheel: str) -> str:
    """Which of the colours a wheel has."""
    scene = shown(view.odometry(odometry), ROBOT)
    part = re.search(rf'id: "wheel {wheel}".*?color: Some\((Color {{[^}}]*}})\)', scene)
    assert part is not None
    names = {"good": GOOD, "doubtful": DOUBTFUL, "bad": BAD, "unknown": UNKNOWN}
    numbers = re.findall(r"[0-9.]+", part[1])
    for name, each in names.items():
        if re.findall(r"[0-9.]+", repr(each)) == numbers:
            return name
    raise AssertionError(part[1])


def test_the_robot_its_place_and_its_path_are_drawn() -> None:
    view = View(CONFIG)
    drawn = view.odometry(odometry(x=1.5))
    assert [topic for topic, _ in drawn] == [ODOMETRY, TRANSFORMS, ROBOT, PATH]
    assert 'parent_frame_id: "odom"' in shown(drawn, TRANSFORMS).replace(
        "parent_frame_id=", "parent_frame_id: "
    )
    scene = shown(drawn, ROBOT)
    assert all(f'id: "wheel w{i}"' in scene for i in range(3))
    assert "lifetime: Some(Duration { sec: 2" in scene  # silence shows
    (raw,) = [message for topic, message in drawn if topic == ODOMETRY]
    assert isinstance(raw, bytes)
    assert json.loads(raw)["x"] == 1.5


def test_no_more_is_drawn_than_can_be_seen_and_a_step_back_in_time_is() -> None:
    view = View(CONFIG)
    times = [i / 100 for i in range(100)]
    drawings = [bool(view.odometry(odometry(after_s))) for after_s in times]
    assert 20 < sum(drawings) < 35
    assert view.odometry(odometry(-100.0))


def test_the_path_grows_with_the_distance_and_begins_anew_where_the_pose_was_set() -> None:
    view = View(CONFIG)
    lengths = []
    for step, x in enumerate((0.0, 0.001, 0.1, 0.2, 0.2, 5.0)):
        path = shown(view.odometry(odometry(float(step), x=x)), PATH)
        lengths.append(path.count("Vector3"))
    assert lengths == [1, 1, 2, 3, 3, 1]
    assert shown(view.odometry(odometry(5.1, x=5.1)), PATH) == ""  # twice a second is enough


def test_a_wheel_has_the_colour_of_the_worst_that_is_known_of_it() -> None:
    view = View(CONFIG)
    now = iter(range(1, 100))
    assert colour(view, odometry(float(next(now))), "w1") == "good"
    rejected = [InputState(name="wheel/w1/roll", result="rejected")]
    assert colour(view, odometry(float(next(now)), inputs=rejected), "w1") == "doubtful"
    missing = [*rejected, InputState(name="wheel/w1/slide", result="missing")]
    assert colour(view, odometry(float(next(now)), inputs=missing), "w1") == "unknown"
    out = Exclusion(component=component.wheel_drive("w1"), fault="sensor", reason="stuck")
    assert colour(view, odometry(float(next(now)), excluded=[out]), "w1") == "bad"
    assert colour(view, odometry(float(next(now)), excluded=[out]), "w2") == "good"
    view.health(health(fault("overload", component.servo(BUS, 101))), START_NS)  # steers w1
    assert colour(view, odometry(float(next(now))), "w1") == "bad"
    view.health(health(fault("wheel_blocked", "wheel/w2/drive", "pending")), START_NS)
    assert colour(view, odometry(float(next(now))), "w2") == "doubtful"
    assert colour(view, odometry(float(next(now))), "w1") == "good"
    silent = fault("wheel_blocked", "wheel/w2/drive", "unknown")  # what found it has died
    view.health(health(silent), START_NS)
    assert colour(view, odometry(float(next(now))), "w2") == "unknown"
    assert "wheel blocked" in shown(view.odometry(odometry(float(next(now)))), ROBOT)


def test_a_wheel_points_where_its_servo_steers_it() -> None:
    view = View(CONFIG)
    before = shown(view.odometry(odometry(1.0)), ROBOT)
    view.bus_state(BUS, BusState(stamp=1, servos=[ServoState(id=101, position=0.5)]))
    after = shown(view.odometry(odometry(2.0)), ROBOT)
    assert part(before, "w1") != part(after, "w1")
    assert part(before, "w2") == part(after, "w2")


def part(scene: str, wheel: str) -> str:
    found = re.search(rf'id: "wheel {wheel}".*?orientation: Some\(([^)]*)\)', scene)
    assert found is not None
    return found[1]


def test_the_velocity_space_shows_what_there_is() -> None:
    view = View(CONFIG)
    view.odometry(odometry())
    drawn = view.residuals(residuals())
    scene = shown(drawn, VELOCITY)
    for name in ("commanded", "odometry", "(1,2;1)", "(1,2;2)", "axes"):
        assert f'id: "{name}"' in scene
    assert "(1,3;1)" not in scene  # it determines no velocity
    assert shown(drawn, RESIDUALS)


def test_health_is_told_in_words_and_its_changes_in_a_log() -> None:
    view = View(CONFIG)
    first = view.health(health(), START_NS)
    assert "gateway/main is ready" in shown(first, LOG)
    blocked = fault("wheel_blocked", "wheel/w2/drive")
    second = view.health(health(blocked), START_NS)
    assert "confirmed: wheel/w2/drive has wheel_blocked. Repair it." in shown(second, LOG)
    told = json.loads(dict(second)[HEALTH])  # type: ignore[arg-type]
    assert told["level"] == "fault"
    assert "[confirmed] wheel/w2/drive has wheel_blocked." in told["text"]
    assert "but not can_drive" in told["text"]
    assert shown(view.health(health(blocked), START_NS), LOG) == ""
    healed = msgspec.structs.replace(blocked, status="healed")
    assert "healed" in shown(view.health(health(healed), START_NS), LOG)
    assert "gateway/main dead" in shown(view.health(health(gateway="dead"), START_NS), HEALTH)


def test_silence_is_not_health() -> None:
    view = View(CONFIG)
    view.health(health(), START_NS)
    assert view.tick(START_NS + 2_000_000_000) == []
    told = dict(view.tick(START_NS + 3_000_000_000))
    assert b"No health heard for 3 s" in told[HEALTH]  # type: ignore[operator]
    assert json.loads(told[HEALTH])["level"] == "unknown"  # type: ignore[arg-type]
    assert view.tick(START_NS + 4_000_000_000) == []
    assert json.loads(dict(view.health(health(), START_NS))[HEALTH])["level"] == "ok"  # type: ignore[arg-type]
    late = View(CONFIG)
    assert late.tick(START_NS) == []
    assert late.tick(START_NS + 3_000_000_000)


def test_a_robot_without_wheels_has_no_picture_but_health() -> None:
    view = View(RobotConfig(robot="testbot"))
    view.bus_state("main", BusState(stamp=1, servos=[ServoState(id=1, position=1.0)]))
    assert [topic for topic, _ in view.odometry(odometry())] == [ODOMETRY]
    assert [topic for topic, _ in view.health(health(), 1)] == [HEALTH, LOG]


numbers = st.one_of(st.floats(), st.sampled_from(REPEATED))
stamps = st.integers(-(2**63), 2**64 - 1)


@settings(max_examples=200)
@given(stamps, st.lists(numbers, min_size=6, max_size=6), st.text(max_size=20), st.booleans())
def test_any_odometry_is_drawn_with_numbers_or_refused(
    stamp: int, values: list[float], reason: str, valid: bool
) -> None:
    message = odometry(
        **dict(zip(("x", "y", "theta", "vx", "vy", "omega"), values, strict=True)),  # type: ignore[arg-type]
        reason=reason,
        valid=valid,
    )
    message.stamp = stamp
    view = View(CONFIG)
    try:
        drawn = view.odometry(message)
    except Rejected:
        return
    no_numbers(drawn)


@given(stamps, st.lists(numbers, max_size=5), st.lists(numbers, min_size=3, max_size=3))
def test_any_residuals_are_drawn_with_numbers_or_refused(
    stamp: int, commanded: list[float], velocity: list[float]
) -> None:
    vx, vy, omega = velocity
    message = Residuals(
        stamp=stamp,
        commanded=commanded,
        candidates=[Candidate(name="(1,2;1)", vx=vx, vy=vy, omega=omega)],
    )
    try:
        drawn = View(CONFIG).residuals(message)
    except Rejected:
        return
    no_numbers(drawn)


@given(st.lists(st.tuples(st.integers(), st.none() | numbers), max_size=5))
def test_any_state_points_wheels_somewhere_or_is_refused(
    servos: list[tuple[int, float | None]],
) -> None:
    view = View(CONFIG)
    state = BusState(stamp=1, servos=[ServoState(id=i, position=p) for i, p in servos])
    state.servos.append(ServoState(id=100, position=float("nan")))
    with pytest.raises(Rejected):
        view.bus_state(BUS, state)
    no_numbers(view.odometry(odometry()))


def no_numbers(drawn: list[tuple[str, object]]) -> None:
    """Nothing that is no number has got into a drawing."""
    for topic, message in drawn:
        if isinstance(message, bytes):
            json.loads(message, parse_constant=pytest.fail)
        else:
            numbers = re.sub(r'"(\\.|[^"\\])*"', "", repr(message))  # words may say anything
            assert not re.search(r"\b(nan|NaN|inf)\b", numbers), topic


def test_the_prepared_layout_is_up_to_date_and_shows_topics_that_exist() -> None:
    text = LAYOUT.read_text()
    assert text == layout() + "\n", "wackel view --layout docs/view-layout.json"
    named = set(re.findall(r'"(/[a-z]+)', text))
    assert {ROBOT, PATH, VELOCITY, HEALTH, LOG, ODOMETRY} == named
    assert named < set(TOPICS)
