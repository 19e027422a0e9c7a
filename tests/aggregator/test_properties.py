"""What holds for every sequence of reports, heartbeats and requests, however hostile."""

import contextlib
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from wackel_aggregator.core import Aggregator
from wackel_aggregator.faults import MAX_FAULTS
from wackel_aggregator.services import MAX_SERVICES
from wackel_node.clock import Instant
from wackel_schemas import wire
from wackel_schemas.bus import Transaction
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.fault_codes import FAULT_CODES
from wackel_schemas.health import Health, HealthRequest, Heartbeat, Transition
from wackel_schemas.keys import MOST_HEALTH_BYTES
from wackel_schemas.wire import Rejected

S = 1_000_000_000

words = st.sampled_from(["", "/", "bus", "bus/main", "service/gateway/main", "{reason}", "\0ü"])
codes = st.sampled_from([*FAULT_CODES, "", "{}", "foreign"])
components = words | st.sampled_from(["bus/main/servo/3", "bus/main/adapter", "bus/main/cable/1-2"])
numbers = st.sampled_from([0, 1, -1, 2, 2**63 - 1, 2**64 - 1, -(2**63)])
TRANSACTIONS = [
    Transaction(
        stamp=1,
        purpose="cycle",
        instruction=bytes(length),
        sent_ns=0,
        chunks=[],
        expected=[],
        expected_bytes=0,
        deadline_ns=0,
        ended_ns=0,
        baud_rate=1_000_000,
    )
    for length in (10, 200_000)
]
reports = st.builds(
    FaultReport,
    stamp=numbers,
    boot=numbers,
    seq=numbers,
    code=codes,
    component=components,
    status=st.sampled_from(["active", "healed"]),
    confidence=st.floats(0, 1) | st.floats(),
    message=words,
    remedy=words,
    evidence=st.builds(
        Evidence,
        summary=words | st.just("long" * 3000),
        values=st.dictionaries(words, st.floats() | numbers | words, max_size=2),
        transaction=st.none() | st.sampled_from(TRANSACTIONS),
    ),
    since=numbers,
    suspects=st.lists(words, max_size=2),
)
beats = st.builds(
    Heartbeat,
    stamp=numbers,
    boot=numbers,
    state=st.sampled_from(["starting", "ready", "stopping", "crashed"]),
    period_s=st.sampled_from([0.5, 60.0]) | st.floats(),
    pid=numbers,
    reason=words | st.just("why" * 9999),
    rejected=numbers,
    rejection=words | st.just("why" * 9999),
    lost=numbers,
    overrun=numbers,
    received=numbers,
)
names = st.sampled_from(
    ["gateway/main", "classifier/main", "playback/x", "", "/", "aggregator/main", "x/" + 999 * "y"]
)
sources = st.sampled_from(["classifier", "gateway-main", "aggregator", "", "x", 999 * "y"])
requests = st.builds(
    HealthRequest,
    operation=st.sampled_from(["get", "acknowledge", "clear"]),
    code=codes,
    component=components,
)
steps = st.one_of(
    st.tuples(st.just("report"), reports, sources),
    st.tuples(st.just("heartbeat"), names, beats),
    st.tuples(st.just("alive"), names, st.booleans()),
    st.tuples(st.just("request"), requests),
    st.tuples(st.just("restart")),
)
waits = st.sampled_from([0.0, 0.01, 0.3, 1.0, 6.0, 100.0])
NEEDED = ("gateway/main", "classifier/main")


class Watch:
    """Follows the transitions and health of a run and checks what must always hold."""

    def __init__(self) -> None:
        self.seen: list[Transition] = []

    def check(self, health: Health) -> None:
        data = wire.encode(health)
        assert wire.decode(data, Health) == health  # anything it says can be sent, and is a number
        assert len(data) <= MOST_HEALTH_BYTES
        last = self.seen[-1].number if self.seen else -1
        self.seen += [t for t in health.transitions if t.number > last]
        assert [t.number for t in self.seen] == list(range(len(self.seen)))
        assert len(health.faults) <= MAX_FAULTS
        assert len(health.services) <= MAX_SERVICES
        for fault in health.faults:
            if fault.status == "confirmed":
                assert fault.occurrences >= 1
            assert fault.evidence is not None
            assert fault.freeze_frame != fault.evidence
            if fault.inhibited_by:
                assert fault.status != "healed"
                assert any(
                    fault.inhibited_by == f"{root.component}/{root.code}"
                    for root in health.faults
                    if root.status == "confirmed"
                )
        if any(f.status == "confirmed" and f.severity == "fault" for f in health.faults):
            assert health.level != "ok"
        if any(f.status == "unknown" for f in health.faults):
            assert health.level in ("unknown", "fault")


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(steps, waits), max_size=40))
def test_no_sequence_of_messages_breaks_health(sequence: list[tuple[Any, float]]) -> None:
    now = Instant(0, 1_700_000_000 * S)
    core = Aggregator(NEEDED, None, now)
    watch = Watch()
    saved = None
    for (operation, *arguments), wait_s in sequence:
        now = Instant(now.monotonic_ns + int(wait_s * S), now.utc_ns + int(wait_s * S))
        if operation == "restart":
            core = Aggregator(NEEDED, saved, now)
        else:
            with contextlib.suppress(Rejected):
                getattr(core, operation)(*arguments, now)
        health = core.tick(now)
        if health is not None:
            watch.check(health)
            if core.unsaved():
                saved = wire.decode(wire.encode(health), Health)
    watch.check(core.health(now))
    check_order(watch.seen)


def check_order(transitions: list[Transition]) -> None:
    """A fault heals only after it was there, and each change starts where the last one ended."""
    allowed = {
        "": {"pending", "confirmed"},
        "pending": {"confirmed", "healed", "unknown"},
        "confirmed": {"healed", "unknown"},
        "unknown": {"pending", "confirmed", "healed", ""},
        "healed": {"pending", "confirmed", ""},
    }
    for transition in transitions:
        if " " in transition.subject:
            assert transition.after in allowed[transition.before], transition
        else:
            assert transition.after != transition.before


@settings(max_examples=100, deadline=None)
@given(st.lists(st.sampled_from(["active", "healed", "die", "back", "wait"]), max_size=30))
def test_silence_never_heals(story: list[str]) -> None:
    now = Instant(0, 0)
    core = Aggregator((), None, now)
    alive, boot = True, 1

    def beat() -> None:
        life = Heartbeat(stamp=0, boot=boot, state="ready", period_s=0.5, pid=1)
        core.heartbeat("classifier/main", life, now)

    beat()
    for event in story:
        now = Instant(now.monotonic_ns + S // 4, now.utc_ns + S // 4)
        match event:
            case "active" | "healed" if alive:
                report = FaultReport(
                    stamp=now.utc_ns,
                    boot=boot,
                    code="noise",
                    component="bus/main",
                    status="active" if event == "active" else "healed",
                    confidence=1.0,
                    message="",
                    remedy="",
                    evidence=Evidence(summary=""),
                    since=0,
                )
                core.report(report, "classifier", now)
            case "die" if alive:
                alive = False
                core.alive("classifier/main", False, now)
            case "back" if not alive:
                alive, boot = True, boot + 1
                core.alive("classifier/main", True, now)
            case "wait":
                now = Instant(now.monotonic_ns + 100 * S, now.utc_ns + 100 * S)
        if alive:
            beat()
        before = [f.status for f in core.health(now).faults if f.code == "noise"]
        core.tick(now)
        after = [f.status for f in core.health(now).faults if f.code == "noise"]
        if not alive:
            assert after in (before, ["unknown"])
