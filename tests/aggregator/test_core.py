"""How faults and signs of life become health."""

from dataclasses import dataclass, field
from typing import Literal

import msgspec
import pytest

from wackel_aggregator.core import Aggregator
from wackel_aggregator.faults import MAX_FAULTS, MAX_HEALED
from wackel_aggregator.services import MAX_SERVICES, START_UP_S
from wackel_node.clock import Instant
from wackel_schemas import wire
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES, message
from wackel_schemas.health import FaultRecord, Health, HealthRequest, Heartbeat, ServiceHealth
from wackel_schemas.wire import Rejected

S = 1_000_000_000
UTC = 1_700_000_000 * S
NEEDED = ("gateway/main", "classifier/main")
CLASSIFIER_BOOT = 100
Life = Literal["starting", "ready", "stopping", "crashed"]


def report(
    code: str = "servo_silent",
    component: str = "bus/main/servo/3",
    status: Literal["active", "healed"] = "active",
    boot: int = CLASSIFIER_BOOT,
) -> FaultReport:
    return FaultReport(
        stamp=UTC,
        boot=boot,
        code=code,
        component=component,
        status=status,
        confidence=1.0,
        message=message(code, component, reason="R", error="E", held="5", expected="0"),
        remedy=FAULT_CODES[code].remedy,
        evidence=Evidence(summary="seen"),
        since=UTC,
    )


@dataclass
class Robot:
    """An aggregator with services that beat while time goes on; times in s.

    Attributes:
        saved: The latest health that was to be saved; at first that of an earlier run.
    """

    saved: Health | None = None
    start_s: float = 0.0
    wanted: tuple[str, ...] = ()
    boots: dict[str, int] = field(default_factory=dict)
    states: dict[str, Life] = field(default_factory=dict)
    repeats: dict[str, list[FaultReport]] = field(default_factory=dict)
    health: Health = field(default_factory=lambda: Health(stamp=0, level="unknown", summary=""))
    published: int = 0

    def __post_init__(self) -> None:
        self.now_s = self.start_s
        self.core = Aggregator(NEEDED, self.saved, self.now, self.wanted)

    @property
    def now(self) -> Instant:
        return Instant(int(self.now_s * S), UTC + int(self.now_s * S))

    def start(self, name: str, boot: int, state: Life = "ready") -> None:
        self.boots[name] = boot
        self.states[name] = state
        self.core.alive(name, True, self.now)
        self.beat(name)
        self.tick()

    def start_all(self) -> None:
        self.start("gateway/main", 99)
        self.start("classifier/main", CLASSIFIER_BOOT)

    def beat(
        self, name: str, lost: int = 0, reason: str = "", rejected: int = 0, rejection: str = ""
    ) -> None:
        beat = Heartbeat(
            stamp=self.now.utc_ns,
            boot=self.boots[name],
            state=self.states[name],
            period_s=0.5,
            pid=1,
            lost=lost,
            reason=reason,
            rejected=rejected,
            rejection=rejection,
        )
        self.core.heartbeat(name, beat, self.now)

    def tick(self) -> None:
        health = self.core.tick(self.now)
        if health is not None:
            self.health = health
            self.published += 1
            if self.core.unsaved():
                self.saved = wire.decode(wire.encode(health), Health)

    def run(self, seconds: float) -> None:
        """Goes on in steps of 0.25 s; every service in ``states`` beats, sources repeat."""
        for _ in range(round(seconds / 0.25)):
            self.now_s += 0.25
            if self.now_s % 0.5 == 0:
                for name in self.states:
                    self.beat(name)
            if self.now_s % 1 == 0:
                for source, reports in self.repeats.items():
                    for r in reports:
                        self.core.report(r, source, self.now)
            self.tick()

    def say(self, r: FaultReport, source: str = "classifier") -> None:
        self.core.report(r, source, self.now)
        active = self.repeats.setdefault(source, [])
        same = [a for a in active if (a.code, a.component) == (r.code, r.component)]
        for a in same:
            active.remove(a)
        if r.status == "active":
            active.append(r)
        self.tick()

    def kill(self, name: str) -> None:
        del self.states[name]
        for source in [s for s in self.repeats if s.startswith(name.split("/", maxsplit=1)[0])]:
            del self.repeats[source]
        self.core.alive(name, False, self.now)
        self.tick()

    def fault(self, code: str, component: str = "") -> FaultRecord:
        found = [f for f in self.health.faults if f.code == code and component in ("", f.component)]
        assert len(found) == 1, self.health.faults
        return found[0]

    def service(self, name: str) -> ServiceHealth:
        return next(s for s in self.health.services if s.name == name)


@pytest.fixture
def robot() -> Robot:
    robot = Robot()
    robot.start_all()
    return robot


# Faults


def test_a_robot_whose_services_are_ready_and_report_nothing_is_well(robot: Robot) -> None:
    assert (robot.health.level, robot.health.capabilities) == ("ok", {"can_command": True})
    assert robot.health.summary == "All well: 2 services ready, no fault."


def test_a_report_is_confirmed_and_published_at_once_with_its_evidence_frozen(robot: Robot) -> None:
    robot.say(report())
    fault = robot.fault("servo_silent")
    assert (fault.status, fault.occurrences) == ("confirmed", 1)
    assert (fault.evidence, fault.freeze_frame) == (Evidence(summary="seen"), None)
    assert (robot.health.level, robot.health.capabilities) == ("fault", {"can_command": False})
    assert (
        robot.health.summary
        == "Servo 3 on bus main does not answer, though servos behind it in the chain do."
    )


def test_a_repeated_report_counts_no_occurrence_and_publishes_nothing(robot: Robot) -> None:
    robot.say(report())
    published = robot.published
    robot.say(report())
    assert robot.published == published
    assert robot.fault("servo_silent").occurrences == 1


def test_a_fault_is_healed_after_its_time_and_kept(robot: Robot) -> None:
    robot.say(report())
    robot.say(report(status="healed"))
    assert robot.fault("servo_silent").status == "confirmed"
    robot.run(FAULT_CODES["servo_silent"].heal_s)
    assert robot.fault("servo_silent").status == "healed"
    assert robot.health.level == "ok"


def test_a_fault_that_comes_back_while_it_heals_is_the_same_occurrence(robot: Robot) -> None:
    robot.say(report())
    robot.say(report(status="healed"))
    robot.say(report())
    robot.run(5)
    fault = robot.fault("servo_silent")
    assert (fault.status, fault.occurrences) == ("confirmed", 1)


def test_first_and_last_are_those_of_one_occurrence(robot: Robot) -> None:
    begun = robot.now.utc_ns
    robot.say(report())
    robot.run(600)
    told = robot.fault("servo_silent")
    assert (told.first, told.last) == (begun, robot.now.utc_ns)
    robot.say(report(status="healed"))
    gone = robot.now.utc_ns
    robot.run(60)
    healed = robot.fault("servo_silent")
    assert (healed.status, healed.first, healed.last) == ("healed", begun, gone)
    back = msgspec.structs.replace(report(), since=robot.now.utc_ns)
    robot.say(back)
    robot.run(1)
    assert robot.fault("servo_silent").first == back.since


def test_a_fault_that_comes_back_healed_is_a_new_occurrence_not_yet_seen(
    robot: Robot,
) -> None:
    robot.say(report())
    robot.core.request(HealthRequest(operation="acknowledge"), robot.now)
    robot.say(report(status="healed"))
    robot.run(1)
    assert robot.fault("servo_silent").acknowledged
    robot.say(report())
    fault = robot.fault("servo_silent")
    assert (fault.status, fault.occurrences, fault.acknowledged) == ("confirmed", 2, False)


def test_two_sources_do_not_share_a_fault(robot: Robot) -> None:
    robot.say(report())
    robot.say(report(), source="other")
    robot.say(report(status="healed"), source="other")
    robot.run(1)
    assert sorted((f.source, f.status) for f in robot.health.faults) == [
        ("classifier", "confirmed"),
        ("other", "healed"),
    ]


def test_what_follows_from_a_confirmed_fault_stays_visible_but_inhibited(robot: Robot) -> None:
    robot.say(report())
    robot.say(report("packet_loss", "bus/legs/servo/3"))
    robot.say(report("adapter_unplugged", "bus/main/adapter", boot=99), source="gateway-main")
    assert robot.fault("servo_silent").inhibited_by == "bus/main/adapter/adapter_unplugged"
    assert robot.fault("packet_loss").inhibited_by == ""  # another bus
    assert robot.health.summary.startswith("The adapter of bus main is not there: R. (1 more)")
    robot.say(report("adapter_unplugged", "bus/main/adapter", "healed", 99), source="gateway-main")
    robot.run(1)
    assert robot.fault("servo_silent").inhibited_by == ""


def test_what_one_servo_has_explains_nothing_of_its_neighbour(robot: Robot) -> None:
    robot.say(report("return_delay", "bus/main/servo/1"))
    robot.say(report("slow_servo", "bus/main/servo/1"))
    robot.say(report("slow_servo", "bus/main/servo/2"))
    assert robot.fault("slow_servo", "bus/main/servo/1").inhibited_by
    assert not robot.fault("slow_servo", "bus/main/servo/2").inhibited_by


def test_answers_that_an_adapter_delivers_late_are_explained_by_its_latency_timer(
    robot: Robot,
) -> None:
    for bus in ("main", "legs"):
        robot.say(report("late_answers", f"bus/{bus}"), source="odometry")
    robot.say(report("latency_timer", "bus/main/adapter", boot=99), source="classifier-main")
    assert robot.fault("late_answers", "bus/main").inhibited_by == "bus/main/adapter/latency_timer"
    assert not robot.fault("late_answers", "bus/legs").inhibited_by


def test_a_gyro_that_contradicts_the_wheels_because_it_is_frozen_is_told_once(
    robot: Robot,
) -> None:
    robot.say(report("gyro_deviates", "gyro/body"), source="diagnoser")
    robot.say(report("gyro_deviates", "gyro/mast"), source="diagnoser")
    robot.say(report("gyro_frozen", "gyro/body", boot=99), source="odometry")
    assert robot.fault("gyro_deviates", "gyro/body").inhibited_by == "gyro/body/gyro_frozen"
    assert not robot.fault("gyro_deviates", "gyro/mast").inhibited_by


def test_a_code_of_a_users_own_source_is_a_warning(robot: Robot) -> None:
    own = report()
    own.code, own.message = "gripper_worn", "The gripper is worn."
    robot.say(own, source="gripper")
    assert (robot.health.level, robot.health.summary) == ("warning", "The gripper is worn.")


@pytest.mark.parametrize("confidence", [float("nan"), -0.1, 1.1])
def test_a_confidence_that_is_no_probability_is_rejected(robot: Robot, confidence: float) -> None:
    bad = report()
    bad.confidence = confidence
    with pytest.raises(Rejected, match="confidence"):
        robot.core.report(bad, "classifier", robot.now)


def test_nobody_else_reports_in_the_aggregators_name(robot: Robot) -> None:
    with pytest.raises(Rejected, match="own name"):
        robot.core.report(report(), "aggregator", robot.now)


def test_memory_is_bounded_and_forgets_acknowledged_healed_faults_first(robot: Robot) -> None:
    for servo in range(MAX_HEALED + 1):
        robot.say(report(component=f"bus/main/servo/{servo}"))
        if servo == MAX_HEALED // 2:
            place = f"bus/main/servo/{servo}"
            robot.core.request(HealthRequest(operation="acknowledge", component=place), robot.now)
        robot.say(report(component=f"bus/main/servo/{servo}", status="healed"))
    robot.run(1)
    kept = {f.component for f in robot.health.faults}
    assert len(kept) == MAX_HEALED
    assert f"bus/main/servo/{MAX_HEALED // 2}" not in kept


def test_beyond_the_bound_active_faults_are_refused_not_forgotten(robot: Robot) -> None:
    for servo in range(MAX_FAULTS):
        robot.core.report(report(component=f"bus/main/servo/{servo}"), "classifier", robot.now)
    with pytest.raises(Rejected, match="256"):
        robot.core.report(report(component="bus/main/servo/999"), "classifier", robot.now)
    robot.kill("gateway/main")  # has no room for a fault of its own, and survives
    assert robot.service("gateway/main").status == "dead"


# Services


def test_until_its_services_are_ready_health_is_unknown() -> None:
    robot = Robot()
    robot.tick()
    assert robot.health.level == "unknown"
    assert robot.health.summary == "The service classifier/main is starting. (1 more)"
    assert robot.health.capabilities == {}


def test_a_needed_service_that_never_comes_is_dead_after_the_start_up() -> None:
    robot = Robot()
    robot.start("classifier/main", CLASSIFIER_BOOT)
    robot.run(START_UP_S - 0.25)
    assert robot.service("gateway/main").status == "starting"
    robot.run(0.25)
    assert robot.service("gateway/main").status == "dead"
    assert robot.fault("service_dead").component == "service/gateway/main"
    assert robot.fault("service_dead").message.endswith("is dead: not seen within 10 s.")
    assert robot.health.level == "unknown"


def test_a_wanted_service_that_never_comes_is_a_warning() -> None:
    robot = Robot(wanted=("recorder/main",))
    robot.start_all()
    robot.run(START_UP_S - 0.5)
    assert robot.health.level == "ok"
    robot.run(1)
    assert robot.fault("service_dead").component == "service/recorder/main"
    assert robot.health.level == "warning"
    robot.start("recorder/main", 300)
    robot.run(1.5)
    assert robot.fault("service_dead").status == "healed"
    assert robot.health.level == "ok"


def test_a_killed_service_is_told_at_once_and_heals_when_it_is_back(robot: Robot) -> None:
    robot.kill("gateway/main")
    assert robot.service("gateway/main").status == "dead"
    assert robot.fault("service_dead").status == "confirmed"
    assert (robot.health.level, robot.health.capabilities) == ("unknown", {})
    robot.start("gateway/main", 101, "starting")
    robot.run(1)
    assert robot.service("gateway/main").status == "starting"
    assert robot.fault("service_dead").status == "confirmed"
    robot.states["gateway/main"] = "ready"
    robot.run(1.5)
    assert robot.fault("service_dead").status == "healed"
    assert robot.health.level == "ok"


def test_a_heartbeat_that_was_under_way_revives_no_dead_service(robot: Robot) -> None:
    robot.core.alive("gateway/main", False, robot.now)
    robot.now_s += 0.01
    robot.beat("gateway/main")
    robot.tick()
    assert robot.service("gateway/main").status == "dead"


def test_a_service_that_lost_its_token_and_beats_on_is_alive(robot: Robot) -> None:
    robot.core.alive("gateway/main", False, robot.now)
    robot.tick()
    robot.run(2)
    assert robot.service("gateway/main").status == "ready"


def test_a_service_whose_token_is_there_but_not_its_heartbeat_is_hung(robot: Robot) -> None:
    del robot.states["gateway/main"]
    robot.run(1.25)
    assert robot.service("gateway/main").status == "ready"  # two missing heartbeats are not late
    robot.run(0.25)
    assert robot.service("gateway/main").status == "hung"
    assert robot.fault("service_hung").status == "confirmed"


def test_a_crash_is_told_with_its_reason_and_does_not_become_a_death(robot: Robot) -> None:
    robot.states["classifier/main"] = "crashed"
    robot.beat("classifier/main", reason="ValueError: x (core.py:1)")
    robot.kill("classifier/main")
    assert robot.service("classifier/main").status == "crashed"
    assert "ValueError: x (core.py:1)" in robot.fault("service_crashed").message
    assert [f.code for f in robot.health.faults] == ["service_crashed"]


def test_a_goodbye_is_no_fault_but_health_without_it_is_unknown(robot: Robot) -> None:
    robot.states["gateway/main"] = "stopping"
    robot.beat("gateway/main")
    robot.kill("gateway/main")
    assert robot.service("gateway/main").status == "stopped"
    assert robot.health.faults == []
    assert (robot.health.level, robot.health.summary) == (
        "unknown",
        "The service gateway/main is stopped.",
    )


def test_a_service_that_nobody_needs_is_only_a_warning_when_it_dies(robot: Robot) -> None:
    robot.start("recorder/main", 7)
    robot.kill("recorder/main")
    assert robot.health.level == "warning"
    assert robot.health.capabilities == {"can_command": True}


def test_a_recording_that_is_played_stands_for_the_gateways() -> None:
    robot = Robot()
    robot.start("classifier/main", CLASSIFIER_BOOT)
    robot.start("playback/main", 8)
    assert robot.health.level == "ok"
    robot.run(2 * START_UP_S)
    assert (robot.health.level, robot.health.faults) == ("ok", [])
    gateway = robot.service("gateway/main")
    assert (gateway.status, gateway.reason) == ("stopped", "a recording is played in its place")
    robot.states["playback/main"] = "stopping"
    robot.run(2 * START_UP_S)
    assert robot.health.level == "unknown"  # again nobody tells anything
    assert robot.health.faults == []  # and nobody has died
    assert robot.service("gateway/main").reason == "the recording in its place has come to its end"
    robot.start("gateway/main", 99)
    assert robot.health.level == "ok"


def test_two_processes_under_one_name_are_told_apart_and_do_not_flap(robot: Robot) -> None:
    before = robot.health.transitions[-1].number
    for _ in range(10):
        robot.boots["gateway/main"] ^= 1
        robot.beat("gateway/main")
        robot.tick()
    service = robot.service("gateway/main")
    assert (service.status, service.reason) == ("ready", "two processes run under this name")
    assert robot.health.transitions[-1].number == before


def test_a_single_loss_of_messages_is_pending_and_repeated_loss_a_warning(robot: Robot) -> None:
    robot.beat("classifier/main", lost=3)
    robot.tick()
    assert (robot.fault("messages_lost").status, robot.health.level) == ("pending", "ok")
    for lost in range(4, 8):
        robot.now_s += 0.5
        robot.beat("gateway/main")
        robot.beat("classifier/main", lost=lost)
        robot.tick()
    assert (robot.fault("messages_lost").status, robot.health.level) == ("confirmed", "warning")
    assert robot.service("classifier/main").lost == 7
    for _ in range(12):
        robot.now_s += 0.5
        robot.beat("gateway/main")
        robot.beat("classifier/main", lost=7)
        robot.tick()
    assert robot.fault("messages_lost").status == "healed"


def test_messages_that_a_service_cannot_use_are_a_warning_with_the_reason(robot: Robot) -> None:
    robot.beat("classifier/main", rejected=1, rejection="bus/main/transaction: no Transaction")
    robot.tick()
    fault = robot.fault("messages_refused")
    assert (fault.status, robot.health.level) == ("confirmed", "warning")
    assert fault.message.endswith("cannot use: bus/main/transaction: no Transaction.")
    for _ in range(12):
        robot.now_s += 0.5
        robot.beat("gateway/main")
        robot.beat("classifier/main", rejected=1)
        robot.tick()
    assert robot.fault("messages_refused").status == "healed"


@pytest.mark.parametrize("period_s", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_a_heartbeat_that_could_never_be_late_is_rejected(robot: Robot, period_s: float) -> None:
    with pytest.raises(Rejected, match="period"):
        robot.core.heartbeat(
            "x/y", Heartbeat(stamp=0, state="ready", period_s=period_s, pid=1), robot.now
        )


def test_strangers_cannot_make_the_list_of_services_grow_for_ever(robot: Robot) -> None:
    with pytest.raises(Rejected, match="services"):
        for number in range(MAX_SERVICES):
            robot.core.alive(f"stranger/{number}", True, robot.now)
    robot.run(1)
    assert robot.service("gateway/main").status == "ready"


# Silence


def test_silence_makes_faults_unknown_and_heals_none(robot: Robot) -> None:
    robot.say(report())
    robot.kill("classifier/main")
    assert robot.fault("servo_silent").status == "unknown"
    assert "can_command" not in robot.health.capabilities
    robot.run(3600)
    assert robot.fault("servo_silent").status == "unknown"


def test_whether_what_would_not_count_still_holds_need_not_be_known(robot: Robot) -> None:
    robot.say(report("host_lag", "bus/main"))
    robot.kill("classifier/main")
    robot.start("classifier/main", 200)
    robot.run(1.5)
    assert robot.fault("host_lag").status == "unknown"
    assert robot.health.level == "ok"


def test_later_evidence_does_not_displace_what_the_fault_was_confirmed_with(robot: Robot) -> None:
    first, later = report(), report()
    later.evidence = Evidence(summary="seen again")
    robot.say(first)
    robot.say(first)
    assert robot.fault("servo_silent").freeze_frame is None
    robot.say(later)
    robot.run(2)
    fault = robot.fault("servo_silent")
    assert (fault.evidence, fault.freeze_frame) == (later.evidence, first.evidence)
    robot.say(report(status="healed"))
    robot.run(2)
    robot.say(later)
    fault = robot.fault("servo_silent")
    assert (fault.evidence, fault.freeze_frame, fault.occurrences) == (later.evidence, None, 2)


def test_after_a_restart_a_fault_found_again_is_the_same_occurrence(robot: Robot) -> None:
    robot.say(report())
    robot.kill("classifier/main")
    robot.start("classifier/main", 200)
    robot.run(1)
    assert robot.fault("servo_silent").status == "unknown"
    robot.say(report(boot=200))
    fault = robot.fault("servo_silent")
    assert (fault.status, fault.occurrences) == ("confirmed", 1)


def test_after_a_restart_a_fault_not_found_again_within_its_window_is_healed(robot: Robot) -> None:
    robot.say(report("packet_loss"))
    robot.kill("classifier/main")
    robot.start("classifier/main", 200, "starting")
    robot.run(60)
    assert robot.fault("packet_loss").status == "unknown"
    robot.states["classifier/main"] = "ready"
    robot.run(FAULT_CODES["packet_loss"].window_s)
    assert robot.fault("packet_loss").status == "unknown"
    robot.run(1)
    assert robot.fault("packet_loss").status == "healed"


def test_a_restart_too_quick_to_notice_a_death_makes_faults_unknown_too(robot: Robot) -> None:
    robot.say(report())
    robot.boots["classifier/main"] = 200
    robot.beat("classifier/main")
    robot.tick()
    assert robot.fault("servo_silent").status == "unknown"


def test_a_healed_report_that_was_lost_does_not_leave_the_fault_for_ever(robot: Robot) -> None:
    robot.say(report())
    robot.repeats.clear()
    robot.run(FAULT_CODES["servo_silent"].window_s)
    assert robot.fault("servo_silent").status == "confirmed"
    robot.run(1)
    assert robot.fault("servo_silent").status == "healed"


def test_a_source_without_heartbeat_is_judged_by_its_repetitions(robot: Robot) -> None:
    robot.say(report(boot=0), source="gripper")
    robot.run(10)
    assert robot.fault("servo_silent").status == "confirmed"
    robot.repeats.clear()
    robot.run(3)
    assert robot.fault("servo_silent").status == "unknown"
    robot.say(report(boot=0), source="gripper")
    assert robot.fault("servo_silent").status == "confirmed"


# Restart of the aggregator itself


def restarted(robot: Robot, after_s: float = 1.0) -> Robot:
    again = Robot(saved=robot.saved, start_s=robot.now_s + after_s)
    again.tick()
    return again


def test_no_confirmed_fault_is_lost_over_a_restart(robot: Robot) -> None:
    robot.say(report())
    again = restarted(robot)
    assert again.fault("servo_silent").status == "unknown"
    again.start_all()
    again.say(report())
    fault = again.fault("servo_silent")
    assert (fault.status, fault.occurrences) == ("confirmed", 1)
    assert fault.evidence == Evidence(summary="seen")


def test_a_fault_repaired_while_the_aggregator_was_off_heals(robot: Robot) -> None:
    robot.say(report())
    again = restarted(robot, after_s=86400)
    again.start_all()
    again.run(FAULT_CODES["servo_silent"].window_s + 1)
    assert again.fault("servo_silent").status == "healed"
    assert again.health.level == "ok"


def test_transitions_are_numbered_without_gaps_over_a_restart(robot: Robot) -> None:
    robot.say(report())
    before = robot.health.transitions[-1].number
    again = restarted(robot)
    again.start_all()
    numbers = [t.number for t in again.health.transitions]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert numbers[-1] > before


def test_a_dead_service_that_is_back_with_the_aggregator_is_forgiven(
    robot: Robot,
) -> None:
    robot.kill("gateway/main")
    again = restarted(robot)
    again.start_all()
    again.run(1)
    assert again.fault("service_dead").status == "healed"
    assert again.health.level == "ok"


def test_nothing_is_saved_twice(robot: Robot) -> None:
    assert robot.saved is not None
    robot.saved = None
    robot.run(5)
    assert robot.saved is None
    robot.say(report())
    assert robot.saved == robot.health


# Publishing and requests


def test_without_a_change_health_is_published_once_a_second(robot: Robot) -> None:
    robot.run(2)
    published = robot.published
    robot.run(10)
    assert robot.published - published == 10


def test_get_tells_health_as_it_is_now(robot: Robot) -> None:
    robot.say(report())
    reply = robot.core.request(HealthRequest(), robot.now)
    assert reply.ok
    assert reply.health is not None
    assert reply.health.faults == robot.health.faults


def test_acknowledging_changes_nothing_else(robot: Robot) -> None:
    robot.say(report())
    reply = robot.core.request(
        HealthRequest(operation="acknowledge", code="servo_silent"), robot.now
    )
    assert (reply.ok, reply.text) == (True, "1 acknowledged")
    robot.tick()
    fault = robot.fault("servo_silent")
    assert (fault.acknowledged, fault.status) == (True, "confirmed")
    assert robot.saved == robot.health


def test_clearing_forgets_healed_faults_and_leaves_active_ones(robot: Robot) -> None:
    robot.say(report())
    robot.say(report("noise", "bus/main"))
    robot.say(report("noise", "bus/main", "healed"))
    robot.run(1)
    reply = robot.core.request(HealthRequest(operation="clear"), robot.now)
    assert (reply.ok, reply.text) == (True, "1 cleared, 1 still active")
    reply = robot.core.request(HealthRequest(operation="clear", code="servo_silent"), robot.now)
    assert (reply.ok, reply.text) == (False, "0 cleared, 1 still active")
    robot.tick()
    assert [f.code for f in robot.health.faults] == ["servo_silent"]


def test_a_request_for_a_fault_that_is_not_there_says_so(robot: Robot) -> None:
    reply = robot.core.request(HealthRequest(operation="clear", code="noise"), robot.now)
    assert (reply.ok, reply.text) == (False, "no fault noise in memory")
    assert robot.core.request(HealthRequest(operation="clear"), robot.now).ok
