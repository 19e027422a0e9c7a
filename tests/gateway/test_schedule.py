"""What the master asks, in simulated time on the virtual bus."""

from collections import Counter
from itertools import pairwise
from random import Random

import pytest

from tests.gateway.simulation import Simulation
from wackel_gateway.job import Job, Stage
from wackel_gateway.outcome import Outcome
from wackel_gateway.roster import Roster
from wackel_gateway.schedule import Schedule
from wackel_node.config import BusConfig, ServoConfig
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import reader
from wackel_schemas.virtual import Injection
from wackel_virtual.bus import VirtualBus

IDS = tuple(range(1, 9))
SECOND_NS = 1_000_000_000


def simulation(
    *,
    rate: float = 100.0,
    firmware: int = 50,
    loss: float = 0.0,
    models: dict[int, str] | None = None,
) -> Simulation:
    servos = [ServoConfig(id=i, model=(models or {}).get(i, "XM430-W210")) for i in IDS]
    config = BusConfig(port="none", rate=rate, servos=servos, return_delay_us=0)
    bus = VirtualBus(config, seed=1, loss=loss, firmware=dict.fromkeys(IDS, firmware))
    return Simulation(config, bus)


def settled(run: Simulation) -> Simulation:
    """All servos have joined and the first slow reads are over."""
    for _ in run.run(1.0):
        pass
    assert run.schedule.present == IDS
    return run


def answered(outcome: Outcome) -> tuple[int, ...]:
    return tuple(status.id for status in outcome.answers.statuses)


def cycles(history: list[tuple[Job, Outcome]]) -> list[list[tuple[Job, Outcome]]]:
    """The reads of each cycle."""
    found: list[list[tuple[Job, Outcome]]] = []
    for job, outcome in history:
        if job.stage is Stage.CYCLE:
            found.append([])
        if job.stage in (Stage.CYCLE, Stage.PLAIN, Stage.REST):
            found[-1].append((job, outcome))
    return found


def instruction(job: Job) -> int:
    return job.instruction[packet.PREFIX_BYTES]


def test_servos_join_by_a_ping_of_their_own_in_cable_order() -> None:
    run = simulation()
    pings = [job.ids[0] for job, _ in run.run(0.1) if job.stage is Stage.PING]
    assert pings == list(IDS)
    assert run.schedule.present == IDS
    assert run.roster.members[1].firmware == 50


def test_cycles_come_at_the_rate_without_drift_and_slow_work_does_not_disturb_it() -> None:
    run = settled(simulation(rate=100))
    begins = [o.begin_ns for job, o in run.run(5.0) if job.stage is Stage.CYCLE]
    assert len(begins) == 500
    assert all(begin % 10_000_000 == begins[0] % 10_000_000 for begin in begins)


def test_where_the_wire_is_slower_than_the_rate_cycles_follow_each_other_without_pause() -> None:
    run = settled(simulation(rate=2000))
    history = list(run.run(2.0))
    on_wire_s = sum((o.ended_ns - o.begin_ns) / 1e9 for _, o in history)
    cycle_s = sum((o.ended_ns - o.begin_ns) / 1e9 for j, o in history if j.stage is Stage.CYCLE)
    assert on_wire_s > 0.9 * 2.0
    assert cycle_s > 0.85 * 2.0
    assert any(job.stage is Stage.SLOW for job, _ in history)


def test_every_servo_tells_voltage_status_and_return_delay_at_their_intervals() -> None:
    run = settled(simulation())
    slow = Counter((job.ids, job.block) for job, _ in run.run(60.0) if job.stage is Stage.SLOW)
    by_address = {block.address: n for (_, block), n in slow.items() if block is not None}
    assert by_address[144] >= 118
    assert by_address[64] >= 58
    assert by_address[9] >= 28
    assert len(slow) == 3 * len(IDS)


def test_what_stands_behind_a_silent_servo_is_read_in_the_same_cycle() -> None:
    run = settled(simulation())
    run.bus.inject(Injection(kind="silent", servo=3))
    reads = cycles(list(run.run(0.5)))
    assert all(
        sorted(i for _, outcome in cycle for i in answered(outcome)) == [1, 2, 4, 5, 6, 7, 8]
        for cycle in reads
    )
    # The first of them: a fast read, a plain one of those missing, and of those behind.
    assert [len(cycle) for cycle in reads[:3]] == [3, 1, 1]


def test_a_silent_servo_is_pinged_on_and_on_within_its_share_of_bus_time() -> None:
    run = settled(simulation())
    run.bus.inject(Injection(kind="silent", servo=3))
    list(run.run(1.0))
    history = list(run.run(10.0))
    pings = [outcome for job, outcome in history if job.stage is Stage.PING]
    assert {outcome.expectation.ids for outcome in pings} == {(3,)}
    spent_s = sum(outcome.ended_ns - outcome.begin_ns for outcome in pings) / 1e9
    assert 0.3 < spent_s < 1.1
    run.bus.heal()
    list(run.run(0.3))
    assert run.schedule.present == IDS


@pytest.mark.parametrize("servo", [1, 4, 8])
def test_behind_a_break_all_are_pinged_one_by_one_and_all_come_back(servo: int) -> None:
    run = settled(simulation())
    run.bus.inject(Injection(kind="break", servo=servo))
    history = list(run.run(0.5))
    behind = set(range(servo, 9))
    assert {job.ids[0] for job, _ in history if job.stage is Stage.PING} == behind
    assert run.schedule.present == tuple(range(1, servo))
    run.bus.heal()
    list(run.run(2.0))
    assert run.schedule.present == IDS


def test_a_lost_answer_costs_others_nothing_and_itself_one_cycle() -> None:
    run = settled(simulation(loss=0.001))
    reads = cycles(list(run.run(20.0)))
    heard = Counter(len({i for _, o in cycle for i in answered(o)}) for cycle in reads)
    assert heard[8] > 0.97 * len(reads)
    assert min(heard) >= 6


def test_firmware_that_is_too_old_is_asked_by_plain_sync_read() -> None:
    run = settled(simulation(firmware=40))
    kinds = {instruction(job) for job, _ in run.run(0.1) if job.stage is Stage.CYCLE}
    assert kinds == {packet.Instruction.SYNC_READ}
    assert not run.schedule.fast


def test_fast_sync_read_that_nobody_understands_is_given_up_for_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A clone whose firmware number promises more than it can.
    monkeypatch.setattr("wackel_gateway.roster.Member.knows_fast_sync_read", True)
    run = simulation(firmware=40)
    reads = cycles(list(run.run(59.0)))
    kinds = [[instruction(job) for job, _ in cycle] for cycle in reads]
    fast, plain = packet.Instruction.FAST_SYNC_READ, packet.Instruction.SYNC_READ
    assert sum(fast in cycle for cycle in kinds) == 3
    assert kinds[-1] == [plain]
    assert answered(reads[-1][0][1]) == IDS
    again = cycles(list(run.run(2.0)))
    assert sum(instruction(job) == fast for cycle in again for job, _ in cycle) == 3


def test_under_a_rhythmic_jammer_plain_reads_go_on_and_fast_ones_come_back_later() -> None:
    run = settled(simulation())
    run.bus.inject(Injection(kind="rhythmic_jammer"))
    reads = cycles(list(run.run(1.0)))
    assert all(sorted(i for _, o in cycle for i in answered(o))[-1] == 8 for cycle in reads)
    assert {instruction(job) for job, _ in reads[-1]} == {packet.Instruction.SYNC_READ}
    assert answered(reads[-1][0][1]) == IDS
    run.bus.heal()
    list(run.run(60.0))
    assert run.schedule.fast


def test_an_alert_has_the_hardware_error_read_at_once() -> None:
    run = settled(simulation())
    run.bus.inject(Injection(kind="overload", servo=5))
    begin_ns = run.now_ns
    for job, outcome in run.run(0.2):
        if job.stage is Stage.SLOW and job.ids == (5,) and job.block is not None:
            assert job.block.address <= 70 < job.block.address + job.block.length
            assert outcome.begin_ns - begin_ns < 30_000_000
            return
    raise AssertionError("it was not read")


def test_models_with_registers_elsewhere_are_read_apart() -> None:
    models = {3: "PH54-200-S500", 4: "PH54-200-S500", 8: "XL-320"}
    run = settled(simulation(models=models))
    groups = [job.ids for job, _ in run.run(0.01) if job.stage is Stage.CYCLE]
    assert groups == [(1, 2, 5, 6, 7), (3, 4), (8,)]


def test_a_servo_that_answers_pings_but_no_reads_is_tried_less_and_less_often() -> None:
    run = simulation()
    config = BusConfig(port="none", servos=run.config.servos, return_delay_us=0)
    bus = VirtualBus(config, seed=1)
    run = Simulation(config, bus)
    bus.exchange(0, packet.write(2, 68, b"\x00"), 5_000_000)  # Status Return Level: ping only
    history = list(run.run(10.0))
    failed = [o for j, o in history if 2 in j.ids and j.stage is not Stage.PING]
    assert len(failed) < 40
    assert run.schedule.present == tuple(i for i in IDS if i != 2) or run.schedule.present == IDS


def test_with_nobody_there_time_is_not_spent_on_cycles() -> None:
    run = simulation(rate=2000)
    run.bus.inject(Injection(kind="power_off"))
    history = list(run.run(2.0))
    assert {job.stage for job, _ in history} == {Stage.PING}
    assert run.schedule.cycles == 0


def test_commands_are_sent_at_the_head_of_the_next_cycle_and_once() -> None:
    run = settled(simulation())
    write = packet.sync_write(65, 1, {1: b"\x01"})
    run.schedule.command([write])
    stages = [job.stage for job, _ in run.run(0.03) if job.stage in (Stage.COMMAND, Stage.CYCLE)]
    assert stages[:2] == [Stage.COMMAND, Stage.CYCLE]
    assert stages.count(Stage.COMMAND) == 1


def test_slow_reads_are_spread_evenly() -> None:
    run = settled(simulation())
    begins = [o.begin_ns for job, o in run.run(10.0) if job.stage is Stage.SLOW]
    gaps = [b - a for a, b in pairwise(begins)]
    # 8 servos, 3.5 reads of each a second.
    assert max(gaps) < 4 * SECOND_NS / 28


def test_a_servo_that_becomes_slow_is_asked_again_at_once_with_others_in_between() -> None:
    run = settled(simulation())
    list(run.run(4.0))
    run.bus.inject(Injection(kind="slow", servo=5, value=0.001))
    asked = [(job.ids[0], job.block) for job, _ in run.run(1.0) if job.stage is Stage.SLOW]
    first = next(place for place, (servo, _) in enumerate(asked) if servo == 5)
    followed = asked[first + 1 : first + 15]
    assert {block.address for _, block in followed if block is not None} == {9}
    assert [servo for servo, _ in followed[1::2]] == [5] * 7
    assert {servo for servo, _ in followed[::2]} == set(IDS) - {5}
    # Then it is known, and costs no more.
    later = Counter(job.ids[0] for job, _ in run.run(10.0) if job.stage is Stage.SLOW)
    assert later[5] < 1.5 * later[4] + 10


def test_nothing_is_asked_again_on_a_healthy_bus() -> None:
    run = settled(simulation())
    slow = sum(job.stage is Stage.SLOW for job, _ in run.run(60.0))
    assert slow <= 60 * 8 * 3.5 + 8


def test_where_the_host_is_often_late_that_is_not_followed_up_for_ever() -> None:
    run = settled(simulation())
    list(run.run(4.0))
    random, asked = Random(1), 0
    for _ in range(400):
        run.bus.heal()
        for servo in random.sample(IDS, 3):
            run.bus.inject(Injection(kind="slow", servo=servo, value=0.0005))
        asked += sum(job.stage is Stage.SLOW for job, _ in run.run(0.05))
    usual = 20 * len(IDS) * 3.5
    assert 1.1 * usual < asked < usual + 20 * 10 + 40 + 8


def test_an_adapter_that_holds_answers_back_is_shown_by_a_few_servos_at_once() -> None:
    run = settled(simulation())
    list(run.run(4.0))
    run.bus.inject(Injection(kind="latency_timer", value=2))
    singles = [(job.ids[0], o.begin_ns) for job, o in run.run(1.0) if job.stage is Stage.SLOW]
    assert singles[15][1] - singles[0][1] < SECOND_NS / 4
    assert len({servo for servo, _ in singles[:16]}) >= 3


def test_a_voltage_that_falls_has_all_of_them_read_twice_at_once() -> None:
    run = settled(simulation())
    run.bus.inject(Injection(kind="contact_resistance", servo=5, value=5.0))
    voltages = [
        (job.ids[0], outcome.begin_ns)
        for job, outcome in run.run(1.0)
        if job.stage is Stage.SLOW and job.block is not None and job.block.address == 144
    ]
    sweep = [servo for servo, _ in voltages]
    start = next(i for i in range(len(sweep)) if tuple(sweep[i : i + 16]) == IDS * 2)
    assert voltages[start + 15][1] - voltages[start][1] < SECOND_NS / 20


def test_a_silent_servo_before_a_break_is_pinged_more_often_than_those_behind_it() -> None:
    run = settled(simulation())
    run.bus.inject(Injection(kind="silent", servo=1))
    run.bus.inject(Injection(kind="break", servo=3))
    pings = Counter(job.ids[0] for job, _ in run.run(0.5) if job.stage is Stage.PING)
    assert min(pings[1], pings[3]) >= 4
    assert max(pings[servo] for servo in (4, 5, 6, 7, 8)) < 4


def test_a_silent_bus_is_asked_for_ever_even_if_a_ping_costs_more_than_can_be_saved_up() -> None:
    schedule = Schedule(Roster([ServoConfig(id=1)]), 100.0, fast=True, now_ns=0)
    now, last_ping = 0, 0
    while now < 60 * SECOND_NS:
        job = schedule.next(now)
        if job is None:
            now = max(now + 100_000, schedule.due_ns)
            continue
        begin, now = now, now + 26_000_000  # a latency timer of 16 ms that nobody could read back
        last_ping = now
        schedule.done(job, reader(job.instruction).read(b""), begin, now)
    assert last_ping > 58 * SECOND_NS


def test_slow_reads_go_on_after_one_in_which_the_computer_slept_for_a_second() -> None:
    run = settled(simulation())
    job, outcome = next(each for each in run.run(1.0) if each[0].stage is Stage.SLOW)
    nothing = reader(job.instruction).read(b"")
    run.schedule.done(job, nothing, outcome.begin_ns, outcome.begin_ns + SECOND_NS)
    list(run.run(8.0))
    slow = Counter(job.ids[0] for job, _ in run.run(10.0) if job.stage is Stage.SLOW)
    assert min(slow[servo] for servo in IDS) >= 30  # as usual


def test_background_reads_in_the_pauses_take_nothing_from_the_pings_of_the_silent() -> None:
    servos = [ServoConfig(id=i) for i in range(1, 31)]
    config = BusConfig(port="none", rate=100.0, baud_rate=3_000_000, servos=servos)
    run = Simulation(config, VirtualBus(config, seed=1), host_ns=300_000)
    for _ in run.run(1.0):
        pass
    run.bus.inject(Injection(kind="silent", servo=5))
    stages = Counter(job.stage for job, _ in run.run(5.0))
    ping_s = run.schedule._costs.means["silent"] / 1e9
    assert stages[Stage.SLOW] > 5 * 3 * 29  # as before
    assert stages[Stage.PING] * ping_s > 0.08 * 5  # of the tenth that they may have
