"""What each fault does to the bytes on the wire; numbers from chapter 2 of the thesis."""

import statistics
from collections import Counter
from itertools import pairwise

import pytest

from tests.virtual.material import MS, ask, ask_one, bus, ids, raw, statuses
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.control_table import model
from wackel_protocols.dynamixel2.packet import BROADCAST_ID
from wackel_protocols.dynamixel2.scanner import Kind, scan
from wackel_schemas.virtual import Injection
from wackel_virtual import InjectionError
from wackel_virtual.faults import KINDS
from wackel_virtual.servo import BOOT_NS

X = model("XM430-W210").registers
PING_ALL = packet.ping(BROADCAST_ID)
READ_ALL = packet.sync_read(range(1, 6), 132, 4)


def inject(on, kind, servo=None, value=None, **when):
    return on.inject(Injection(kind=kind, servo=servo, value=value, **when))


def read(on, name, servo):
    status = ask_one(on, packet.read(servo, X[name].address, X[name].length))
    return X[name].decode(status.parameters)


def wait(on, seconds):
    on.deliveries(on.now_ns + round(seconds * 1e9))


def alive(on, size=5):
    return [i for i in range(1, size + 1) if ids(ask(on, packet.ping(i))) == [i]]


@pytest.mark.parametrize(
    ("power", "answering"), [("adapter", [1, 2]), ("both", [1, 2]), ("far", [])]
)
def test_a_break_takes_what_lies_behind_it_or_what_it_supplies(power, answering):
    on = bus(5, power=power)
    inject(on, "break", servo=3)
    assert alive(on) == answering
    on.heal()
    wait(on, 1)
    assert alive(on) == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("kind", "servo", "power"),
    [
        ("break", 4, "far"),
        ("break", 1, "adapter"),
        ("break", 1, "both"),
        ("power_off", None, "far"),
    ],
)
def test_a_bus_on_which_nobody_can_answer_gives_one_or_a_few_zeros(kind, servo, power):
    on = bus(5, power=power)
    inject(on, kind, servo=servo)
    wait(on, 0.1)
    lengths = Counter()
    for _ in range(100):
        received = raw(ask(on, PING_ALL, 800))
        assert set(received) == {0}
        lengths[len(received)] += 1
    assert lengths[1] > 70
    assert max(lengths) <= 4


def test_servos_that_were_without_power_start_anew_and_forget_their_ram():
    on = bus(5)
    ask(on, packet.write(5, X["torque_enable"].address, b"\1"))
    inject(on, "break", servo=4, duration_s=1.0)
    wait(on, 1.01)
    assert alive(on) == [1, 2, 3]
    wait(on, BOOT_NS / 1e9)
    assert alive(on) == [1, 2, 3, 4, 5]
    assert read(on, "torque_enable", 5) == 0


def test_supply_from_both_ends_keeps_servos_behind_a_break_running():
    on = bus(5, power="both")
    ask(on, packet.write(5, X["torque_enable"].address, b"\1"))
    inject(on, "break", servo=4, duration_s=1.0)
    wait(on, 1.01)
    assert read(on, "torque_enable", 5) == 1


def test_a_break_in_the_middle_of_an_answer_cuts_it_and_silences_the_rest():
    on = bus(5)
    on.transmit(MS, READ_ALL, 1_000_000)
    third_ns = len(READ_ALL) * 10_000 + 470_000  # since the request began
    inject(on, "break", servo=3, start_s=third_ns / 1e9)
    kinds = [segment.kind for segment in scan(raw(on.deliveries(50 * MS)))]
    assert kinds[:2] == [Kind.PACKET, Kind.PACKET]
    assert kinds[2:]
    assert Kind.PACKET not in kinds[2:]


def test_supply_at_both_ends_holds_the_voltage_on_both_sides_of_a_break():
    on = bus(6, power="both")
    inject(on, "break", servo=4)
    wait(on, 0.2)
    assert read(on, "present_input_voltage", 3) == pytest.approx(120, abs=1)
    inject(on, "undervoltage", value=0.0)
    assert read(on, "present_input_voltage", 3) == pytest.approx(0, abs=1)


def test_a_silent_servo_leaves_no_trace_but_hears():
    on = bus(5)
    inject(on, "silent", servo=3)
    assert ask(on, packet.write(3, X["led"].address, b"\1")) == []
    assert ids(ask(on, READ_ALL)) == [1, 2]  # and silences those behind it
    assert ids(ask(on, PING_ALL, 900)) == [1, 2, 4, 5]
    on.heal("silent", 3)
    assert read(on, "led", 3) == 1


def test_a_rhythmic_jammer_sets_one_zero_before_the_first_and_after_every_packet():
    on = bus(5)
    inject(on, "rhythmic_jammer")
    segments = scan(raw(ask(on, PING_ALL, 900)))
    assert [s.kind for s in segments] == [Kind.ZEROS, *[Kind.PACKET, Kind.ZEROS] * 5]
    assert all(s.end - s.start == 1 for s in segments if s.kind is Kind.ZEROS)


def test_a_servo_that_jams_does_not_answer():
    on = bus(5)
    inject(on, "rhythmic_jammer", servo=2)
    assert ids(ask(on, PING_ALL, 900)) == [1, 3, 4, 5]


def test_two_rhythmic_jammers_silence_the_bus():
    on = bus(5)
    inject(on, "rhythmic_jammer", servo=2)
    inject(on, "rhythmic_jammer", servo=4)
    assert ids(ask(on, PING_ALL, 900)) == []


def test_a_jammer_behind_a_break_does_not_jam():
    on = bus(5)
    inject(on, "permanent_jammer", servo=4)
    inject(on, "break", servo=3)
    wait(on, 0.1)
    ask(on, packet.ping(1))
    assert raw(ask(on, packet.ping(1), 500))[14:] == b""


def test_a_permanent_jammer_fills_the_bus_and_repeats_itself():
    on = bus(3, baud_rate=2_000_000)
    inject(on, "permanent_jammer")
    received = raw(ask(on, PING_ALL, 790))
    # A host that reads no further than the answers of 252 servos takes 252 · 14.
    assert len(received) >= 3528
    assert received.count(0) / len(received) == pytest.approx(0.5, abs=0.15)
    window = received[-2000:]
    alike = sum(a == b for a, b in zip(window[:-44], window[44:], strict=True)) / (2000 - 44)
    assert alike > 0.6


def destroyed(on, instruction, wait_ms, expected, rounds):
    lost = sum(expected - len(statuses(ask(on, instruction, wait_ms))) for _ in range(rounds))
    return lost / (rounds * expected)


def test_a_permanent_jammer_destroys_five_percent_of_direct_pings():
    on = bus(3, baud_rate=2_000_000, return_delay_us=None)
    inject(on, "permanent_jammer")
    assert destroyed(on, packet.ping(2), 2, 1, 2000) == pytest.approx(0.048, abs=0.012)


def test_a_permanent_jammer_destroys_half_of_the_answers_to_a_broadcast_ping():
    on = bus(4, baud_rate=2_000_000, return_delay_us=None)
    inject(on, "permanent_jammer")
    assert destroyed(on, PING_ALL, 20, 4, 400) == pytest.approx(0.55, abs=0.04)


def test_a_rhythmic_jammer_masks_a_permanent_one():
    on = bus(3)
    inject(on, "permanent_jammer")
    inject(on, "rhythmic_jammer")
    ask(on, packet.ping(1))
    assert len(raw(ask(on, PING_ALL, 900))) == 3 * 14 + 4


def test_a_contact_moved_by_hand_gives_messages_as_long_as_in_the_thesis():
    on = bus(3, baud_rate=2_000_000, return_delay_us=None)
    inject(on, "loose_contact", servo=3, value=200)
    lengths, near = [], 0
    for _ in range(600):
        chunks = on.exchange(on.now_ns + 100 * MS, PING_ALL, 789 * MS)
        near += len({1, 2} & set(ids(chunks)))
        length = len(raw(chunks))
        if length not in (28, 42):  # exactly two or three servos; the thesis left them out too
            lengths.append(length)
    assert statistics.mean(lengths) == pytest.approx(39, abs=3)
    assert statistics.stdev(lengths) == pytest.approx(11.85, abs=2)
    assert sum(length < 60 for length in lengths) / len(lengths) > 0.9
    assert max(lengths) < 100
    assert near / 1200 > 0.98  # the nearer servos get through


def test_a_loose_contact_loses_the_servos_behind_it_now_and_then():
    on = bus(5)
    inject(on, "loose_contact", servo=4, value=5)
    rounds = 3000
    counts = Counter()
    for _ in range(rounds):
        counts.update(ids(on.exchange(on.now_ns + 5 * MS, READ_ALL, 5 * MS)))
    near, behind = rounds - counts[3], rounds - counts[5]
    # Five times a second for 5 ms, and whatever read it cuts into.
    assert 0.02 < behind / rounds < 0.08
    assert near / rounds < 0.005


def test_losses_in_bursts_come_in_lumps():
    def gaps(kind):
        on = bus(2)
        inject(on, kind, servo=2, value=5)
        failed = [
            i
            for i in range(6000)
            if 2 not in ids(on.exchange(on.now_ns + 5 * MS, packet.ping(2), 5 * MS))
        ]
        return [b - a for a, b in pairwise(failed)]

    def long_share(kind):
        found = gaps(kind)
        return sum(gap for gap in found if gap > 100) / sum(found)

    # Gaps of more than a second are e⁻⁵ rare where losses are scattered.
    assert long_share("loose_contact_bursts") > 0.3 > long_share("loose_contact")


def test_noise_inverts_bits_at_its_rate_in_both_directions():
    on = bus(5)
    inject(on, "noise", value=1e-3)
    refused = damaged = 0
    for _ in range(2000):
        received = raw(ask(on, packet.write(2, X["led"].address, b"\1"), 5))
        answers = [s.packet for s in scan(received) if s.kind is Kind.PACKET]
        refused += sum(answer.error == 3 for answer in answers)
        damaged += bool(received) and not answers
    # 13 bytes there, of which an error in id or CRC leaves CRC errors; 11 bytes back.
    assert 0.03 < refused / 2000 < 0.10
    assert damaged / 2000 == pytest.approx(1 - (1 - 1e-3) ** 88, abs=0.025)


def test_loss_of_one_servo_leaves_the_others_alone():
    on = bus(5)
    inject(on, "loss", servo=2, value=0.3)
    counts = Counter(i for _ in range(500) for i in ids(ask(on, READ_ALL)))
    assert counts[2] / 500 == pytest.approx(0.7, abs=0.07)
    assert all(counts[i] == 500 for i in (1, 3, 4, 5))


def response_ns(on, servo):
    start = on.now_ns + MS
    return on.exchange(start, packet.ping(servo), 20 * MS)[-1][0] - start


def test_a_slow_servo_takes_the_extra_time():
    on = bus(2)
    inject(on, "slow", servo=2, value=0.003)
    extra = [response_ns(on, 2) - response_ns(on, 1) for _ in range(100)]
    assert statistics.mean(extra) == pytest.approx(3 * MS, rel=0.05)
    assert statistics.stdev(extra) > 0.05 * MS


def test_a_wrong_return_delay_stands_in_the_register_and_writing_it_cures_it():
    on = bus(2)
    inject(on, "return_delay", servo=2)
    assert read(on, "return_delay_time", 2) == 254
    assert response_ns(on, 2) - response_ns(on, 1) == pytest.approx(508_000, abs=10_000)
    ask(on, packet.write(2, X["return_delay_time"].address, b"\0"))
    assert response_ns(on, 2) - response_ns(on, 1) == pytest.approx(0, abs=10_000)
    on.heal()
    assert read(on, "return_delay_time", 2) == 0


def test_healing_a_wrong_return_delay_restores_it():
    on = bus(2, return_delay_us=20)
    inject(on, "return_delay", servo=2, duration_s=1)
    wait(on, 2)
    assert read(on, "return_delay_time", 2) == 10


def test_undervoltage_of_one_servo_is_reported_with_an_alert_until_reboot():
    on = bus(3)
    inject(on, "undervoltage", servo=2, value=9.0)
    assert read(on, "present_input_voltage", 2) == pytest.approx(90, abs=1)
    assert read(on, "present_input_voltage", 3) == pytest.approx(120, abs=2)
    assert read(on, "hardware_error_status", 2) == 1
    assert [s.alert for s in statuses(ask(on, PING_ALL, 900))] == [False, True, False]
    on.heal()
    assert read(on, "present_input_voltage", 2) == pytest.approx(120, abs=2)
    assert ask_one(on, packet.ping(2)).alert
    ask(on, packet.reboot(2))
    wait(on, 1)
    assert not ask_one(on, packet.ping(2)).alert


def test_a_weak_supply_is_seen_by_all():
    on = bus(3)
    inject(on, "undervoltage", value=10.0)
    assert all(read(on, "present_input_voltage", i) == pytest.approx(100, abs=2) for i in (1, 2, 3))


def test_a_corroded_power_contact_shows_as_a_step_that_grows_with_the_current():
    on = bus(6)
    inject(on, "contact_resistance", servo=4, value=5.0)

    def step():
        wait(on, 0.2)
        return read(on, "present_input_voltage", 3) - read(on, "present_input_voltage", 4)

    idle = step()
    assert idle == pytest.approx(6, abs=3)  # 3 · 40 mA · 5 Ω
    for servo in (4, 5, 6):
        ask(on, packet.write(servo, X["operating_mode"].address, b"\1"))
        ask(on, packet.write(servo, X["torque_enable"].address, b"\1"))
        ask(on, packet.write(servo, X["goal_velocity"].address, (300).to_bytes(4, "little")))
    assert step() > idle + 3


@pytest.mark.parametrize(("kind", "bits"), [("overload", 32), ("hardware_error", 4)])
def test_a_hardware_error_switches_torque_off_until_the_cause_is_gone_and_it_is_rebooted(
    kind, bits
):
    on = bus(3)
    torque = packet.write(2, X["torque_enable"].address, b"\1")
    ask(on, torque)
    inject(on, kind, servo=2)
    assert read(on, "hardware_error_status", 2) == bits
    assert read(on, "torque_enable", 2) == 0
    assert ask_one(on, torque).alert
    assert read(on, "torque_enable", 2) == 0
    for still in (True, False):
        if not still:
            on.heal()
        ask(on, packet.reboot(2))
        wait(on, 1)
        assert ask_one(on, packet.ping(2)).alert is still
    ask(on, torque)
    assert read(on, "torque_enable", 2) == 1


def test_frozen_values_stay_although_the_shaft_moves():
    on = bus(2)
    for servo in (1, 2):
        ask(on, packet.write(servo, X["operating_mode"].address, b"\1"))
        ask(on, packet.write(servo, X["torque_enable"].address, b"\1"))
        ask(on, packet.write(servo, X["goal_velocity"].address, (300).to_bytes(4, "little")))
    inject(on, "frozen", servo=2)
    request = packet.sync_read([1, 2], 124, 22)
    seen = [[s.parameters for s in statuses(ask(on, request))] for _ in range(10)]
    assert len({one for one, _ in seen}) == 10
    assert len({two for _, two in seen}) == 1
    on.heal()
    assert statuses(ask(on, request))[1].parameters != seen[0][1]


def test_an_unplugged_adapter_takes_and_gives_nothing_but_servos_keep_their_state():
    on = bus(2)
    ask(on, packet.write(1, X["torque_enable"].address, b"\1"))
    inject(on, "unplugged", duration_s=1)
    assert not on.plugged
    assert ask(on, packet.ping(1)) == []
    wait(on, 1)
    assert on.plugged
    assert read(on, "torque_enable", 1) == 1


def test_a_latency_timer_quantises_answers():
    on = bus(2)
    inject(on, "latency_timer", value=16)
    start = on.now_ns + MS
    ((at, _),) = on.exchange(start, packet.ping(1), 40 * MS)
    assert at % (16 * MS) == 0
    on.heal()
    assert response_ns(on, 1) < MS


def test_faults_begin_and_end_by_schedule():
    on = bus(2)
    inject(on, "silent", servo=1, start_s=1, duration_s=2)
    for passed_s, silent in ((0.5, False), (1.5, True), (3.5, False)):
        on.advance(round(passed_s * 1e9))
        assert (alive(on, 1) == []) is silent
        assert bool(on.active()) is silent


def test_faults_combine_and_heal_one_by_one():
    on = bus(5)
    inject(on, "silent", servo=2)
    inject(on, "break", servo=4)
    inject(on, "rhythmic_jammer")
    assert ids(ask(on, PING_ALL, 900)) == [1, 3]
    assert [fault.kind for fault in on.heal("break")] == ["break"]
    wait(on, 1)
    assert ids(ask(on, PING_ALL, 900)) == [1, 3, 4, 5]
    assert [fault.kind for fault in on.active()] == ["silent", "rhythmic_jammer"]
    assert len(on.heal()) == 2
    assert raw(ask(on, packet.ping(2))) == packet.StatusPacket(2, 0, b"\x06\x04\x32").encode()


def test_two_faults_at_one_place_last_until_both_are_healed():
    on = bus(3)
    inject(on, "silent", servo=2, duration_s=1)
    inject(on, "silent", servo=2, duration_s=3)
    wait(on, 2)
    assert alive(on, 3) == [1, 3]
    wait(on, 2)
    assert alive(on, 3) == [1, 2, 3]


@pytest.mark.parametrize(
    ("injection", "reason"),
    [
        (Injection(kind="brake"), "kind 'brake' is unknown; there are break, "),
        (Injection(kind="break"), "break needs the servo to which the cable leads; there are 1, 2"),
        (Injection(kind="silent", servo=9), "servo 9 is not on this bus; there are 1, 2"),
        (Injection(kind="noise", servo=1), "noise concerns the whole bus; leave out the servo"),
        (Injection(kind="noise", value=2.0), "must be from 0 to 0.5"),
        (Injection(kind="noise", value=float("nan")), "must be from 0 to 0.5"),
        (Injection(kind="return_delay", servo=1, value=2.5), "a whole number from 0 to 254"),
        (Injection(kind="silent", servo=1, value=1.0), "silent takes no value"),
        (Injection(kind="silent", servo=1, start_s=-1.0), "it cannot begin -1 s from now"),
        (Injection(kind="silent", servo=1, duration_s=0.0), "it cannot last 0 s"),
        (Injection(kind="silent", servo=1, start_s=float("nan")), "it cannot begin nan s from now"),
        (Injection(kind="silent", servo=1, duration_s=float("inf")), "it cannot last inf s"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_with_a_reason(injection, reason):
    on = bus(2)
    with pytest.raises(InjectionError) as error:
        on.inject(injection)
    assert reason in str(error.value)
    assert on.active() == []


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_begins_and_ends_without_trace_of_an_error(kind):
    on = bus(3)
    servo = 2 if KINDS[kind].place in ("servo", "cable") else None
    inject(on, kind, servo=servo, duration_s=2)
    for _ in range(20):
        ask(on, packet.sync_read([1, 2, 3], 132, 4), 100)
    wait(on, 3)
    assert on.active() == []
    assert ids(ask(on, packet.sync_read([1, 2, 3], 132, 4))) == [1, 2, 3]


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.value])
def test_the_servos_outlive_the_least_and_the_most_of_every_fault(kind):
    for value in (KINDS[kind].least, KINDS[kind].most):
        on = bus(5)
        inject(on, kind, servo=3 if KINDS[kind].place != "bus" else None, value=value)
        for _ in range(3):
            ask(on, READ_ALL)
            ask(on, packet.sync_read(range(1, 6), 144, 3))
            wait(on, 0.3)
        on.heal()
