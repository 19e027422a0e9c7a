"""The drive on the bus: servos turn its wheels, and show what these do. Time is an argument, in ns.

The drive moves in steps on a grid; a servo that is read in between shows its shaft at the speed of
the last step. A step takes a computer longer than an answer takes on the wire, so who runs the bus
in real time makes them in its pauses (:meth:`CoupledDrive.advance`).

Whatever happens on the bus happens to the drive: a servo without supply, or with torque disabled by
an overload, lets its wheel roll or its steering stand.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from wackel_drive.layout import Joint
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas.virtual import Injection
from wackel_virtual.bus import VirtualBus
from wackel_virtual.drivetrain import Demand, Drivetrain, Physics
from wackel_virtual.motion import TIME_CONSTANT_S, Drive, Motion
from wackel_virtual.servo import Servo

TICK_NS = 5_000_000
"""A tenth of the motors' time constant: their speed changes by a few percent in a step."""
KEPT = 8
"""Steps that a shaft remembers: the drive may be ahead of who asks."""
ARRIVED_RAD = 0.005
"""About the resolution of the sensors."""


class Sample(NamedTuple):
    """What a gyro measured, rad/s: the mean of a time, of which middle and end are given."""

    name: str
    at_ns: int
    end_ns: int
    rates: tuple[float, float, float]


class _Shown(NamedTuple):
    """A shaft after a step: rad, rad/s, A."""

    at_ns: int
    angle: float
    rate: float
    amperes: float


class Shaft(Motion):
    """The shaft of a servo that is part of the drive: it goes where that goes.

    Attributes:
        mode, goal, allowed: What the servo wants.
    """

    def __init__(self, drive: "CoupledDrive", bus: VirtualBus, servo: Servo, sign: int) -> None:
        super().__init__(0.0, 0.0, 0.0)
        self.mode: Drive = "off"
        self.goal = 0.0
        self.allowed = 0.0
        self._drive_train = drive
        self._bus = bus
        self._servo = servo
        self._sign = sign
        self._shown: deque[_Shown] = deque([_Shown(0, 0.0, 0.0, 0.0)], maxlen=KEPT)
        self._now = self._shown[-1]
        self._forgotten = 0.0  # whole turns

    def drive(self, drive: Drive, goal: float, allowed: float, at_ns: int) -> None:
        """Go for a goal from now on, at most as fast as ``allowed``."""
        self.advance(at_ns)
        self.mode, self.goal = drive, goal
        self.allowed = min(allowed, self.limit)

    def advance(self, at_ns: int) -> None:
        """Move on to this time."""
        self._drive_train.catch_up(at_ns)
        # The drive may be ahead of the time that is asked for.
        self._now = now = next(
            (shown for shown in reversed(self._shown) if shown.at_ns <= at_ns), self._shown[0]
        )
        self.velocity = now.rate
        self.position = now.angle + now.rate * (at_ns - now.at_ns) / 1e9 - self._forgotten

    def unwind(self, turn: float) -> None:
        """Forget whole turns, rad."""
        before = self.position
        super().unwind(turn)
        self._forgotten += before - self.position

    @property
    def current(self) -> float:
        """Motor current, A."""
        return self._now.amperes

    @property
    def arrived(self) -> bool:
        """Whether the shaft is where it should be."""
        if self.mode == "position":
            return abs(self.goal - self.position) < ARRIVED_RAD
        return self.mode == "off" and not self.velocity

    def show(self, at_ns: int, angle: float, rate: float, amperes: float) -> None:
        """Where it is at this time, in the direction of the wheel."""
        sign = self._sign
        self._shown.append(_Shown(at_ns, sign * angle, sign * rate, sign * amperes))

    @property
    def has_torque(self) -> bool:
        """Whether its motor holds it."""
        return self.mode != "off" and self._bus.powered(self._servo)

    @property
    def wanted_rate(self) -> float:
        """Speed that it wants, rad/s, in the direction of the wheel."""
        rate = self.goal
        if self.mode == "position":
            rate = (self.goal + self._forgotten - self._shown[-1].angle) / TIME_CONSTANT_S
        return self._sign * max(-self.allowed, min(self.allowed, rate))

    @property
    def wanted_angle(self) -> float:
        """Angle that it wants, rad, in the direction of the wheel."""
        if self.mode == "position":
            return self._sign * (self.goal + self._forgotten)
        return self._sign * (self._shown[-1].angle + self.goal * TIME_CONSTANT_S)

    def switch_motor_off(self, off: bool, at_ns: int) -> None:
        """Whether its servo's torque stays off."""
        self._servo.switch_motor_off(off, at_ns)


class CoupledDrive:
    """A drive whose motors are servos on virtual buses.

    Args:
        drive: As configured.
        gyros: By name; those of source ``bus`` appear on their boards.
        buses: With all the servos of the drive, before their first instruction.
        seed: Of everything random.
        physics: Which body.

    Attributes:
        drivetrain: The drive itself.
        now_ns: Up to when it has moved.

    Raises:
        ImportError: ``mujoco`` is not installed.
    """

    def __init__(
        self,
        drive: DriveConfig,
        gyros: Mapping[str, GyroConfig],
        buses: Mapping[str, VirtualBus],
        seed: int | str,
        physics: Physics = "fast",
    ) -> None:
        self.drivetrain = Drivetrain(drive, gyros, seed, physics=physics)
        layout = self.drivetrain.layout
        self._layout = layout
        self._gyros = gyros
        self._boards = [board for bus in buses.values() for board in bus.boards.values()]
        fastest = max((gyro.rate for gyro in gyros.values()), default=0.0)
        self._tick_ns = min(TICK_NS, round(1e9 / fastest)) if fastest else TICK_NS
        self.now_ns = 0
        self._sampled_ns = dict.fromkeys(gyros, 0)
        self._samples: list[Sample] = []
        self._free = self.drivetrain.free
        self._rolling = self._couple(layout.rolling, buses, turns=True)
        self._steering = self._couple(layout.steering, buses, turns=False)
        self._show()

    def inject(self, injection: Injection) -> Injection:
        """Have a fault begin ``start_s`` from now; returns it with its defaults filled in.

        Raises:
            InjectionError: Unknown kind, or a place or value that it cannot have.
        """
        return self.drivetrain.inject(injection)

    def heal(self, kind: str = "", wheel: str | None = None) -> list[Injection]:
        """End faults now, scheduled ones too; returns those that it concerned."""
        return self.drivetrain.heal(kind, wheel)

    def active(self) -> list[Injection]:
        """The faults that act now."""
        return self.drivetrain.active()

    def move_ns(self) -> int:
        """When its next step ends."""
        return self.now_ns + self._tick_ns

    def sample_ns(self) -> int | None:
        """When a gyro has a sample; None: not before the next step."""
        return min((sample.end_ns for sample in self._samples), default=None)

    def advance(self, until_ns: int) -> None:
        """Move on to this time; one that has passed changes nothing."""
        while self.now_ns + self._tick_ns <= until_ns:
            self.now_ns += self._tick_ns
            self._step()

    def catch_up(self, until_ns: int) -> None:
        """As :meth:`advance`, if it has been left behind by more than a step."""
        if until_ns - self.now_ns >= 2 * self._tick_ns:
            self.advance(until_ns)

    def samples(self, until_ns: int) -> list[Sample]:
        """What gyros that are not on a bus have measured up to this time, since the last call."""
        ready = [sample for sample in self._samples if sample.end_ns <= until_ns]
        self._samples = [sample for sample in self._samples if sample.end_ns > until_ns]
        return ready

    def _couple(
        self, joints: Iterable[Joint | None], buses: Mapping[str, VirtualBus], *, turns: bool
    ) -> list[Shaft | None]:
        shafts: list[Shaft | None] = []
        for joint in joints:
            shaft = None
            if joint is not None:
                bus = buses[joint.servo.bus]
                servo = bus.servos[bus.ids.index(joint.servo.id)]
                shaft = Shaft(self, bus, servo, joint.sign)
                servo.couple(shaft, turns=turns)
            shafts.append(shaft)
        return shafts

    def _step(self) -> None:
        drivetrain, n = self.drivetrain, self._layout.drive.n
        rate, powered = [0.0] * n, [False] * n
        for i, shaft in enumerate(self._rolling):
            if shaft is not None:
                rate[i], powered[i] = shaft.wanted_rate, shaft.has_torque
        heading, steered = [*drivetrain.steered], [False] * n
        for i, (shaft, joint) in enumerate(zip(self._steering, self._layout.steering, strict=True)):
            if shaft is not None and joint is not None:
                heading[i], steered[i] = shaft.wanted_angle + joint.offset, shaft.has_torque
        drivetrain.step(Demand(rate, powered, heading, steered), self._tick_ns / 1e9)
        self._show()
        if drivetrain.free is not self._free:
            for shaft, was, off in zip(self._rolling, self._free, drivetrain.free, strict=True):
                if shaft is not None and was != off:
                    shaft.switch_motor_off(off, self.now_ns)
        self._free = drivetrain.free
        for name, gyro in self._gyros.items():
            self._sample(name, gyro)

    def _show(self) -> None:
        """Tell the shafts where they are."""
        drivetrain, now_ns = self.drivetrain, self.now_ns
        for i, shaft in enumerate(self._rolling):
            if shaft is not None:
                shaft.show(now_ns, drivetrain.rolled[i], drivetrain.rate[i], drivetrain.current[i])
        for i, (shaft, joint) in enumerate(zip(self._steering, self._layout.steering, strict=True)):
            if shaft is not None and joint is not None:
                shaft.show(
                    now_ns,
                    drivetrain.steered[i] - joint.offset,
                    drivetrain.steering_rate[i],
                    drivetrain.steering_current[i],
                )

    def _sample(self, name: str, gyro: GyroConfig) -> None:
        """Let a gyro measure if its time has come."""
        last_ns = self._sampled_ns[name]
        # Half a step early is nearer than half a step late.
        if self.now_ns - last_ns + self._tick_ns // 2 < 1e9 / gyro.rate:
            return
        self._sampled_ns[name] = self.now_ns
        rates = self.drivetrain.sample(name)
        for board in self._boards:
            if name in board.rates:
                board.rates[name] = rates
        if gyro.source == "topic":
            middle_ns = (last_ns + self.now_ns) // 2
            self._samples.append(Sample(name, middle_ns, self.now_ns, rates))
