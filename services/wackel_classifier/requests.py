"""What an instruction asks for, worked out once and kept: servos, answers, registers.

A bus repeats few instructions many times, so nothing of this is done again for each transaction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import itemgetter
from typing import NamedTuple

from wackel_classifier.chain import Chain
from wackel_node.config import ServoConfig
from wackel_protocols.dynamixel2.answers import AnswerReader
from wackel_protocols.dynamixel2.control_table import Model, Register, configured
from wackel_protocols.dynamixel2.expectation import FAST_PREFIX_BYTES, Expectation, expect
from wackel_protocols.dynamixel2.packet import (
    ALERT,
    PREFIX_BYTES,
    Instruction,
    InstructionPacket,
    PacketError,
    decode,
)

WATCHED = (
    "return_delay_time",
    "hardware_error_status",
    "present_input_voltage",
    "torque_enable",
)
MOTION = ("present_load", "present_current", "present_velocity", "present_position")
MOTION_SLOTS = 2
"""Ten times a second is enough to see whether a joint moves."""
MOST_REQUESTS = 256
"""Instructions remembered. Gateways and control software use tens; hostile ones are endless."""

_READS = frozenset(
    (
        Instruction.PING,
        Instruction.READ,
        Instruction.SYNC_READ,
        Instruction.FAST_SYNC_READ,
        Instruction.BULK_READ,
        Instruction.FAST_BULK_READ,
    )
)


class Field(NamedTuple):
    """A watched register within an answer's parameters."""

    register: Register
    start: int
    end: int


@dataclass(slots=True)
class Asked:
    """One servo of a request.

    Attributes:
        position: In the chain; None for an id that is not configured.
        fields: Watched registers in its answer.
        motion: Where measured values lie in its answer: start and end; None if there are none.
        velocity: The measured velocity among them.
    """

    position: int | None
    fields: tuple[Field, ...] = ()
    motion: tuple[int, int] | None = None
    velocity: Field | None = None

    def velocity_of(self, parameters: bytes) -> float | None:
        """The measured velocity in an answer, rad/s."""
        field = self.velocity
        if field is None:
            return None
        register = field.register
        return register.to_si(register.decode(parameters[field.start : field.end]))


class Request:
    """One kind of instruction.

    Attributes:
        reader: Reads its answers.
        expected: Ids that answer, as transactions list them.
        asked: By id.
        places: Position in the chain of each expected servo, in request order; None for an id
            that is not configured.
        positions: Those that are not None.
        concerns: A bit for each of these positions, and the one above them all for the bus.
        single: Position of the servo, if only one is asked.
        many: Whether several are.
        has_fields, has_motion: Whether any answer holds watched registers, or measured values.
        clean: How often it was answered as it should be since this was last set to 0.
        clean_ns: When it was last.
        slot: In which slot its measured values were last looked at.
    """

    def __init__(self, expectation: Expectation, asked: dict[int, Asked], chain: Chain) -> None:
        self.reader = AnswerReader(expectation)
        self.expectation = expectation
        self.expected = list(expectation.ids)
        self.asked = asked
        self.places = [servo.position for servo in asked.values()]
        self.positions = [position for position in self.places if position is not None]
        self.concerns = sum(1 << position for position in (*self.positions, len(chain)))
        lone = self.positions[0] if self.positions and len(self.expected) == 1 else None
        self.single: int | None = lone
        self.many = len(self.expected) > 1
        self.has_fields = any(servo.fields for servo in asked.values())
        self.has_motion = any(servo.motion for servo in asked.values())
        self.clean = 0
        self.clean_ns = 0
        self.slot = -MOTION_SLOTS
        lengths = expectation.lengths
        self._total = expectation.total_bytes
        starts = accumulate(
            lengths[:-1], initial=FAST_PREFIX_BYTES if expectation.fast else PREFIX_BYTES + 1
        )
        # Twice the first, so that there always is a tuple.
        errors = list(starts) if lengths else [0]
        self._errors = itemgetter(errors[0], *errors)
        self._known_errors = (0,) * (1 + len(errors))
        self._known_alerting = 0

    def has_contents(self, slot: int) -> bool:
        """Whether its answers tell more than that they came; measured values do now and then."""
        return self.single is not None or self.has_fields or self.is_motion_due(slot)

    def is_motion_due(self, slot: int) -> bool:
        """Whether its measured values shall be looked at in this slot."""
        return self.has_motion and slot - self.slot >= MOTION_SLOTS

    def has_new_errors(self, data: bytes, alerting: int) -> bool:
        """Whether the error bytes of an answer that is clean say anything new.

        Args:
            data: The answer.
            alerting: Servos of which it is known that they raise an alert, a bit for each position.
        """
        if not data:
            return False
        # Stuffing moves the bytes, so a longer answer is looked at closely.
        return (
            len(data) != self._total
            or self._errors(data) != self._known_errors
            or self._known_alerting != alerting & self.concerns
        )

    def learn_errors(self, data: bytes) -> None:
        """The error bytes of an answer that is clean are known now; refusals are news each time."""
        if len(data) == self._total:
            errors = self._errors(data)
            if all(error in (0, ALERT) for error in errors):
                self._known_errors = errors
                self._known_alerting = sum(
                    1 << place
                    for place, error in zip(self.places, errors[1:], strict=False)
                    if error and place is not None
                )


class Requests:
    """The requests seen on one bus."""

    def __init__(self, chain: Chain, servos: Sequence[ServoConfig]) -> None:
        self._chain = chain
        self.models = [configured(servo.model) for servo in servos]
        self._known: dict[bytes, Request] = {}

    @property
    def full(self) -> bool:
        """Whether the next new one needs :meth:`forget` first."""
        return len(self._known) >= MOST_REQUESTS

    def forget(self) -> None:
        """Begins anew."""
        self._known.clear()

    def find(self, instruction: bytes, expected: list[int]) -> Request | None:
        """A remembered request; None if it is new."""
        request = self._known.get(instruction) or self._known.get(_short(instruction))
        return request if request is not None and request.expected == expected else None

    def make(self, instruction: bytes, expected: list[int]) -> Request:
        """A request from its bytes; what the transaction expects rules where both differ.

        (Servos whose Status Return Level is low do not answer everything; a gateway knows.)
        """
        expectation = expect(instruction)
        broadcast = expectation.broadcast_ping
        if list(expectation.ids) != expected and not broadcast:
            expectation = Expectation()
        key = instruction if _is_read(instruction) else _short(instruction)
        if broadcast and expected:
            ids = tuple(servo_id for servo_id in expected if servo_id in self._chain.position)
            expectation = Expectation(ids, (14,) * len(ids), broadcast_ping=True)
        request = Request(expectation, self._asked(instruction, expectation), self._chain)
        request.expected = list(expected)
        self._known[key] = request
        return request

    def _asked(self, instruction: bytes, expectation: Expectation) -> dict[int, Asked]:
        ranges = _ranges(instruction, expectation.ids)
        asked = {}
        for servo_id in expectation.ids:
            position = self._chain.position.get(servo_id)
            servo = self.models[position] if position is not None else None
            if servo is None or servo_id not in ranges:
                asked[servo_id] = Asked(position)
                continue
            address, length = ranges[servo_id]
            fields = (_within(servo, name, address, length) for name in WATCHED)
            spans = [span for name in MOTION if (span := _within(servo, name, address, length))]
            motion = (min(s.start for s in spans), max(s.end for s in spans)) if spans else None
            velocity = _within(servo, "present_velocity", address, length)
            asked[servo_id] = Asked(position, tuple(f for f in fields if f), motion, velocity)
        return asked


def _is_read(instruction: bytes) -> bool:
    return len(instruction) > PREFIX_BYTES and instruction[PREFIX_BYTES] in _READS


def _short(instruction: bytes) -> bytes:
    """Id and instruction: writes differ in their data each time, not in how they are answered."""
    return instruction[4:5] + instruction[PREFIX_BYTES : PREFIX_BYTES + 1]


def _within(servo: Model, name: str, address: int, length: int) -> Field | None:
    register = servo.registers.get(name)
    if register is None:
        return None
    start = register.address - address
    end = start + register.length
    return Field(register, start, end) if start >= 0 and end <= length else None


def _ranges(instruction: bytes, ids: Sequence[int]) -> dict[int, tuple[int, int]]:
    """Address and length that a read asks of each servo."""
    try:
        packet = decode(instruction)
    except PacketError:
        return {}
    if not isinstance(packet, InstructionPacket):
        return {}
    parameters = packet.parameters
    match packet.instruction:
        case Instruction.READ | Instruction.SYNC_READ | Instruction.FAST_SYNC_READ:
            span = _word(parameters, 0), _word(parameters, 2)
            return dict.fromkeys(ids, span)
        case Instruction.BULK_READ | Instruction.FAST_BULK_READ:
            return {
                parameters[i]: (_word(parameters, i + 1), _word(parameters, i + 3))
                for i in range(0, len(parameters) - 4, 5)
            }
        case _:
            return {}


def _word(data: bytes, start: int) -> int:
    return int.from_bytes(data[start : start + 2], "little")
