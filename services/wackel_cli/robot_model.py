"""What the topics of a robot say of it just now, gathered for a view. No clock, no drawing.

Every method that takes a message also takes the monotonic time of its arrival, s, and raises
:class:`~wackel_schemas.wire.Rejected` where it makes no sense.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import msgspec

from wackel_node.config import BusConfig, RobotConfig, ServoConfig
from wackel_schemas.bus import BusState, BusStatistics, ServoStatistics, Transaction
from wackel_schemas.drive import Odometry
from wackel_schemas.health import FaultRecord, Health
from wackel_schemas.wire import Rejected

STALE_S = 2.5  # health and statistics come once a second: 2.5 periods
_LOSS_SPAN = 10  # statistics, so seconds, over which loss is counted
_RESPONSES = 64  # the last ones, of which the median is shown
_MAX_BUSES = 32  # strangers may write on any number of keys
_MAX_ID = 252  # Dynamixel Protocol 2.0
_VALUES = ("position", "velocity", "current", "voltage", "temperature")


@dataclass
class Servo:
    """One servo.

    Attributes:
        config: Id, model, role.
        answered_s: When it last answered; absent: never yet.
        hz: Intact answers per second.
        loss: Share of the answers it owed in the last ten seconds that did not come.
        values: Decoded values by name with the time of their arrival.
        alert: The alert bit of its last answer.
    """

    config: ServoConfig
    answered_s: float | None = None
    hz: float = 0.0
    loss: float | None = None
    values: dict[str, tuple[float, float]] = field(default_factory=dict)
    alert: bool = False
    responses_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_RESPONSES))
    answers: int = 0

    @property
    def response_s(self) -> float | None:
        """Median time to its answer."""
        return median(self.responses_ns) / 1e9 if self.responses_ns else None


@dataclass
class Bus:
    """One bus.

    Attributes:
        name: Of the bus.
        servos: In cable order.
        statistics: The last, arrived at ``statistics_s``.
        loss: As for a servo, of all its servos together.
    """

    name: str
    servos: dict[int, Servo]
    statistics: BusStatistics | None = None
    statistics_s: float | None = None
    loss: float | None = None
    history: deque[dict[int, ServoStatistics]] = field(
        default_factory=lambda: deque(maxlen=_LOSS_SPAN + 1)
    )


class RobotModel:
    """A robot as its topics show it.

    Attributes:
        robot: Its name.
        buses: By name.
        health: The last, arrived at ``health_s``.
        wheels: Their names; none: it has no drive.
        odometry: The last, arrived at ``odometry_s``.
    """

    def __init__(self, config: RobotConfig) -> None:
        """Buses and servos that the configuration lacks appear as they are heard of."""
        self.robot = config.robot
        self.buses: dict[str, Bus] = {name: _bus(name, bus) for name, bus in config.buses.items()}
        self.health: Health | None = None
        self.health_s: float | None = None
        self.wheels = [wheel.name for wheel in config.drive.wheels] if config.drive else []
        self.odometry: Odometry | None = None
        self.odometry_s: float | None = None
        self._counted_s: float | None = None

    def on_health(self, health: Health, now_s: float) -> None:
        """Takes in health."""
        self.health, self.health_s = health, now_s

    def on_odometry(self, odometry: Odometry, now_s: float) -> None:
        """Takes in where the robot is."""
        self.odometry, self.odometry_s = odometry, now_s

    def on_statistics(self, name: str, statistics: BusStatistics, now_s: float) -> None:
        """Takes in the counters of a bus."""
        bus = self._bus(name)
        if bus.statistics is not None and bus.statistics.boot != statistics.boot:
            bus.history.clear()
        bus.statistics, bus.statistics_s = statistics, now_s
        bus.history.append({servo.id: servo for servo in statistics.servos})
        for each in statistics.servos:
            self._servo(bus, each.id).loss = _loss(bus.history, [each.id])
        bus.loss = _loss(bus.history, bus.servos)

    def on_state(self, name: str, state: BusState, now_s: float) -> None:
        """Takes in decoded values."""
        bus = self._bus(name)
        for each in state.servos:
            servo = self._servo(bus, each.id)
            servo.alert = each.alert
            for value_name in _VALUES:
                value = getattr(each, value_name)
                if value is not None:
                    servo.values[value_name] = (value, now_s)

    def on_transaction(self, name: str, transaction: Transaction, now_s: float) -> None:
        """Takes in who answered, and how fast."""
        bus = self._bus(name)
        for each in transaction.response_times:
            servo = self._servo(bus, each.id)
            servo.answered_s = now_s
            servo.answers += 1
            servo.responses_ns.append(each.ns)

    def count(self, now_s: float) -> None:
        """Makes rates of the answers since the last call; to be called about once a second."""
        for bus in self.buses.values():
            for servo in bus.servos.values():
                if self._counted_s is not None and now_s > self._counted_s:
                    servo.hz = servo.answers / (now_s - self._counted_s)
                servo.answers = 0
        self._counted_s = now_s

    def faults(self, *statuses: str) -> list[FaultRecord]:
        """The faults of these statuses in health's order."""
        faults = self.health.faults if self.health is not None else []
        return [fault for fault in faults if fault.status in statuses]

    def snapshot(self, now_s: float) -> dict[str, Any]:
        """All of it for programs; ages and times in s, the rest as in the messages."""

        def age(at_s: float | None) -> float | None:
            return None if at_s is None else round(now_s - at_s, 3)

        def servo_snapshot(servo: Servo) -> dict[str, Any]:
            return {
                "id": servo.config.id,
                "model": servo.config.model,
                "role": servo.config.role,
                "hz": round(servo.hz, 2),
                "age_s": age(servo.answered_s),
                "response_s": servo.response_s,
                "loss": servo.loss,
                "alert": servo.alert,
                **{name: value for name, (value, _) in servo.values.items()},
            }

        return {
            "robot": self.robot,
            "health": self.health,
            "health_age_s": age(self.health_s),
            "wheels": self.wheels,
            "odometry": self.odometry,
            "odometry_age_s": age(self.odometry_s),
            "buses": {
                bus.name: {
                    "statistics": bus.statistics,
                    "statistics_age_s": age(bus.statistics_s),
                    "loss": bus.loss,
                    "servos": [servo_snapshot(servo) for servo in bus.servos.values()],
                }
                for bus in self.buses.values()
            },
        }

    def as_json(self, now_s: float) -> str:
        """:meth:`snapshot` as a line of JSON."""
        return msgspec.json.encode(self.snapshot(now_s)).decode()

    def _bus(self, name: str) -> Bus:
        if name not in self.buses:
            if len(self.buses) == _MAX_BUSES:
                raise Rejected(f"bus {name} is one too many; {_MAX_BUSES} are shown")
            self.buses[name] = Bus(name, {})
        return self.buses[name]

    def _servo(self, bus: Bus, servo_id: int) -> Servo:
        servo = bus.servos.get(servo_id)
        if servo is None:
            if not 0 <= servo_id <= _MAX_ID:
                raise Rejected(f"{servo_id} is no id of a servo")
            servo = bus.servos[servo_id] = Servo(ServoConfig(id=servo_id, model="", role=""))
        return servo


def _bus(name: str, config: BusConfig) -> Bus:
    return Bus(name, {servo.id: Servo(servo) for servo in config.servos})


def _loss(history: deque[dict[int, ServoStatistics]], ids: Iterable[int]) -> float | None:
    """Share of answers that were owed between the oldest and the newest counters and missed."""
    oldest, newest = history[0], history[-1]
    none = ServoStatistics(id=0)
    both = [(oldest.get(i, none), newest[i]) for i in ids if i in newest]
    expected = sum(new.expected - old.expected for old, new in both)
    received = sum(new.received - old.received for old, new in both)
    return max(0.0, 1 - received / expected) if expected > 0 else None
