"""Whatever comes: no crash, bounded memory, the same reports for the same transactions."""

import gc
from collections import deque
from random import Random

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.classifier.rig import Rig, chain
from wackel_classifier.core import BusClassifier
from wackel_node.config import BusConfig, ClassifierConfig
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.packet import StatusPacket
from wackel_schemas.bus import Chunk, Purpose, ResponseTime, Transaction

NS = st.integers(-(2**63), 2**63 - 1)
IDS = st.integers(0, 255)
INSTRUCTIONS = st.one_of(
    st.binary(max_size=40),
    st.builds(packet.ping, st.integers(0, 252)),
    st.builds(packet.read, st.integers(0, 252), st.integers(0, 300), st.integers(0, 100)),
    st.builds(
        packet.sync_read,
        st.lists(st.integers(0, 20), min_size=1, max_size=6, unique=True),
        st.sampled_from((126, 132, 144, 9, 64)),
        st.integers(1, 20),
    ),
    st.builds(
        packet.fast_sync_read,
        st.lists(st.integers(0, 20), min_size=1, max_size=6, unique=True),
        st.sampled_from((126, 132, 144)),
        st.integers(1, 20),
    ),
)
BYTES = st.one_of(
    st.binary(max_size=80),
    st.builds(
        lambda i, e, p: StatusPacket(i, e, p).encode(),
        st.integers(0, 252),
        st.integers(0, 255),
        st.binary(max_size=20),
    ),
    st.integers(0, 300).map(bytes),
)
PURPOSES: st.SearchStrategy[Purpose] = st.sampled_from(
    ("cycle", "ping", "background", "command", "request", "observed")
)
TRANSACTIONS = st.builds(
    Transaction,
    stamp=NS,
    purpose=PURPOSES,
    instruction=INSTRUCTIONS,
    sent_ns=NS,
    chunks=st.lists(st.builds(Chunk, at_ns=NS, data=BYTES), max_size=4),
    expected=st.lists(IDS, max_size=8),
    expected_bytes=st.integers(-10, 10_000),
    deadline_ns=NS,
    ended_ns=NS,
    baud_rate=st.integers(-1, 10_000_000),
    response_times=st.lists(st.builds(ResponseTime, id=IDS, ns=NS), max_size=8),
    host_lag_ns=NS,
    late_ns=NS,
)


@settings(max_examples=150, deadline=None)
@given(st.lists(TRANSACTIONS, max_size=12), st.sampled_from((0, 1, 5)))
def test_no_sequence_of_transactions_crashes_it(transactions: list[Transaction], size: int) -> None:
    classifier = BusClassifier("main", chain(size), ClassifierConfig())
    for transaction in transactions:
        for report in classifier.step(transaction):
            assert report.message
            assert report.code
    classifier.active()


def hostile(random: Random, count: int) -> list[Transaction]:
    transactions = []
    stamp = 0
    for _ in range(count):
        stamp += random.choice((0, 1_000_000, 10_000_000, -5_000_000, 3_000_000_000))
        ids = random.sample(range(1, 30), random.randint(1, 6))
        instruction = random.choice(
            (packet.sync_read(ids, random.randrange(200), 4), packet.ping(ids[0]), b"")
        )
        answers = b"".join(
            StatusPacket(i, random.choice((0, 0, 0x80, 3, 7)), random.randbytes(4)).encode()
            for i in ids
            if random.random() < 0.7
        )
        noise = random.randbytes(random.choice((0, 0, 3, 200)))
        transactions.append(
            Transaction(
                stamp=stamp,
                purpose="cycle",
                instruction=instruction,
                sent_ns=100_000,
                chunks=[Chunk(at_ns=2_000_000, data=answers + noise)],
                expected=list(ids) if instruction[7:8] == b"\x82" else ids[:1],
                expected_bytes=100,
                deadline_ns=5_000_000,
                ended_ns=random.choice((2_000_000, 6_000_000)),
                baud_rate=1_000_000,
            )
        )
    return transactions


def kept(root: object) -> int:
    """How many objects something holds, other than classes and modules."""
    seen: set[int] = set()
    waiting: deque[object] = deque([root])
    while waiting:
        thing = waiting.popleft()
        if id(thing) in seen or isinstance(thing, type) or callable(thing):
            continue
        seen.add(id(thing))
        waiting.extend(gc.get_referents(thing))
    return len(seen)


def test_memory_stays_bounded_whatever_comes() -> None:
    classifier = BusClassifier("main", chain(8), ClassifierConfig())
    random = Random(1)
    for transaction in hostile(random, 3000):
        classifier.step(transaction)
    early = kept(classifier)
    for transaction in hostile(random, 6000):
        classifier.step(transaction)
    assert kept(classifier) < 2 * early + 5000


def recorded(config: BusConfig) -> list[Transaction]:
    rig = Rig(config, 3, loss=0.001)
    transactions = list(rig.traffic(1.0))
    rig.inject("loose_contact", 3, 8.0)
    transactions += rig.traffic(3.0)
    rig.inject("rhythmic_jammer")
    return [*transactions, *rig.traffic(1.0)]


def test_the_same_transactions_give_the_same_reports_byte_by_byte() -> None:
    config = chain(6)
    transactions = recorded(config)

    def reports() -> bytes:
        classifier = BusClassifier("main", config, ClassifierConfig())
        found = [report for t in transactions for report in classifier.step(t)]
        assert found
        return msgspec.msgpack.encode(found)

    assert reports() == reports()


def test_a_step_of_the_wall_clock_breaks_nothing() -> None:
    rig = Rig(chain(6), 1)
    classifier = rig.classifier
    for transaction in rig.traffic(1.0):
        assert classifier.step(transaction) == []
    for transaction in rig.traffic(1.0):
        transaction.stamp -= 3600 * 10**9
        assert classifier.step(transaction) == []
    for transaction in rig.traffic(1.0):
        transaction.stamp += 3600 * 10**9
        assert classifier.step(transaction) == []
