"""Finding out who is on a bus: pings at one baud rate after the other, then what each servo tells.

Only asks; no servo is changed.
"""

from collections.abc import Callable, Sequence

import msgspec

from wackel_gateway.exchange import Exchange
from wackel_gateway.patience import Patience
from wackel_gateway.port import Port
from wackel_gateway.roster import Block
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import Status
from wackel_protocols.dynamixel2.control_table import Model, UnknownModel, model
from wackel_protocols.dynamixel2.errors import hardware_errors
from wackel_protocols.dynamixel2.packet import BROADCAST_ID

ALL_IDS = range(packet.MAX_ID + 1)
_PING_BYTES = 3
_TRIES = 2  # one answer in a thousand is lost on a healthy bus


class Found(msgspec.Struct, kw_only=True):
    """A servo that answered.

    Attributes:
        id: On the bus.
        baud_rate: At which it answered, bit/s.
        model_number: As it says.
        model: Name; absent if the number is in no table.
        firmware: As it says.
        voltage: V.
        temperature: °C.
        return_delay_us: Return Delay Time, µs.
        hardware_errors: In words; empty if there are none.
    """

    id: int
    baud_rate: int
    model_number: int
    model: str | None
    firmware: int
    voltage: float | None = None
    temperature: float | None = None
    return_delay_us: float | None = None
    hardware_errors: list[str] = []


class Survey:
    """Asks on one port.

    Args:
        port: Open port; its baud rate is changed.
        interrupted: Whether to stop.
        advance: Called with the share of the whole that a step was, 0 … 1.
    """

    def __init__(
        self, port: Port, interrupted: Callable[[], bool], advance: Callable[[float], object]
    ) -> None:
        self._port = port
        self._interrupted = interrupted
        self._advance = advance

    def run(self, baud_rates: Sequence[int], ids: Sequence[int]) -> list[Found]:
        """All servos that answer, by baud rate and id.

        Args:
            baud_rates: Which to try, bit/s.
            ids: Which to ping one by one; none of them: ping all at once.

        Raises:
            PortLost: The port went away, or knows no such rate.
        """
        found: list[Found] = []
        for baud_rate in baud_rates:
            self._port.baud_rate = baud_rate
            self._port.discard()
            patience = Patience(baud_rate, self._port.latency_timer_ms)
            exchange = Exchange(self._port, patience, self._interrupted)
            share = 1 / len(baud_rates)
            statuses = self._each(exchange, ids, share) if ids else _all(exchange)
            for status in statuses:
                if self._interrupted():
                    return found
                found.append(_ask(exchange, status, baud_rate))
            if not ids:
                self._advance(share)
        return found

    def _each(self, exchange: Exchange, ids: Sequence[int], share: float) -> list[Status]:
        statuses: list[Status] = []
        silent: list[int] = []
        for servo_id in ids:
            if self._interrupted():
                return statuses
            answers = _answers(exchange, packet.ping(servo_id))
            statuses += answers
            if not answers:
                silent.append(servo_id)
            self._advance(share / len(ids))
        # Where somebody is, the silent are asked again: an answer may have been lost.
        for servo_id in silent if statuses else ():
            if self._interrupted():
                return statuses
            statuses += _answers(exchange, packet.ping(servo_id))
        return sorted(statuses, key=lambda status: status.id)


def _all(exchange: Exchange) -> list[Status]:
    return _answers(exchange, packet.ping(BROADCAST_ID))


def _answers(exchange: Exchange, instruction: bytes) -> list[Status]:
    exchange.drain()
    exchange.send("request", instruction)
    return [
        status
        for status in exchange.gather().answers.statuses
        if len(status.parameters) == _PING_BYTES
    ]


def _ask(exchange: Exchange, ping: Status, baud_rate: int) -> Found:
    number = int.from_bytes(ping.parameters[:2], "little")
    found = Found(
        id=ping.id,
        baud_rate=baud_rate,
        model_number=number,
        model=None,
        firmware=ping.parameters[2],
    )
    try:
        table = model(number)
    except UnknownModel:
        return found
    found.model = table.name
    found.voltage = _read(exchange, found.id, table, "present_input_voltage")
    found.temperature = _read(exchange, found.id, table, "present_temperature")
    delay_s = _read(exchange, found.id, table, "return_delay_time")
    found.return_delay_us = None if delay_s is None else round(delay_s * 1e6)
    status = _read(exchange, found.id, table, "hardware_error_status")
    found.hardware_errors = list(hardware_errors(int(status), table.series)) if status else []
    return found


def _read(exchange: Exchange, servo_id: int, table: Model, name: str) -> float | None:
    """A register in SI units; absent if the servo does not tell it."""
    block = Block.of(table, name)
    if block is None:
        return None
    register = table.registers[name]
    for _ in range(_TRIES):
        exchange.drain()
        exchange.send("request", packet.read(servo_id, block.address, block.length))
        for status in exchange.gather().answers.statuses:
            if len(status.parameters) == block.length:
                # Without the digits that come from the scale alone: 11.6, not 11.600000000000001.
                return round(register.to_si(register.decode(status.parameters)), 9)
    return None
