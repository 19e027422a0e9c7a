"""Messages for people and for scripts: one line of text, or one line of JSON."""

from datetime import datetime
from typing import Any

import msgspec

from wackel_protocols.dynamixel2 import Instruction
from wackel_schemas import wire
from wackel_schemas.bus import BusCommand, BusState, BusStatistics, ServoState, Transaction
from wackel_schemas.drive import Exclusions, ImuSample, Odometry, PoseSet, TwistCommand
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Health, Heartbeat
from wackel_schemas.inputs import Inputs
from wackel_schemas.keys import topic_of
from wackel_schemas.message import Message
from wackel_schemas.residuals import Residuals

_SHOWN_BYTES = 32  # of what is not understood: enough to recognise it
_UNITS = {"position": "rad", "velocity": "rad/s", "current": "A", "voltage": "V"}


def as_text(key: str, payload: bytes) -> str:
    """One message as a line for people; never longer than its content, never control characters.

    Args:
        key: Below the robot's name.
        payload: As it came.
    """
    topic = topic_of(key)
    if topic is None:
        return f"{len(payload)} bytes  {_shown(payload)}"
    try:
        message = wire.decode(payload, topic.message)
    except wire.Rejected as error:
        return printable(f"{error}  {_shown(payload)}")
    return printable(_describe(message))


def as_json(key: str, payload: bytes) -> str:
    """One message as a line of JSON: ``{"key": …, "message": …}``; bytes are base64.

    What is not understood has ``error`` and ``payload`` in place of ``message``.
    """
    topic = topic_of(key)
    line: dict[str, Any] = {"key": key}
    try:
        if topic is None:
            raise wire.Rejected("not a topic of wackel")
        line["message"] = wire.decode(payload, topic.message)
    except wire.Rejected as error:
        line |= {"error": str(error), "payload": payload}
    return msgspec.json.encode(line).decode()


def printable(text: str) -> str:
    """Text from the network without what would steer a terminal."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def clock_time(stamp_ns: int) -> str:
    """UTC ns as local time with milliseconds; as a number where no calendar reaches."""
    try:
        return datetime.fromtimestamp(stamp_ns / 1e9).strftime("%H:%M:%S.%f")[:-3]
    except (ValueError, OverflowError, OSError):
        return str(stamp_ns)


def _describe(message: Message) -> str:
    match message:
        case Transaction():
            return _transaction(message)
        case BusState():
            return "  ".join(_servo(servo) for servo in message.servos) or "no servo answered"
        case BusStatistics():
            # Cycles are the gateway's own; where another is the master there are none.
            rate = f"{message.cycle_rate:.1f} Hz  " if message.mode == "poll" else ""
            return (
                f"{message.mode} {message.port} {'' if message.connected else 'NOT CONNECTED '}"
                f"{rate}load {message.bus_load:.0%}  "
                f"{message.transactions} transactions, {message.incomplete} incomplete  "
                f"{message.stray_bytes + message.zero_bytes + message.bad_bytes} bytes outside "
                "valid packets"
            )
        case BusCommand():
            holds = "" if message.timeout_s is None else f" for {message.timeout_s:g} s"
            return f"goals for {', '.join(str(goal.id) for goal in message.goals)}{holds}"
        case ImuSample():
            x, y, z = message.angular_velocity
            return f"turns {x:+.4f} {y:+.4f} {z:+.4f} rad/s"
        case TwistCommand():
            return _twist(message)
        case Odometry():
            doubt = "" if message.valid else f"  NOT VALID: {message.reason}"
            return (
                f"at {message.x:+.3f} {message.y:+.3f} m, {message.theta:+.4f} rad  "
                f"{_twist(message)}{doubt}"
            )
        case PoseSet():
            pose = message.request
            return f"set to {pose.x:+.3f} {pose.y:+.3f} m, {pose.theta:+.4f} rad"
        case Inputs():
            keys = sorted({stream.key for stream in message.streams})
            return f"took in {len(message.order)} messages of {', '.join(keys)}"
        case Exclusions():
            return "; ".join(f"{e.component} ({e.reason})" for e in message.excluded) or "none"
        case Residuals():
            likely = message.hypotheses[0] if message.hypotheses else None
            what = ", ".join(likely.components) or "nothing" if likely is not None else "nothing"
            sure = f" ({likely.probability:.0%})" if likely is not None else ""
            return (
                f"signature {message.signature or 'none'}  alarm {message.alarm:.0%}  "
                f"likeliest: {what}{sure}  verdict: {', '.join(message.verdict) or 'sound'}"
            )
        case FaultReport():
            again = " (repeated)" if message.repeated else ""
            return (
                f"{message.status} {message.code} {message.component} "
                f"({message.confidence:.0%}){again}: {message.message}"
            )
        case Health():
            return f"{message.level}: {message.summary}"
        case Heartbeat():
            lost = f"  {message.lost} lost" if message.lost else ""
            return f"{message.state}  {message.received} received{lost}  {message.reason}".rstrip()
    return repr(message)


def _twist(message: TwistCommand | Odometry) -> str:
    return f"vx {message.vx:+.3f} vy {message.vy:+.3f} m/s  omega {message.omega:+.4f} rad/s"


def _transaction(message: Transaction) -> str:
    code = message.instruction[7] if len(message.instruction) > 7 else None
    try:
        name = (
            "no instruction" if code is None else Instruction(code).name.lower().replace("_", " ")
        )
    except ValueError:
        name = f"instruction 0x{code:02x}"
    received = sum(len(chunk.data) for chunk in message.chunks)
    answered = f"{len(message.response_times)} of {len(message.expected)} answered"
    return (
        f"{message.purpose} {name}  {len(message.instruction)} B out, {received} B in  {answered}  "
        f"{message.ended_ns / 1e6:.2f} ms"
    )


def _servo(servo: ServoState) -> str:
    parts = [f"{servo.id}:"]
    for name, unit in _UNITS.items():
        value = getattr(servo, name)
        if value is not None:
            parts.append(f"{value:+.3f} {unit}" if unit != "V" else f"{value:.1f} V")
    if servo.temperature is not None:
        parts.append(f"{servo.temperature:.0f} °C")
    if servo.alert:
        parts.append("ALERT")
    if servo.error:
        parts.append(f"error {servo.error}")
    return " ".join(parts)


def _shown(payload: bytes) -> str:
    return payload[:_SHOWN_BYTES].hex(" ") + (" …" if len(payload) > _SHOWN_BYTES else "")
