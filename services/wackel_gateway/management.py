"""Requests: everything a person or tool does with servos beside the cycle.

The vendor's library does the management, but over our port: each packet it sends is one captured
transaction. Its defects that matter here are made good: it sends FF FF FD
unstuffed, loses a byte where an answer holds that run twice, and spins while it waits.
"""

from collections.abc import Callable, Sequence

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_RX_TIMEOUT, COMM_SUCCESS, PortHandler
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from wackel_gateway.commands import Refused
from wackel_gateway.exchange import Exchange
from wackel_gateway.outcome import Outcome
from wackel_gateway.roster import Roster
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import AnswerReader, reader
from wackel_protocols.dynamixel2.control_table import Register
from wackel_protocols.dynamixel2.errors import describe_error
from wackel_protocols.dynamixel2.expectation import Expectation
from wackel_protocols.dynamixel2.packet import (
    ALERT,
    BROADCAST_ID,
    MAX_ID,
    MAX_LEN,
    PREFIX_BYTES,
    STATUS_BYTES,
    InstructionPacket,
    PacketError,
)
from wackel_protocols.dynamixel2.stuffing import unstuff
from wackel_schemas.bus import BusReply, BusRequest, Transaction

_FAILURES = {COMM_RX_TIMEOUT: "no answer", COMM_RX_CORRUPT: "its answer came damaged"}
_LENGTHS = (1, 2, 4)
_MAX_READ = 1024  # more than any control table holds
_RESET_EXCEPT_ID_AND_BAUD_RATE = packet.FactoryReset.EXCEPT_ID_AND_BAUD_RATE


class CapturedPort(PortHandler):  # type: ignore[misc]
    """The vendor's port on ours: writing runs a whole transaction, reading takes from its answer.

    Attributes:
        last: The latest transaction.
    """

    def __init__(self, exchange: Exchange, publish: Callable[[Outcome], Transaction]) -> None:
        super().__init__(exchange.port.path)
        self._exchange = exchange
        self._publish = publish
        self._received = b""
        self.last: Transaction | None = None
        self.is_open = True
        self.baudrate = exchange.port.baud_rate

    def run(self, instruction: bytes, expected: AnswerReader | None = None) -> Outcome:
        """One transaction, published."""
        late = self._exchange.drain()
        if late is not None:
            self._publish(late)
        self._exchange.send("request", instruction, expected)
        outcome = self._exchange.gather()
        self.last = self._publish(outcome)
        return outcome

    def writePort(self, packet: Sequence[int]) -> int:  # noqa: N802 (the vendor's name)
        """Sends what the vendor composed, stuffed as it should have been."""
        composed = bytes(packet)
        instruction = InstructionPacket(composed[4], composed[7], composed[8:-2])
        chunks = self.run(instruction.encode()).chunks
        self._received = b"".join(data for _, data in chunks)
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802 (the vendor's name)
        """Takes from what came."""
        taken, self._received = self._received[:length], self._received[length:]
        return taken

    def clearPort(self) -> None:  # noqa: N802 (the vendor's name)
        """What came to nobody is published, not thrown away, before the next transaction."""
        self._received = b""

    def isPacketTimeout(self) -> bool:  # noqa: N802 (the vendor's name)
        """Waiting was done while writing; what is not here will not come."""
        return not self._received


class _Vendor(Protocol2PacketHandler):  # type: ignore[misc]
    def removeStuffing(self, packet: Sequence[int]) -> list[int]:  # noqa: N802 (the vendor's name)
        """As the vendor's, but right where an answer holds the run FF FF FD twice."""
        raw = bytes(packet)
        body = unstuff(raw[PREFIX_BYTES:-2])
        length = (len(body) + 2).to_bytes(2, "little")
        return list(raw[: PREFIX_BYTES - 2] + length + body + raw[-2:])


class Management:
    """Carries out requests on a bus that is free."""

    def __init__(
        self,
        exchange: Exchange,
        roster: Roster,
        publish: Callable[[Outcome], Transaction],
    ) -> None:
        self._port = CapturedPort(exchange, publish)
        self._vendor = _Vendor()
        self._roster = roster

    def carry_out(self, request: BusRequest, stamp: int) -> BusReply:
        """The reply to a request.

        Raises:
            Refused: It makes no sense; nothing was sent.
            PortLost: The port went away.
        """
        reply = self._carry_out(request)
        reply.stamp = stamp
        reply.transaction = self._port.last
        return reply

    def _carry_out(self, request: BusRequest) -> BusReply:
        match request.operation:
            case "scan":
                return self._all()
            case "ping" if request.id == BROADCAST_ID:
                return self._all()
            case "raw":
                return self._raw(request)
        servo_id = request.id
        if not 0 <= servo_id <= MAX_ID:
            raise Refused("unknown servo", f"{servo_id} is no id of a servo (0 … {MAX_ID})")
        match request.operation:
            case "ping":
                number, result, error = self._vendor.ping(self._port, servo_id)
                return self._reply(servo_id, result, error, f"model number {number}", number)
            case "reboot":
                result, error = self._vendor.reboot(self._port, servo_id)
                # It answers before it restarts, with the alert that the restart clears.
                return self._reply(servo_id, result, error & ~ALERT, "rebooted")
            case "factory_reset":
                result, error = self._vendor.factoryReset(
                    self._port, servo_id, _RESET_EXCEPT_ID_AND_BAUD_RATE
                )
                return self._reply(servo_id, result, error, "reset, except id and baud rate")
            case "read":
                return self._read(request)
            case _:
                return self._write(request)

    def _read(self, request: BusRequest) -> BusReply:
        register = self._register(request)
        address = register.address if register else _given(request.address, "address")
        length = register.length if register else _given(request.length, "length")
        if not (0 <= address <= MAX_LEN and 0 < length <= _MAX_READ):
            raise Refused("out of range", f"{length} bytes at address {address}")
        data, result, error = self._vendor.readTxRx(self._port, request.id, address, length)
        if result != COMM_SUCCESS or packet.StatusPacket(request.id, error).error_number:
            return self._reply(request.id, result, error, "")
        raw = bytes(data)
        value = register.decode(raw) if register else int.from_bytes(raw, "little")
        text = f"{register.name} = {value}" if register else raw.hex(" ")
        if register and register.unit:
            text += f" ({register.to_si(value):g} {register.unit})"
        return self._reply(request.id, result, error, text, value)

    def _write(self, request: BusRequest) -> BusReply:
        register = self._register(request)
        value = _given(request.value, "value")
        if register is not None:
            low, high = register.bounds
            if register.access != "rw":
                raise Refused("read only", f"{register.name} cannot be written")
            if not low <= value <= high:
                raise Refused("out of range", f"{register.name} = {value}: {low} … {high}")
            address, data = register.address, register.encode(value)
        else:
            address, length = _given(request.address, "address"), _given(request.length, "length")
            if length not in _LENGTHS or not 0 <= address <= MAX_LEN:
                raise Refused("out of range", f"{length} bytes at address {address}")
            try:
                data = value.to_bytes(length, "little", signed=value < 0)
            except OverflowError as overflow:
                raise Refused("out of range", f"{value} in {length} bytes") from overflow
        result, error = self._vendor.writeTxRx(
            self._port, request.id, address, len(data), list(data)
        )
        return self._reply(request.id, result, error, f"wrote {value} at address {address}")

    def _all(self) -> BusReply:
        """Broadcast ping: takes most of a second, in which the cycle waits."""
        outcome = self._port.run(packet.ping(BROADCAST_ID))
        ids = [status.id for status in outcome.answers.statuses]
        text = f"{len(ids)} servos answered" if ids else "no servo answered"
        return BusReply(stamp=0, ok=bool(ids), text=text, ids=ids)

    def _raw(self, request: BusRequest) -> BusReply:
        """Any instruction; of one that is unknown here, the request says who will answer."""
        number = _given(request.instruction, "instruction")
        try:
            instruction = InstructionPacket(request.id, number, request.parameters).encode()
        except PacketError as error:
            raise Refused("no packet", str(error)) from error
        ids = tuple(request.answers)
        if len(set(ids)) < len(ids) or not all(0 <= servo_id <= MAX_ID for servo_id in ids):
            raise Refused("unknown servo", f"answers = {request.answers}: each id once")
        expected = reader(instruction)
        if ids and not expected.expectation.ids:
            expected = AnswerReader(Expectation(ids, (STATUS_BYTES,) * len(ids)))
        answers = self._port.run(instruction, expected).answers
        missing = ", ".join(map(str, answers.missing))
        return BusReply(
            stamp=0,
            ok=not missing,
            text=f"no answer from servo {missing}" if missing else "done",
            ids=[status.id for status in answers.statuses],
        )

    def _register(self, request: BusRequest) -> Register | None:
        if request.register is None:
            return None
        table = self._roster.model(request.id)
        if table is None:
            raise Refused("unknown servo", f"the model of servo {request.id} is not configured")
        register = table.registers.get(request.register)
        if register is None:
            raise Refused("no such register", f"{table.name} has no {request.register}")
        return register

    def _reply(
        self, servo_id: int, result: int, error: int, text: str, value: int | None = None
    ) -> BusReply:
        if result != COMM_SUCCESS:
            failure = _FAILURES.get(result) or self._vendor.getTxRxResult(result)
            return BusReply(stamp=0, ok=False, text=failure)
        ok = not packet.StatusPacket(servo_id, error).error_number
        text = "; ".join([*([text] if ok else []), *describe_error(error)])
        return BusReply(stamp=0, ok=ok, text=text, value=value, ids=[servo_id])


def _given(value: int | None, name: str) -> int:
    if value is None:
        raise Refused("incomplete request", f"{name} is missing")
    return value
