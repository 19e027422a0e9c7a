"""Every key expression of wackel and the message behind it; nothing else spells a key."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Generic, Literal, TypeVar

from wackel_schemas.bus import (
    BusCommand,
    BusReply,
    BusRequest,
    BusState,
    BusStatistics,
    Transaction,
)
from wackel_schemas.drive import (
    Exclusions,
    ImuSample,
    Odometry,
    OdometryReply,
    OdometryRequest,
    PoseSet,
    TwistCommand,
)
from wackel_schemas.fault import FaultReport
from wackel_schemas.health import Health, HealthReply, HealthRequest, Heartbeat
from wackel_schemas.inputs import Inputs
from wackel_schemas.message import Message, Record
from wackel_schemas.residuals import Residuals
from wackel_schemas.virtual import VirtualReply, VirtualRequest

ROOT = "wackel"
MOST_BYTES = 1 << 18
"""The longest message of wackel's own but health: a bus that was jammed for a tenth of a second at
4 Mbit/s gives a transaction of 40 kB."""
MOST_HEALTH_BYTES = 1 << 22
"""As many faults as the aggregator keeps, each with the longest evidence that it takes."""

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Record)
R = TypeVar("R", bound=Message)


@dataclass(frozen=True, eq=False)  # each is one of a kind; looked up for every message
class Topic(Generic[M]):
    """A key pattern below ``wackel/<robot>/`` and the type published there.

    Attributes:
        pattern: Key with named chunks in braces, ``bus/{bus}/state``.
        message: The type.
        origin: ``input`` for what comes from outside the diagnosis and is played back in the
            gateway's place; ``derived`` for what wackel concludes from it.
        keep: What a reader that is slow keeps: the ``newest`` (state) or ``all`` (evidence).
        latched: Whether a late subscriber gets the latest value.
        most_bytes: Longer ones are refused: strangers' messages must fill neither the memory nor
            the time of a reader.
    """

    pattern: str
    message: type[M]
    origin: Literal["input", "derived"]
    keep: Literal["newest", "all"]
    latched: bool = False
    most_bytes: int = MOST_BYTES

    def key(self, **chunks: str) -> str:
        """The key below the robot's name; a chunk that is not given matches any (``*``)."""
        return _fill(self.pattern, chunks)


@dataclass(frozen=True)
class Query(Generic[Q, R]):
    """A key pattern that answers requests."""

    pattern: str
    request: type[Q]
    reply: type[R]

    def key(self, **chunks: str) -> str:
        """The key below the robot's name."""
        return _fill(self.pattern, chunks)


def _fill(pattern: str, chunks: dict[str, str]) -> str:
    parts = []
    for part in pattern.split("/"):
        name = part[1:-1] if part.startswith("{") else None
        parts.append(part if name is None else chunks.get(name, "*"))
    return "/".join(parts)


TRANSACTION = Topic("bus/{bus}/transaction", Transaction, "input", "all")
STATE = Topic("bus/{bus}/state", BusState, "input", "newest")
STATISTICS = Topic("bus/{bus}/statistics", BusStatistics, "input", "newest")
COMMAND = Topic("bus/{bus}/command", BusCommand, "input", "newest")
IMU = Topic("imu/{name}", ImuSample, "input", "newest")
TWIST_COMMAND = Topic("command/twist", TwistCommand, "input", "newest")
ODOMETRY = Topic("odometry", Odometry, "derived", "newest")
POSE_SET = Topic("odometry/pose_set", PoseSet, "derived", "all")
EXCLUSIONS = Topic("exclusions", Exclusions, "derived", "newest", latched=True)
RESIDUALS = Topic("residuals", Residuals, "derived", "newest")
FAULT = Topic("fault/{source}", FaultReport, "derived", "all")
HEALTH = Topic("health", Health, "derived", "newest", latched=True, most_bytes=MOST_HEALTH_BYTES)
ALIVE = Topic("alive/{service}/{instance}", Heartbeat, "derived", "all")
INPUTS = Topic("inputs/{service}/{instance}", Inputs, "derived", "all")

BUS_REQUEST = Query("bus/{bus}/request", BusRequest, BusReply)
ODOMETRY_REQUEST = Query("odometry/request", OdometryRequest, OdometryReply)
HEALTH_REQUEST = Query("health/request", HealthRequest, HealthReply)
VIRTUAL_REQUEST = Query("virtual/request", VirtualRequest, VirtualReply)

TOPICS: tuple[Topic[Message], ...] = (  # type: ignore[assignment]
    TRANSACTION,
    STATE,
    STATISTICS,
    COMMAND,
    IMU,
    TWIST_COMMAND,
    ODOMETRY,
    POSE_SET,
    EXCLUSIONS,
    RESIDUALS,
    FAULT,
    HEALTH,
    ALIVE,
    INPUTS,
)
QUERIES: tuple[Query[Record, Message], ...] = (  # type: ignore[assignment]
    BUS_REQUEST,
    ODOMETRY_REQUEST,
    HEALTH_REQUEST,
    VIRTUAL_REQUEST,
)


@lru_cache(maxsize=1024)  # asked for every message; strangers' keys are soon forgotten
def topic_of(key: str) -> "Topic[Message] | None":
    """The topic that a key below the robot's name belongs to; ``None`` for a foreign key."""
    parts = key.split("/")
    for topic in TOPICS:
        pattern = topic.pattern.split("/")
        if len(pattern) == len(parts) and all(
            p.startswith("{") or p == k for p, k in zip(pattern, parts, strict=True)
        ):
            return topic
    return None


@lru_cache(maxsize=1024)  # as above
def chunk_of(topic: "Topic[Message]", key: str, name: str) -> str:
    """The named chunk of a key, such as the bus of ``bus/main/state``.

    Raises:
        ValueError: The key does not belong to the topic.
    """
    for p, k in zip(topic.pattern.split("/"), key.split("/"), strict=True):
        if p == "{" + name + "}":
            return k
    raise ValueError(f"{key} has no chunk {name} in {topic.pattern}")
