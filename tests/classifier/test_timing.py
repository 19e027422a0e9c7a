"""What response times tell: the module by itself, on hosts of every kind."""

from collections.abc import Callable
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.classifier.rig import chain
from wackel_classifier.chain import Chain
from wackel_classifier.timing import Timing

SERVOS = 6
MS = 1_000_000
US = 1_000
STAMP = 1_700_000_000_000_000_000
BYTES, BAUD_RATE = 14, 1_000_000
Delay = Callable[[int], float]  # µs, by position


class Bus:
    """Servos that are asked one after the other, 20 ms apart, after each read of all."""

    def __init__(self, servos: int = SERVOS, seed: int = 1) -> None:
        self.servos = servos
        self.random = Random(seed)
        self.timing = Timing(Chain("main", chain(servos)), 20)
        self.now_ns = 0
        self.turn = 0
        self.told: list[str] = []

    def ask(self, position: int, delay_us: float) -> None:
        self.now_ns += 20 * MS
        self.timing.host.waits += 1
        response_ns = round(delay_us * US) + BYTES * 10 * US
        stamp = STAMP + self.now_ns
        self.timing.response(position, response_ns, BYTES, BAUD_RATE, self.now_ns, stamp)
        if self.turn % 10 == 0:
            self.timing.tick()
        self.told += [f.code for f in self.timing.findings(self.now_ns, stamp)]
        self.turn += 1

    def run(self, answers: int, delay: Delay) -> list[tuple[str, str]]:
        """What is found in the end."""
        self.told.clear()
        for _ in range(answers):
            position = self.turn % self.servos
            self.ask(position, delay(position))
        return [
            (finding.code, finding.component.removeprefix("bus/main/"))
            for finding in self.timing.findings(self.now_ns, STAMP + self.now_ns)
        ]

    def quiet(self, _: int = 0) -> float:
        return self.random.gauss(120.0, 12.0)


def test_a_slow_servo_is_found_and_healed() -> None:
    bus = Bus()
    assert bus.run(200, bus.quiet) == []
    slow = bus.run(60, lambda place: bus.quiet() + (300 if place == 2 else 0))
    assert slow == [("slow_servo", "servo/3")]
    assert bus.run(30, bus.quiet) == []


def test_a_host_that_is_late_for_all_makes_no_servo_slow() -> None:
    for share in (0.05, 0.2, 0.5):
        bus = Bus()
        bus.run(200, bus.quiet)

        def late(_: int, bus: Bus = bus, share: float = share) -> float:
            return bus.quiet() + (bus.random.random() < share) * bus.random.uniform(100, 1500)

        bus.run(20_000, late)
        assert "slow_servo" not in bus.told[400 * SERVOS :], share
        assert "latency_timer" not in bus.told


def test_late_answers_in_a_burst_of_the_host_convict_nobody() -> None:
    bus = Bus()
    for _ in range(50):
        bus.run(200, bus.quiet)
        for place in range(SERVOS):
            bus.timing.host.overslept(MS, bus.now_ns, STAMP, many=True)
            bus.ask(place, bus.random.uniform(300, 5000))
        assert bus.told == []
        # All of them at one servo, as when it is asked again and again.
        for place in (1, 1, 1, 1):
            bus.ask(place, 3000.0)
        assert "latency_timer" not in bus.told
        bus.run(12, bus.quiet)


def test_many_late_answers_within_one_burst_of_the_host_are_no_adapter() -> None:
    bus = Bus()
    bus.run(200, bus.quiet)
    bus.now_ns += SERVOS * 20 * MS
    for turn in range(60):
        bus.now_ns -= 17 * MS  # so 3 ms apart
        bus.ask(turn % SERVOS, bus.random.uniform(1500, 5000))
    assert "latency_timer" not in bus.told


def test_a_late_first_answer_of_several_is_the_wake_up_and_no_adapter() -> None:
    bus = Bus()
    bus.run(200, bus.quiet)
    for turn in range(400):
        for later in range(4):
            bus.ask((turn + later) % SERVOS, bus.random.uniform(1500, 5000) if not later else 120)
            bus.now_ns -= 17 * MS  # so 3 ms apart
        bus.now_ns += 30 * MS
    assert "latency_timer" not in bus.told


def test_answers_later_than_any_timer_are_the_hosts() -> None:
    bus = Bus()
    bus.run(200, bus.quiet)
    bus.run(2000, lambda _: bus.quiet() + bus.random.expovariate(1 / 15_000))
    assert "latency_timer" not in bus.told


def test_from_the_start_a_host_that_oversleeps_in_half_of_its_waits_convicts_no_adapter() -> None:
    for seed in range(20):
        bus = Bus(seed=seed)

        def starved(_: int, bus: Bus = bus) -> float:
            if bus.random.random() < 0.5:
                bus.timing.host.overslept(2 * MS, bus.now_ns, STAMP + bus.now_ns, many=True)
            return bus.random.uniform(1300, 12_000)

        bus.run(1000, starved)
        assert "latency_timer" not in bus.told, seed


def test_a_host_that_oversleeps_all_the_time_leaves_the_adapter_as_it_was() -> None:
    bus = Bus()
    bus.run(200, bus.quiet)

    def starved(_: int) -> float:
        bus.timing.host.overslept(MS, bus.now_ns, STAMP + bus.now_ns, many=True)
        return bus.random.uniform(500, 5000)

    bus.run(3000, starved)
    assert "latency_timer" not in bus.told


@pytest.mark.parametrize("held_us", [4_000.0, 16_000.0])
def test_an_adapter_that_holds_answers_back_is_told_from_a_slow_servo(held_us: float) -> None:
    bus = Bus()
    bus.run(200, bus.quiet)

    def held(_: int) -> float:
        return bus.quiet() + bus.random.uniform(0, held_us)

    assert bus.run(30, held) == [("latency_timer", "adapter")]
    assert set(bus.told) == {"latency_timer"}
    bus.run(2000, held)
    assert len(bus.told) == 2000  # without a gap
    assert bus.run(30, bus.quiet) == []


@pytest.mark.parametrize("overslept_us", [700.0, 1100.0])
def test_a_host_that_wakes_up_late_hides_no_timer_of_16_ms(overslept_us: float) -> None:
    bus = Bus()

    def woken(held_us: float) -> float:
        lag_us = bus.random.uniform(0.0, overslept_us)
        if lag_us > 200:
            lag_ns = round(lag_us * US)
            bus.timing.host.overslept(lag_ns, bus.now_ns, STAMP + bus.now_ns, many=True)
        return bus.quiet() + bus.random.uniform(0, held_us) + bus.random.uniform(0.0, overslept_us)

    bus.run(2000, lambda _: woken(0.0))
    assert "latency_timer" not in bus.told
    assert bus.run(100, lambda _: woken(16_000.0)) == [("latency_timer", "adapter")]
    assert bus.run(1000, lambda _: woken(0.0)) == []


def test_what_the_host_is_known_to_delay_of_single_answers_says_nothing_of_the_others() -> None:
    bus = Bus()
    bus.run(200, bus.quiet)

    def held(_: int) -> float:
        for lag_ns in (MS, 5 * MS):
            bus.timing.host.overslept(lag_ns, bus.now_ns, STAMP + bus.now_ns, many=False)
        return bus.quiet() + bus.random.uniform(0, 4_000)

    assert ("latency_timer", "adapter") in bus.run(30, held)


def test_answers_that_come_when_nobody_listens_speak_for_a_timer() -> None:
    bus = Bus()
    bus.run(200, bus.quiet)
    for turn in range(30):
        bus.now_ns += 20 * MS
        bus.timing.late_answer(turn % SERVOS, bus.now_ns, STAMP + bus.now_ns)
        bus.run(1, lambda _: bus.quiet() + 2_000)
    assert "latency_timer" in bus.told


def test_a_slow_drift_is_found_with_its_size_and_a_common_one_is_not() -> None:
    bus = Bus()
    assert bus.run(200 * SERVOS, bus.quiet) == []
    for step in range(40):
        bus.run(5 * SERVOS, lambda place, s=step: bus.quiet() + (s if place == 4 else 0))  # type: ignore[misc]
    [finding] = bus.timing.findings(bus.now_ns, STAMP + bus.now_ns)
    assert (finding.code, finding.component) == ("slow_servo", "bus/main/servo/5")
    assert 15 < float(finding.values["drift_us"]) < 40
    assert bus.run(20 * SERVOS, bus.quiet) == []
    for step in range(100):
        assert bus.run(SERVOS, lambda _, s=step: bus.quiet() + s) == []  # type: ignore[misc]
        assert bus.told == []


def test_chance_alone_is_no_drift() -> None:
    for seed in range(3):
        bus = Bus(seed=seed)
        bus.run(30_000, bus.quiet)
        assert bus.told == []


def wrong(timing: Timing) -> list[str]:
    found = [f for f in timing.findings(0, STAMP) if f.code == "return_delay"]
    return [finding.component.removeprefix("bus/main/") for finding in found]


def set_registers(timing: Timing, *values: int) -> None:
    for position, value in enumerate(values):
        timing.register(position, value, STAMP)


def test_the_register_that_differs_from_most_is_wrong() -> None:
    timing = Timing(Chain("main", chain(SERVOS)), None)
    set_registers(timing, 250, 250)
    assert wrong(timing) == []  # two say nothing of what is right
    set_registers(timing, 250, 250, 0, 250)
    assert wrong(timing) == ["servo/3"]
    set_registers(timing, 250, 250, 0, 250, 0, 0)
    assert wrong(timing) == []  # nobody knows what is right
    set_registers(timing, 250, 250, 250, 250, 0, 250)
    assert wrong(timing) == ["servo/5"]


def test_an_exchanged_chain_is_not_held_against_the_old_one() -> None:
    timing = Timing(Chain("main", chain(SERVOS)), None)
    set_registers(timing, *[0] * SERVOS)
    timing.unwatched()
    for position in range(SERVOS):
        timing.register(position, 250, STAMP)
        assert wrong(timing) == []


def test_a_wrong_register_is_told_on_while_nothing_is_read() -> None:
    timing = Timing(Chain("main", chain(SERVOS)), None)
    set_registers(timing, 250, 250, 0, 250, 250, 250)
    assert wrong(timing) == ["servo/3"]
    timing.unwatched()
    assert wrong(timing) == ["servo/3"]
    set_registers(timing, 250, 250, 0, 250)
    assert wrong(timing) == ["servo/3"]
    timing.register(2, 250, STAMP)
    assert wrong(timing) == []


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.integers(0, 3), st.integers(-(10**12), 10**12)), max_size=200),
)
def test_any_times_are_judged(servos: int, answers: list[tuple[int, int]]) -> None:
    timing = Timing(Chain("main", chain(servos)), None)
    for turn, (place, response_ns) in enumerate(answers):
        position = place % servos
        timing.response(position, response_ns, BYTES, 0, turn * MS, turn)
        timing.late_answer(position, turn * MS, turn)
        timing.host.overslept(abs(response_ns), turn * MS, turn, many=bool(place))
        timing.register(position, place, turn)
        timing.tick()
        for finding in timing.findings(turn * MS, turn):
            assert finding.summary
            assert not any(value != value for value in finding.values.values())  # noqa: PLR0124
