"""What travels together, and what never waits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wackel_gateway.outbox import SUSPECT_NS, WAIT_NS, Outbox
from wackel_gateway.outcome import Outcome
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import reader
from wackel_protocols.dynamixel2.packet import StatusPacket
from wackel_schemas.bus import Purpose

MS = 1_000_000
READ = packet.read(1, 132, 4)


def outcome(
    at_ms: float, purpose: Purpose = "cycle", *, answered: bool = True, error: int = 0
) -> Outcome:
    """An instruction sent at a time and answered within a millisecond, or not."""
    begin_ns = round(at_ms * MS)
    data = StatusPacket(1, error, bytes(4)).encode() if answered else b""
    read = reader(READ)
    chunks = [(begin_ns + MS, data)] if data else []
    return Outcome(
        purpose, READ, read.expectation, begin_ns, begin_ns, chunks, read.read(data),
        begin_ns + MS, begin_ns + MS, 0, 1_000_000,
    )  # fmt: skip


class Told:
    """An outbox, and what has left it: (kind, when the outcome began, ms)."""

    def __init__(self) -> None:
        self.left: list[tuple[str, float]] = []
        self.box = Outbox(
            lambda outcome: self.left.append(("transaction", outcome.begin_ns / MS)),
            lambda outcome: self.left.append(("state", outcome.begin_ns / MS)),
        )

    def follow(self, *outcomes: Outcome) -> list[tuple[str, float]]:
        """What leaves while these happen, each released at its end."""
        self.left.clear()
        for each in outcomes:
            self.box.add(each)
            self.box.release(each.ended_ns)
        return list(self.left)


def test_on_a_busy_bus_states_leave_at_once_and_transactions_together() -> None:
    told = Told()
    told.follow(outcome(0))
    assert told.follow(*(outcome(at) for at in (5, 10, 15))) == [
        ("state", 5),
        ("state", 10),
        ("state", 15),
    ]
    assert told.box.due_ns == 6 * MS + WAIT_NS
    assert told.follow(outcome(26)) == [
        *(("transaction", at) for at in (5, 10, 15, 26)),
        ("state", 26),
    ]
    assert told.box.due_ns is None


def test_what_is_read_beside_the_cycles_waits_for_their_state() -> None:
    told = Told()
    told.follow(outcome(0))
    assert told.follow(outcome(3, "background")) == []
    assert told.follow(outcome(5)) == [("state", 3), ("state", 5)]


def test_without_traffic_nothing_waits() -> None:
    told = Told()
    for at in (0, 50, 100):
        assert told.follow(outcome(at)) == [("transaction", at), ("state", at)]


def test_a_bus_that_falls_silent_is_told_of_in_time() -> None:
    told = Told()
    told.follow(outcome(0), outcome(5))
    told.left.clear()
    told.box.release(6 * MS + WAIT_NS - 1)
    assert told.left == []
    told.box.release(6 * MS + WAIT_NS)
    assert told.left == [("transaction", 5)]


@pytest.mark.parametrize("trouble", [{"answered": False}, {"error": 0x80}])
def test_trouble_leaves_at_once_and_for_a_while_nothing_waits_after_it(
    trouble: dict[str, int],
) -> None:
    told = Told()
    told.follow(outcome(0), outcome(5))
    told.left.clear()
    told.box.add(outcome(10, **trouble))
    assert told.left == [("transaction", 5), ("transaction", 10)]
    told.box.release(11 * MS)
    assert told.left[2:] == [("state", 10)]
    assert told.follow(outcome(15, "ping")) == [("transaction", 15), ("state", 15)]
    late = 10 + SUSPECT_NS / MS
    told.follow(*(outcome(at) for at in range(20, int(late), 10)))
    assert told.follow(outcome(late)) == [("state", late)]


@given(
    st.lists(
        st.tuples(
            st.integers(1, 60), st.sampled_from(["cycle", "background", "ping"]), st.booleans()
        ),
        max_size=40,
    )
)
def test_everything_leaves_once_in_order_and_in_time(
    steps: list[tuple[int, Purpose, bool]],
) -> None:
    told = Told()
    at, begun = 0, []
    for pause, purpose, answered in steps:
        at += pause
        begun.append(at)
        due_ns = told.box.due_ns
        if due_ns is not None and due_ns <= at * MS:
            told.box.release(due_ns)
            assert told.box.due_ns is None
        told.box.add(outcome(at, purpose, answered=answered))
        told.box.release((at + 1) * MS)
    told.box.release_all()
    for kind in ("transaction", "state"):
        assert [begin for what, begin in told.left if what == kind] == begun
