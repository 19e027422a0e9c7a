"""Parse and diagnose a 20-servo sync-read answer, against the vendor's own parser on the bytes."""

from collections.abc import Callable

from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, PacketHandler, PortHandler
from rich.table import Table

from tests.bench.result import Figure, side_by_side, table
from wackel_classifier.core import BusClassifier
from wackel_node.config import BusConfig, ClassifierConfig, ServoConfig
from wackel_protocols.dynamixel2 import StatusPacket, fast_sync_read, sync_read
from wackel_protocols.dynamixel2.answers import AnswerReader
from wackel_protocols.dynamixel2.expectation import expect
from wackel_protocols.dynamixel2.fast import encode_fast
from wackel_schemas.bus import Chunk, ResponseTime, Transaction

SERVOS = 20
_ADDRESS, _LENGTH = 132, 4  # Present Position of series X


class _Memory(PortHandler):  # type: ignore[misc]
    """The vendor's port with an answer that is already there, so that only parsing is timed."""

    def __init__(self) -> None:
        super().__init__("memory")
        self.answer = b""
        self.tx_time_per_byte = 0.01

    def readPort(self, length: int) -> bytes:
        taken, self.answer = self.answer[:length], self.answer[length:]
        return taken


def run(*, quick: bool = False) -> Table:
    """Times reader, reader with classifier, and the vendor's parser in turn."""
    rounds = 10 if quick else 100
    ids = list(range(1, SERVOS + 1))
    values = [(0, (2048 + i).to_bytes(_LENGTH, "little")) for i in ids]
    instruction = sync_read(ids, _ADDRESS, _LENGTH)
    answer = b"".join(StatusPacket(i, e, d).encode() for i, (e, d) in zip(ids, values, strict=True))
    fast_instruction = fast_sync_read(ids, _ADDRESS, _LENGTH)
    fast_answer = encode_fast(expect(fast_instruction), values)

    vendor_port = _Memory()
    vendor = GroupSyncRead(vendor_port, PacketHandler(2.0), _ADDRESS, _LENGTH)
    for i in ids:
        vendor.addParam(i)

    def parse_as_vendor() -> None:
        vendor_port.answer = answer
        if vendor.rxPacket() != COMM_SUCCESS:
            raise RuntimeError("the vendor's parser did not accept the answer")

    reader = AnswerReader(expect(instruction))
    fast_reader = AnswerReader(expect(fast_instruction))
    damaged = b"\x00" + answer
    diagnose = _diagnosis(instruction, answer)
    parse, fast, with_zero, whole, peer = side_by_side(
        lambda: reader.read(answer),
        lambda: fast_reader.read(fast_answer),
        lambda: reader.read(damaged),
        diagnose,
        parse_as_vendor,
        rounds=rounds,
    )
    vendor_figure = ("GroupSyncRead.rxPacket", peer)
    return table(
        f"Parsing and diagnosis, {SERVOS} servos × {_LENGTH} bytes, from memory",
        [
            Figure("parse and diagnose", whole, "µs", vendor_figure, 0.25),
            Figure("parse", parse, "µs", vendor_figure),
            Figure("parse, one stray 0x00", with_zero, "µs", vendor_figure),
            Figure("parse, fast sync read", fast, "µs", vendor_figure),
            Figure("what the classifier adds to parsing", whole - parse, "µs", None, 12.0),
        ],
    )


def _diagnosis(instruction: bytes, answer: bytes) -> Callable[[], None]:
    """One step of a classifier that has seen healthy traffic for a while, time going on."""
    ids = list(range(1, SERVOS + 1))
    config = BusConfig(port="memory", servos=[ServoConfig(id=i) for i in ids])
    classifier = BusClassifier("main", config, ClassifierConfig())
    transaction = Transaction(
        stamp=0,
        purpose="cycle",
        instruction=instruction,
        sent_ns=400_000,
        chunks=[Chunk(at_ns=1_000_000, data=answer[:15]), Chunk(at_ns=3_600_000, data=answer[15:])],
        expected=ids,
        expected_bytes=len(answer),
        deadline_ns=6_000_000,
        ended_ns=3_600_000,
        baud_rate=1_000_000,
        response_times=[ResponseTime(id=i, ns=3_200_000) for i in ids],
    )

    def step() -> None:
        transaction.stamp += 5_000_000
        if classifier.step(transaction):
            raise RuntimeError("the classifier reports a fault in healthy traffic")

    for _ in range(2000):
        step()
    return step
