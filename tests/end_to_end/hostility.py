"""What strangers may publish: garbage, wrong types, and messages that are well-formed nonsense."""

import math
import random
from collections.abc import Iterator
from typing import Any

import msgpack

from wackel_schemas.keys import MOST_BYTES, QUERIES, TOPICS, Query, Topic
from wackel_schemas.message import Message, Record

STRANGER = 666
"""The boot of everything well-formed here, to tell it from what services say."""
NO_NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308)
HOUR_NS = 3_600_000_000_000

_random = random.Random("hostility")
_GARBAGE = (
    b"",
    b"\xc1" * 100,
    b"\x91" * 10_000,  # lists in lists
    b"\xdf\xff\xff\xff\xff",  # a map of four billion entries
    b"\xc6\xff\xff\xff\xff",
    _random.randbytes(300),
    _random.randbytes(50_000),
    bytes(MOST_BYTES + 1),
)


def garbage() -> Iterator[bytes]:
    """For any key: no messages at all."""
    yield from _GARBAGE
    for value in (None, [], {}, "text", 1, {"stamp": "now"}, {"stamp": 2**64 - 1}, {1: 2}):
        yield msgpack.packb(value)


def nonsense(pattern: str, now_ns: int) -> Iterator[dict[str, Any]]:
    """Well-formed messages of a topic that cannot be, each as a map.

    Args:
        pattern: Of the topic.
        now_ns: UTC.
    """
    for stamp in (now_ns, now_ns - HOUR_NS, now_ns + HOUR_NS, 0, -(2**63), 2**63 - 1):
        for body in _BODIES[pattern]():
            yield {"stamp": stamp, "boot": STRANGER, "seq": 2**40, **body}


def back_in_time(pattern: str, now_ns: int) -> Iterator[dict[str, Any]]:
    """Messages that would be all right if time did not run backwards."""
    for step in range(20):
        for body in _SOUND[pattern]():
            yield {"stamp": now_ns - step * 50_000_000, "boot": STRANGER, "seq": step, **body}


def requests(pattern: str) -> Iterator[dict[str, Any]]:
    """Well-formed requests that cannot be obeyed."""
    yield from _REQUESTS[pattern]


def keys_of(topic: Topic[Message] | Query[Record, Message]) -> list[str]:
    """Where services listen, and where nobody does."""
    chunks = {"bus": "main", "name": "body", "source": "stranger", "service": "x", "instance": "y"}
    other = dict.fromkeys(chunks, "nowhere")
    return list(dict.fromkeys((topic.key(**chunks), topic.key(**other))))


def _transactions() -> Iterator[dict[str, Any]]:
    sound = next(_sound_transactions())
    for number in (-1, -(2**63), 2**63 - 1):
        yield sound | dict.fromkeys(("sent_ns", "deadline_ns", "ended_ns"), number)
        yield sound | {"chunks": [{"at_ns": number, "data": bytes(100)}] * 50}
    yield sound | {"baud_rate": 0}
    yield sound | {"baud_rate": -1, "expected_bytes": -5}
    yield sound | {"expected": list(range(-5, 300)) * 3}
    yield sound | {"expected": [2**63 - 1, -(2**63)]}
    yield sound | {"instruction": _random.randbytes(2000)}
    yield sound | {"chunks": [{"at_ns": 1, "data": _random.randbytes(20_000)}]}
    yield sound | {"response_times": [{"id": 1, "ns": -(2**63)}] * 100, "host_lag_ns": 2**63 - 1}
    yield sound | {"late_ns": 2**63 - 1}


def _states() -> Iterator[dict[str, Any]]:
    fields = ("position", "velocity", "current", "voltage", "temperature", "load", "pwm")
    for value in NO_NUMBERS:
        yield {"servos": [{"id": i} | dict.fromkeys(fields, value) for i in (1, 2, 3, 4)]}
    yield {"servos": []}
    yield {"servos": [{"id": 1, "position": 0.5}] * 1000}
    yield {"servos": [{"id": i, "position": 1.0} for i in (-1, 9999, 2**63 - 1)]}
    yield {"servos": [{"id": 1, "velocity": 1e3}, {"id": 2, "velocity": -1e3}]}


def _statistics() -> Iterator[dict[str, Any]]:
    for value in NO_NUMBERS:
        yield {
            "mode": "poll",
            "port": "\x1b[2J" * 100,
            "connected": False,
            "baud_rate": -1,
            "cycle_rate": value,
            "bus_load": value,
        }


def _commands() -> Iterator[dict[str, Any]]:
    for value in NO_NUMBERS:
        yield {"goals": [{"id": 1, "velocity": value, "position": value}]}
    yield {"goals": []}
    yield {"goals": [{"id": 1}]}
    yield {"goals": [{"id": 77, "velocity": 1.0}]}
    yield {"goals": [{"id": 1, "velocity": 1.0}] * 1000}


def _samples() -> Iterator[dict[str, Any]]:
    for value in NO_NUMBERS:
        yield {"angular_velocity": [value, value, value], "temperature": value}
    yield {"angular_velocity": [0.0, 0.0]}
    yield {"angular_velocity": [0.0, 0.0, 1e3], "linear_acceleration": [math.nan] * 3}


def _twists() -> Iterator[dict[str, Any]]:
    for value in NO_NUMBERS:
        yield {"vx": value, "vy": value, "omega": value}


def _odometry() -> Iterator[dict[str, Any]]:
    for value in NO_NUMBERS:
        yield dict.fromkeys(("x", "y", "theta", "vx", "vy", "omega"), value) | {
            "pose_covariance": [value] * 5,
            "twist_covariance": [],
            "valid": True,
            "reason": "\x1b[2J" * 1000,
        }


def _poses_set() -> Iterator[dict[str, Any]]:
    for value in NO_NUMBERS:
        yield {"request": {"operation": "set_pose", "x": value, "theta": value}}
    yield {"request": {"operation": "x" * 10_000}}
    yield {"request": 3}


def _exclusions() -> Iterator[dict[str, Any]]:
    one = {"component": "wheel/left/drive", "fault": "sensor", "reason": "x" * 10}
    yield {"excluded": [one] * 2000}
    yield {"excluded": [one | {"reason": "x" * 100_000}]}
    yield {"excluded": [one | {"component": "wheel/none/drive"}, one | {"fault": "unheard of"}]}
    yield {"excluded": []}


def _residuals() -> Iterator[dict[str, Any]]:
    for value in NO_NUMBERS:
        candidate = {"name": "(1,2;1)", "vx": value, "vy": value, "omega": value}
        yield {"commanded": [value, value], "candidates": [candidate] * 100, "alarm": value}


def _faults() -> Iterator[dict[str, Any]]:
    sound = next(_sound_faults())
    for value in NO_NUMBERS:
        yield sound | {"confidence": value}
        yield sound | {"evidence": {"summary": "", "values": {"rate": value}}}
    yield sound | {"message": "x" * 100_000, "suspects": ["y" * 1000] * 100}
    yield sound | {"evidence": {"summary": "z" * 100_000}}
    yield sound | {"status": "neither"}


def _healths() -> Iterator[dict[str, Any]]:
    yield {"level": "splendid", "summary": ""}


def _beats() -> Iterator[dict[str, Any]]:
    for value in (*NO_NUMBERS, 0.0, -1.0):
        yield {"state": "ready", "period_s": value, "pid": -1}
    yield {"state": "crashed", "period_s": 0.5, "pid": 1, "reason": "why" * 10_000}


def _sound_transactions() -> Iterator[dict[str, Any]]:
    yield {
        "purpose": "cycle",
        "instruction": b"",
        "sent_ns": 1000,
        "chunks": [],
        "expected": [1, 2],
        "expected_bytes": 30,
        "deadline_ns": 10_000,
        "ended_ns": 10_000,
        "baud_rate": 1_000_000,
    }


def _sound_states() -> Iterator[dict[str, Any]]:
    yield {"servos": [{"id": i, "position": 0.1, "velocity": 0.0} for i in (1, 2)]}


def _sound_samples() -> Iterator[dict[str, Any]]:
    yield {"angular_velocity": [0.0, 0.0, 0.1]}


def _sound_twists() -> Iterator[dict[str, Any]]:
    yield {"vx": 0.1, "vy": 0.0, "omega": 0.0}


def _sound_faults() -> Iterator[dict[str, Any]]:
    yield {
        "code": "noise",
        "component": "bus/main",
        "status": "active",
        "confidence": 0.5,
        "message": "It hums.",
        "remedy": "Sing along.",
        "evidence": {"summary": "heard"},
        "since": 1,
    }


def _inputs() -> Iterator[dict[str, Any]]:
    stream = {"key": "bus/main/state", "boot": STRANGER, "seq": 2**63 - 1}
    yield {"streams": [], "order": [0, -1, 2**63 - 1]}
    yield {"streams": [stream] * 1000, "order": [*range(1000)] * 20}
    yield {"streams": [stream | {"key": "\x1b[2J" * 100, "seq": -1}], "order": [0]}


_BODIES = {
    "bus/{bus}/transaction": _transactions,
    "bus/{bus}/state": _states,
    "bus/{bus}/statistics": _statistics,
    "bus/{bus}/command": _commands,
    "imu/{name}": _samples,
    "command/twist": _twists,
    "odometry": _odometry,
    "odometry/pose_set": _poses_set,
    "exclusions": _exclusions,
    "residuals": _residuals,
    "fault/{source}": _faults,
    "health": _healths,
    "alive/{service}/{instance}": _beats,
    "inputs/{service}/{instance}": _inputs,
}
_SOUND = {
    "bus/{bus}/transaction": _sound_transactions,
    "bus/{bus}/state": _sound_states,
    "imu/{name}": _sound_samples,
    "command/twist": _sound_twists,
}
_REQUESTS: dict[str, list[dict[str, Any]]] = {
    "bus/{bus}/request": [
        {"operation": "read", "id": -1, "address": 2**40, "length": -3},
        {"operation": "read", "id": 1, "address": 0, "length": 2**31},
        {"operation": "write", "id": 1, "register": "x" * 10_000, "value": 2**63 - 1},
        {"operation": "raw", "id": 1, "instruction": 999, "parameters": bytes(100_000)},
        {"operation": "raw", "id": 300, "instruction": 2, "answers": list(range(-5, 400))},
    ],
    "odometry/request": [
        {"operation": "set_pose", "x": value, "y": value, "heading_sigma": value}
        for value in NO_NUMBERS
    ],
    "health/request": [{"operation": "clear", "code": "x" * 10_000}, {"operation": "hum"}],
    "virtual/request": [
        {"operation": "inject"},
        {"operation": "inject", "injection": {"kind": "x" * 10_000}},
        {"operation": "inject", "injection": {"kind": "noise", "value": math.nan}},
        {"operation": "inject", "injection": {"kind": "noise", "value": 1e-6, "start_s": math.inf}},
    ],
}


def uncovered() -> set[str]:
    """Topics and queries of which nothing stands here."""
    patterns = {topic.pattern for topic in TOPICS} | {query.pattern for query in QUERIES}
    return patterns - _BODIES.keys() - _REQUESTS.keys()
