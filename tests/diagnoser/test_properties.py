"""Whatever comes from outside: no crash, and nothing that is not a number goes out."""

import math
from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.diagnoser.rig import GYRO, Rig
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.drive import ImuSample, TwistCommand
from wackel_schemas.message import Message

numbers = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3), st.sampled_from([0.0, 1e300])
)
maybe = st.none() | numbers
jumps = st.sampled_from(
    [-(10**12), -1, 0, 1, 10_000_000, 10_000_000, 10_000_000, 10**9, 10**15, 2**63]
)
LARGEST = 2**64 - 1
"""Of the stamps that a message can have."""
servos = st.lists(
    st.builds(
        ServoState,
        id=st.sampled_from([0, 1, 2, 3, 100, 101, 102, 103, 7]),
        position=maybe,
        velocity=maybe,
        current=maybe,
        load=maybe,
        torque_enabled=st.none() | st.booleans(),
    ),
    max_size=9,
)
events = st.lists(
    st.tuples(
        jumps,
        st.one_of(
            st.tuples(st.just("state"), servos),
            st.tuples(st.just("imu"), st.tuples(numbers, numbers, numbers)),
            st.tuples(st.just("command"), st.tuples(numbers, numbers, numbers)),
        ),
    ),
    max_size=30,
)


def numbers_of(value: Any) -> list[float]:
    if isinstance(value, float):
        return [value]
    if isinstance(value, dict):
        return [n for each in value.values() for n in numbers_of(each)]
    if isinstance(value, list):
        return [n for each in value for n in numbers_of(each)]
    return []


def all_finite(message: Message) -> bool:
    return all(map(math.isfinite, numbers_of(msgspec.to_builtins(message))))


@settings(max_examples=25, deadline=None)
@given(events, st.integers(0, 30))
def test_nonsense_never_crashes_nor_goes_on(found: Any, before: int) -> None:
    rig = Rig.of("tune/nonsense")
    for _ in range(before):
        rig.cycle()
    said: list[Message] = []
    stamp = rig.now_ns
    for jump, (what, content) in found:
        stamp = min(max(stamp + jump, 0), LARGEST)
        if what == "state":
            said += rig.diagnoser.bus_state("main", BusState(stamp=stamp, servos=content))
        elif what == "imu":
            said += rig.diagnoser.imu(GYRO, ImuSample(stamp=stamp, angular_velocity=content))
        else:
            vx, vy, omega = content
            rig.diagnoser.command(TwistCommand(stamp=stamp, vx=vx, vy=vy, omega=omega))
    for _ in range(15):
        said += rig.feed(rig.simulation.step(0.3, 0.0, 0.1))
    assert all(map(all_finite, said))


def test_strange_buses_and_gyros_are_ignored() -> None:
    rig = Rig.of("tune/strange")
    assert rig.diagnoser.bus_state("other", BusState(stamp=1, servos=[ServoState(id=1)])) == []
    assert rig.diagnoser.imu("other", ImuSample(stamp=1, angular_velocity=(0, 0, 0))) == []


def test_a_sensor_that_falls_silent_stops_nothing() -> None:
    rig = Rig.of("tune/silent")
    rig.drive(3.0)
    for _ in range(150):
        rig.cycles += 1
        cycle = rig.simulation.step(0.3, 0.0, 0.3)
        state = BusState(
            stamp=cycle.state.stamp, servos=[s for s in cycle.state.servos if s.id not in (1, 102)]
        )
        rig.diagnoser.command(cycle.command)
        for message in rig.diagnoser.bus_state("main", state):
            assert all_finite(message)
    assert rig.active() == []
