"""One bus as discrete events: the host's bytes, the servos' answers, and what becomes of them.

Time is an argument, in ns; nothing here reads a clock or sleeps. One event stands for a whole
packet, at the moment its last bit has passed, so an answer of 20 servos costs 20 events.

Assumptions where the manual and the thesis are silent are named where they stand.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from heapq import heappop, heappush
from random import Random
from typing import Any

from wackel_node.config import BusConfig
from wackel_protocols.dynamixel2.expectation import PING_BYTES, Expectation
from wackel_protocols.dynamixel2.fast import fast_prefix
from wackel_protocols.dynamixel2.packet import (
    BROADCAST_ID,
    PREFIX_BYTES,
    Instruction,
    InstructionPacket,
    StatusPacket,
    crc,
)
from wackel_virtual import groups
from wackel_virtual.adapter import Adapter
from wackel_virtual.board import Board
from wackel_virtual.chain import OPEN_OHM, Chain, voltages
from wackel_virtual.collision import BITS, superposed
from wackel_virtual.disturbance import BitErrors, JammerStream, jammed_share, zeros
from wackel_virtual.faults import Conditions
from wackel_virtual.framing import Framer, Heard
from wackel_virtual.servo import Servo
from wackel_virtual.table import CRC_ERROR

PROCESSING_NS = 52_000
"""From the last bit of an instruction to the first of the answer, beyond Return Delay Time: with it
a ping at 2 Mbit/s takes the 672 µs of the thesis (2.7): 50 of instruction, 500 of delay, 70 of
answer, and this."""
TURN_NS = 4_000
"""The same for a servo whose answer is ready and that only waits for its predecessor's end."""
JITTER_NS = 3_000
"""Greatest deviation of both: the firmware's loop; the spread in the thesis's figure 2.7."""
PING_SLOT_NS = 3_000_000
"""Of one id in a broadcast ping, beyond the time of its answer's bytes (SDK: 3 ms an id)."""
TTY_BYTES = 4096
"""What the operating system keeps for a reader that does not read; the rest is lost."""
POWER_CHECK_NS = 100_000_000
"""How often servos compare their input voltage with its limits."""


@dataclass(slots=True, eq=False)
class _Group:
    """A sync or bulk read whose servos answer one after the other.

    ``reads`` are address and length for each servo; ``listening`` are the servos that have heard
    the request, by id.
    """

    expectation: Expectation
    reads: tuple[tuple[int, int], ...]
    listening: dict[int, Servo]
    byte_ns: int
    turn: int = 0
    so_far: bytes = b""  # of a fast answer


@dataclass(slots=True, eq=False)
class _Sending:
    """An answer on the wire, or about to be.

    ``head`` is how it would begin if nothing disturbed it, by which a successor knows it.
    ``first`` and ``last`` bound the bytes that reach the adapter over a contact that opens or
    closes meanwhile; ``lost`` are stretches that a collision garbled.
    """

    servo: Servo
    start_ns: int
    end_ns: int
    byte_ns: int
    data: bytes
    head: bytes
    group: _Group | None
    reachable: bool | None = None
    first: int = 0
    last: int = 1 << 30
    sparks: list[tuple[int, bytes]] = field(default_factory=list)
    lost: list[tuple[int, int]] = field(default_factory=list)
    cancelled: bool = False

    def index(self, at_ns: int) -> int:
        """Which byte is on the wire at this time."""
        return min(max((at_ns - self.start_ns) // self.byte_ns, 0), len(self.data))


class Wire:
    """A bus with its servos, cables, supply and adapter.

    Args:
        config: Servos in cable order, baud rate, where supply enters.
        seed: Of everything random: the same calls with the same seed give the same bytes.
        latency_ms: USB latency timer of the adapter.
        loss: Share of answers that a healthy bus loses or damages (TTL without any shielding).
        firmware: Firmware versions that differ from the newest, by servo id.
        tapped: Whether a second adapter sits beside the first and hears both directions.
        boards: Devices that are no servos, by id.
    """

    def __init__(
        self,
        config: BusConfig,
        seed: int | str = 0,
        *,
        latency_ms: int = 0,
        loss: float = 0.0,
        firmware: Mapping[int, int] | None = None,
        tapped: bool = False,
        boards: Mapping[int, Board] | None = None,
    ) -> None:
        self.ids = config.ids()
        self.now_ns = 0
        self._config = config
        self._seed = seed
        self._random = Random(f"{seed}/wire")
        self._latency_ms = latency_ms
        self._loss = loss
        self._firmware = firmware or {}
        self.servos = [self._new_servo(position, "servo") for position in range(len(self.ids))]
        self._twins: dict[int, Servo] = {}  # by the position of the one with the same id
        self.boards = dict(boards or {})
        self._nominal_volts = config.nominal_voltage or min(
            (servo.recommended_volts for servo in self.servos), default=12.0
        )
        self._chain = Chain(len(self.servos), config.power)
        self._adapter = Adapter(latency_ms)
        self._tap = Adapter(latency_ms) if tapped else None
        self._noise = BitErrors(Random(f"{seed}/noise"))
        self._jammer = JammerStream(Random(f"{seed}/jammer"))
        self._conditions = Conditions()
        self._mute: set[int | None] = set()  # positions that do not answer
        self._positions = {servo: position for position, servo in enumerate(self.servos)}
        self._power_lost_ns: dict[int, int] = {}
        self._power_checked_ns = 0

        self._events: list[tuple[int, int, Callable[[int, Any], None], Any]] = []
        self._count = 0  # orders events of the same time
        self._framer = Framer()
        self._hearing: list[Heard] = []
        self._air: list[_Sending] = []
        self._listening_baud = config.baud_rate
        self._host_start_ns = 0
        self._host_end_ns = 0
        self._idle_ns = 0  # the host's receiver has had nothing to read since
        self._supply_power(0)

    def _new_servo(self, position: int, role: str) -> Servo:
        config = self._config
        servo = config.servos[position]
        return Servo(
            servo,
            Random(f"{self._seed}/{role}/{position}"),
            baud_rate=config.baud_rate,
            return_delay_us=config.return_delay_us,
            firmware=self._firmware.get(servo.id),
        )

    # What the host does and gets.

    def transmit(self, at_ns: int, data: bytes, baud_rate: int) -> None:
        """The host sends.

        Args:
            at_ns: When the first byte leaves; later if the host is still sending.
            data: Any bytes.
            baud_rate: At which the host sends, and listens from now on.
        """
        self.advance(at_ns)
        if not self._conditions.plugged or not data:
            return
        byte_ns = _byte_ns(baud_rate)
        start = max(at_ns, self._host_end_ns)
        end = start + len(data) * byte_ns
        self._jam_until(start)
        self._idle_ns = end
        self._listening_baud = baud_rate
        self._host_start_ns, self._host_end_ns = start, end
        collided = self._collide(start, end)
        data = self._noise.apply(data)
        if self._tap is not None:
            self.schedule(end, self._tap.receive, data)
        for heard in self._framer.take(data, start, byte_ns, baud_rate):
            heard.collided = collided
            self._hearing.append(heard)
            self.schedule(heard.end_ns, self._hear, heard)

    def deliveries(self, until_ns: int) -> list[tuple[int, bytes]]:
        """What the host's operating system has received by then: (when, bytes), in order."""
        self.advance(until_ns)
        self._jam_until(until_ns)
        return self._adapter.take(until_ns)

    def overheard(self, until_ns: int) -> list[tuple[int, bytes]]:
        """As :meth:`deliveries`, of the adapter that only listens; nothing unless ``tapped``."""
        self.advance(until_ns)
        return [] if self._tap is None else self._tap.take(until_ns)

    def exchange(
        self, at_ns: int, instruction: bytes, wait_ns: int, baud_rate: int | None = None
    ) -> list[tuple[int, bytes]]:
        """Send, and return what came within ``wait_ns``; what came earlier is thrown away."""
        self.deliveries(at_ns)
        self.transmit(at_ns, instruction, baud_rate or self._listening_baud)
        return self.deliveries(at_ns + wait_ns)

    def next_ns(self) -> int | None:
        """When something will happen next; None if nothing will before the host sends."""
        times = [self._events[0][0]] if self._events else []
        for adapter in (self._adapter, self._tap):
            delivery = None if adapter is None else adapter.next_ns()
            if delivery is not None:
                times.append(delivery)
        if self._jamming():
            # The host reads a stream in full USB packets.
            times.append(self._idle_ns + 62 * _byte_ns(self._listening_baud))
        return min(times, default=None)

    @property
    def plugged(self) -> bool:
        """Whether the adapter is there."""
        return self._conditions.plugged

    def powered(self, servo: Servo) -> bool:
        """Whether supply reaches a servo now."""
        return self._chain.powered[self._positions[servo]]

    # The course of events.

    def schedule(self, at_ns: int, call: Callable[[int, Any], None], argument: object) -> None:
        """Have ``call(at_ns, argument)`` happen at this time."""
        self._count += 1
        heappush(self._events, (at_ns, self._count, call, argument))

    def advance(self, until_ns: int) -> None:
        """Let everything happen up to this time; time never goes back."""
        events = self._events
        while events and events[0][0] <= until_ns:
            at_ns, _, call, argument = heappop(events)
            self.now_ns = max(self.now_ns, at_ns)
            call(at_ns, argument)
        self.now_ns = max(self.now_ns, until_ns)

    def impose(self, at_ns: int, conditions: Conditions, spark: bytes | None = None) -> None:
        """Change the conditions of the bus.

        Args:
            at_ns: Now.
            conditions: All of them.
            spark: Bytes that a contact throws on the wire as it opens or closes; absent for any
                other change, where a cable or a switch gives zeros of its own.
        """
        before, self._conditions = self._conditions, conditions
        self._mute = {*conditions.silent, *conditions.rhythmic, *conditions.permanent}
        near, powered = self._chain.near, self._chain.powered
        self._chain.set(conditions.open_cables, supplied=conditions.powered)
        connected = conditions.open_cables != before.open_cables
        if connected or powered != self._chain.powered:
            self._cut(at_ns, near, powered)
            self._change_power(at_ns, powered)
        if spark is None and (connected or conditions.powered != before.powered):
            spark = zeros(self._random)
        if spark:
            self._throw(at_ns, spark)
        self._noise.set_rate(conditions.bit_error_rate)
        latency_ms = conditions.latency_ms
        self._adapter.latency_ms = self._latency_ms if latency_ms is None else latency_ms
        if not conditions.plugged:
            self._adapter.clear()
        if conditions.permanent and not before.permanent:
            self._idle_ns = max(self._idle_ns, at_ns)
        self._twins = {
            position: self._twins.get(position) or self._new_servo(position, "twin")
            for position in conditions.doubled
        }
        for position, servo in enumerate(self.servos):
            servo.stick(position in conditions.frozen, at_ns)
            wrong = conditions.return_delay.get(position)
            if wrong != before.return_delay.get(position):
                servo.misset_return_delay(wrong)
            servo.suffer(conditions.hardware_errors.get(position, 0), at_ns)
        self._supply_power(at_ns)

    # Host to servos.

    def _hear(self, at_ns: int, heard: Heard) -> None:
        self._hearing.remove(heard)
        packet, conditions = heard.packet, self._conditions
        jammers = self._jammers(conditions.rhythmic)
        if jammers or not self._chain.answering():
            glitch = b"\0" if jammers else zeros(self._random)
            self.schedule(at_ns + _byte_ns(heard.baud_rate), self._receive, glitch)
        if heard.collided or jammers > 1:
            return
        listening = self._listening(heard)
        for sending in self._air:
            if sending.start_ns >= at_ns and sending.servo in listening:
                sending.cancelled = True
        if packet is None:
            for servo in listening:
                if servo.id == heard.bad_crc_id and servo.status_return_level >= 2:
                    self._answer(servo, heard, CRC_ERROR, b"")
            return
        if at_ns - self._power_checked_ns >= POWER_CHECK_NS:
            self._supply_power(at_ns)
        for servo in listening:
            servo.note_instruction(at_ns)
        self._obey(heard, packet, listening)

    def _listening(self, heard: Heard) -> list[Servo]:
        """The servos that have heard the whole instruction."""
        chain, baud_rate, start = self._chain, heard.baud_rate, heard.start_ns
        return [
            servo
            for position, servo in enumerate(self.servos[: min(chain.near, heard.missed_from)])
            if servo.baud_rate == baud_rate
            and servo.deaf_until_ns <= start
            and chain.powered[position]
        ]

    def _obey(self, heard: Heard, packet: InstructionPacket, listening: list[Servo]) -> None:
        at_ns = heard.end_ns
        if packet.id in self.boards:
            self._ask_board(self.boards[packet.id], heard, packet)
        elif packet.id != BROADCAST_ID:
            for servo in listening:
                if servo.id == packet.id:
                    status = servo.execute(packet, at_ns)
                    if status is not None:
                        self._answer(servo, heard, *status)
            return
        if packet.instruction == Instruction.PING:
            for servo in listening:
                status = servo.execute(packet, at_ns)
                if status is not None:
                    slot = PING_SLOT_NS + PING_BYTES * _byte_ns(heard.baud_rate)
                    self._answer(servo, heard, *status, wait_ns=servo.id * slot)
        elif packet.instruction in groups.READS:
            self._begin_group(heard, packet, listening)
        elif packet.instruction in groups.WRITES:
            by_id = {servo.id: servo for servo in listening}
            for servo_id, address, data in groups.writes(packet):
                if servo_id in by_id:
                    by_id[servo_id].write(address, data, at_ns)
        else:
            for servo in listening:
                servo.execute(packet, at_ns)

    def _ask_board(self, board: Board, heard: Heard, packet: InstructionPacket) -> None:
        if not board.silent:
            status = StatusPacket(packet.id, *board.execute(packet)).encode()
            took_ns = PROCESSING_NS + len(status) * _byte_ns(heard.baud_rate)
            self.schedule(heard.end_ns + took_ns, self._receive, status)

    # Servos to host.

    def _answer(
        self, servo: Servo, heard: Heard, error: int, parameters: bytes, wait_ns: int = 0
    ) -> None:
        # A servo that was just given another id or baud rate still answers with the old one.
        broadcast = heard.packet is not None and heard.packet.id == BROADCAST_ID
        answering = heard.packet.id if heard.packet is not None and not broadcast else servo.id
        status = StatusPacket(answering, error, parameters).encode()
        answers = [status]
        twin = self._twins.get(self._positions[servo])
        if twin is not None and heard.packet is not None:
            answer = twin.execute(heard.packet, heard.end_ns)
            if answer is not None:
                answers.append(StatusPacket(answering, *answer).encode())
        start_ns = heard.end_ns + wait_ns + PROCESSING_NS + servo.return_delay_ns
        self._send(servo, start_ns, _byte_ns(heard.baud_rate), answers, None)

    def _begin_group(self, heard: Heard, packet: InstructionPacket, listening: list[Servo]) -> None:
        plan = groups.reads(packet)
        if plan is None:
            return
        expectation, reads = plan
        by_id = {servo.id: servo for servo in listening}
        group = _Group(expectation, reads, by_id, _byte_ns(heard.baud_rate))
        servo = by_id.get(expectation.ids[0])
        if servo is not None:
            start_ns = heard.end_ns + PROCESSING_NS + servo.return_delay_ns
            self._take_turn(servo, group, start_ns, heard.end_ns)

    def _take_turn(self, servo: Servo, group: _Group, start_ns: int, at_ns: int) -> None:
        """The servo whose turn it is sends its part of the answer."""
        if servo.status_return_level < 1:
            return
        if group.expectation.fast and not servo.knows_fast_read:
            return
        twin = self._twins.get(self._positions[servo])
        answers = [self._part(one, group, at_ns) for one in (servo, twin) if one is not None]
        if group.expectation.fast:
            group.so_far += answers[0]
        self._send(servo, start_ns, group.byte_ns, answers, group)

    def _part(self, servo: Servo, group: _Group, at_ns: int) -> bytes:
        """What a servo has to send when it is its turn."""
        expectation, turn = group.expectation, group.turn
        address, length = group.reads[turn]
        error, data = servo.read(address, length, at_ns)
        if not expectation.fast:
            return StatusPacket(servo.id, error, data).encode()
        block = b"" if turn else fast_prefix(expectation)
        # Blocks have a fixed place, so one that cannot be read is filled with zeros.
        block += bytes((error, servo.id)) + (data or bytes(length))
        return block + crc(group.so_far + block).to_bytes(2, "little")

    def _send(
        self,
        servo: Servo,
        start_ns: int,
        byte_ns: int,
        answers: Sequence[bytes],
        group: _Group | None,
    ) -> None:
        """A servo begins to answer; the second of ``answers`` is of another one with its id."""
        position, conditions = self._positions[servo], self._conditions
        if position in self._mute:
            return
        if conditions.extra_delay_ns:
            extra = conditions.extra_delay_ns.get(position, 0)
            # A slow servo is not slow to the microsecond.
            start_ns += round(extra * (0.8 + 0.4 * self._random.random()))
        start_ns += int((2.0 * self._random.random() - 1.0) * JITTER_NS)
        data = answers[0]
        head = data[:PREFIX_BYTES]
        if len(answers) > 1:
            apart_ns = 2.0 * (self._random.random() - self._random.random()) * JITTER_NS
            early, late = answers if apart_ns >= 0 else answers[::-1]
            data = superposed(early, late, abs(apart_ns) * BITS / byte_ns)
        end_ns = start_ns + len(data) * byte_ns
        sending = _Sending(servo, start_ns, end_ns, byte_ns, data, head, group)
        for other in self._air:
            if other.start_ns < end_ns and start_ns < other.end_ns and not other.cancelled:
                first, last = max(start_ns, other.start_ns), min(end_ns, other.end_ns)
                for one in (other, sending):
                    one.lost.append((one.index(first), one.index(last) + 1))
        for heard in self._hearing:
            if start_ns < heard.end_ns and heard.start_ns < end_ns:
                heard.collided = True
                sending.lost.append((sending.index(heard.start_ns), sending.index(heard.end_ns)))
        self._air.append(sending)
        self.schedule(end_ns, self._sent, sending)

    def _collide(self, start: int, end: int) -> bool:
        """The host drives the line while servos may be answering; whether one is."""
        collided = False
        for sending in self._air:
            if sending.start_ns < end and start < sending.end_ns and not sending.cancelled:
                collided = True
                sending.lost.append((sending.index(start), sending.index(end)))
        return collided

    def _sent(self, at_ns: int, sending: _Sending) -> None:
        self._air.remove(sending)
        if sending.cancelled:
            return
        position = self._positions[sending.servo]
        data = sending.data
        if sending.lost:
            damaged = bytearray(data)
            for first, last in sending.lost:
                damaged[first:last] = self._random.randbytes(len(damaged[first:last]))
            data = bytes(damaged)
        data = self._noise.apply(data)
        self._arrive(at_ns, position, sending, data)
        # A successor counts its predecessor's packet by its head: an assumption, since the manual
        # only says that it waits for it.
        if sending.group is None or not self._chain.powered[position]:
            return
        if data[:PREFIX_BYTES] == sending.head:
            self._pass_turn(at_ns, sending.group, position)

    def _pass_turn(self, at_ns: int, group: _Group, position: int) -> None:
        group.turn += 1
        if group.turn == len(group.expectation.ids):
            return
        servo = group.listening.get(group.expectation.ids[group.turn])
        if servo is None or servo.deaf_until_ns > at_ns:
            return
        place = self._positions[servo]
        if not self._chain.powered[place] or not self._chain.joined(position, place):
            return
        delay = TURN_NS if group.expectation.fast else TURN_NS + servo.return_delay_ns
        self._take_turn(servo, group, at_ns + delay, at_ns)

    def _arrive(self, at_ns: int, position: int, sending: _Sending, data: bytes) -> None:
        """An answer reaches the adapter, or what is left of it."""
        conditions = self._conditions
        reachable = sending.reachable
        if reachable is None:
            reachable = position < self._chain.near and self._chain.powered[position]
        if not reachable:
            return
        data = data[sending.first : sending.last]
        for index, spark in sending.sparks:
            data = data[:index] + spark + data[index + len(spark) :]
        if self._loss or conditions.loss:
            data = self._lose(position, data)
        if not data:
            return
        if conditions.permanent and self._jamming():
            self._jam_until(sending.start_ns)
            self._idle_ns = at_ns
            if self._random.random() < jammed_share(sending.start_ns - self._host_end_ns):
                hit = self._random.randrange(len(data))
                data = data[:hit] + self._jammer.take(len(data) - hit)
        if conditions.rhythmic and self._jammers(conditions.rhythmic):
            data += b"\0"
        self._receive(at_ns, data)

    def _lose(self, position: int, data: bytes) -> bytes:
        """Ordinary loss: half of the answers concerned vanish, half have one byte damaged."""
        shares = self._conditions.loss
        share = max(self._loss, shares.get(None, 0.0), shares.get(position, 0.0))
        if self._random.random() >= share:
            return data
        if not data or self._random.random() < 0.5:
            return b""
        damaged = bytearray(data)
        damaged[self._random.randrange(len(data))] ^= self._random.randint(1, 255)
        return bytes(damaged)

    def _receive(self, at_ns: int, data: bytes) -> None:
        if self._conditions.plugged:
            self._adapter.receive(at_ns, data)
        if self._tap is not None:
            self._tap.receive(at_ns, data)

    # Faults of the line.

    def _jammers(self, places: list[int | None]) -> int:
        """How many of the jammers are connected and have power."""
        chain = self._chain
        return sum(
            place is None or (place < chain.near and chain.powered[place]) for place in places
        )

    def _jamming(self) -> bool:
        """Whether a permanent jammer writes: one is there, and no rhythmic one masks it."""
        conditions = self._conditions
        return (
            bool(conditions.permanent)
            and conditions.plugged
            and not self._jammers(conditions.rhythmic)
            and self._jammers(conditions.permanent) > 0
        )

    def _jam_until(self, until_ns: int) -> None:
        """Fill the host's silence with the permanent jammer's bytes."""
        if not self._conditions.permanent or not self._jamming():
            return
        byte_ns = _byte_ns(self._listening_baud)
        count = (until_ns - self._idle_ns) // byte_ns
        if count <= 0:
            return
        start = self._idle_ns
        self._idle_ns += count * byte_ns
        kept = min(count, TTY_BYTES)
        self._receive(start + kept * byte_ns, self._jammer.take(kept))

    def _throw(self, at_ns: int, spark: bytes) -> None:
        """Stray bytes appear: in the answer on the wire, or on the idle bus."""
        for sending in self._air:
            if sending.start_ns <= at_ns < sending.end_ns:
                index = sending.index(at_ns)
                near = self._positions[sending.servo] < self._chain.near
                # A driver that is still connected usually overrides the discharge.
                if not near or self._random.random() < 0.15:
                    sending.sparks.append((index - sending.first, spark))
                return
        if self._host_start_ns <= at_ns < self._host_end_ns:
            return  # the adapter does not listen while it sends
        self._receive(at_ns, spark)

    def _cut(self, at_ns: int, near: int, powered: list[bool]) -> None:
        """Connections have changed: answers on the wire lose their end or their beginning."""
        chain = self._chain
        for sending in self._air:
            if not sending.start_ns <= at_ns < sending.end_ns:
                continue
            position = self._positions[sending.servo]
            was = position < near and powered[position]
            now = position < chain.near and chain.powered[position]
            if was and not now:
                sending.last = min(sending.last, sending.index(at_ns))
                sending.reachable = True
            elif now and not was:
                sending.first = sending.index(at_ns)
                sending.reachable = True
        for heard in self._hearing:
            if heard.start_ns <= at_ns and near != chain.near:
                heard.missed_from = min(heard.missed_from, near, chain.near)

    # Power.

    def _change_power(self, at_ns: int, powered: list[bool]) -> None:
        for position, servo in enumerate(self.servos):
            if powered[position] and not self._chain.powered[position]:
                self._power_lost_ns[position] = at_ns
            elif self._chain.powered[position] and not powered[position]:
                servo.power_returns(at_ns, at_ns - self._power_lost_ns.pop(position, at_ns))

    def _supply_power(self, at_ns: int) -> None:
        """Tell the servos their input voltage."""
        self._power_checked_ns = at_ns
        conditions = self._conditions
        chain, supply = self._chain, conditions.supply_volts
        currents = [
            servo.drawn_amperes(at_ns) if powered else 0.0
            for servo, powered in zip(self.servos, chain.powered, strict=True)
        ]
        ohm = conditions.extra_ohm | dict.fromkeys(conditions.open_cables, OPEN_OHM)
        volts = voltages(
            self._nominal_volts if supply is None else supply, chain.feed, currents, ohm
        )
        for position, servo in enumerate(self.servos):
            if chain.powered[position]:
                # Servos that starve go on working here; less than nothing no supply gives.
                felt = max(0.0, volts[position])
                servo.feel_voltage(conditions.servo_volts.get(position, felt), at_ns)


@lru_cache(maxsize=64)
def _byte_ns(baud_rate: int) -> int:
    """Start bit, eight data bits, stop bit."""
    return round(10e9 / baud_rate)
