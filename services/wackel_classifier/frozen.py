"""Values that stay exactly the same although they must change.

A resting servo is legitimately constant. Two things prove that one is not at rest: it was given new
goals and used to follow them, or it reports a velocity while its position stays.
"""

from dataclasses import dataclass

from wackel_classifier.alerts import Alerts
from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_protocols.dynamixel2.control_table import Model
from wackel_protocols.dynamixel2.packet import PREFIX_BYTES, Instruction

CONSTANT_NS = 700_000_000
"""A servo follows a goal within some tens of milliseconds, a sluggish one within some tenths of a
second; a joint at its end of movement stands still for a moment."""
READINGS = 5
"""As often as the values must have been read meanwhile."""
GOALS = 5
"""New goals in that time that it did not follow."""
GOAL_SPAN = 0.05
"""rad or rad/s between these goals; below, friction and the servo's own tolerance may hold it."""
FOLLOWED = 5
"""How often it must have followed new goals before, so that one without torque is not blamed."""
TRAVEL = 0.02
"""rad that the reported velocity must amount to over a position that does not change: more than ten
steps of the sensor (0.0015 rad)."""


@dataclass(slots=True)
class _Servo:
    """Attributes: ``values`` measured bytes, unchanged since ``constant_ns`` (stamp ``since``);
    ``goals`` new goals since then, between ``low`` and ``high``; ``followed`` new goals that were
    followed by new values, ``before`` those before it was out of reach; ``goal`` the latest;
    ``readings`` of these values, the last at ``seen_ns``; ``travel`` rad that the velocity amounts
    to.
    """

    values: bytes = b""
    constant_ns: int = 0
    since: int = 0
    goal: float | None = None
    goals: int = 0
    low: float = 0.0
    high: float = 0.0
    followed: int = 0
    before: int = 0
    seen_ns: int = 0
    readings: int = 0
    travel: float = 0.0
    torque_off: bool = False


class Frozen:
    """Follows measured values and goals."""

    def __init__(self, chain: Chain, models: list[Model]) -> None:
        self._chain = chain
        self._models = models
        self._servos = [_Servo() for _ in range(len(chain))]

    def values(
        self, position: int, data: bytes, velocity: float | None, now_ns: int, stamp: int
    ) -> None:
        """Measured values of a servo: raw bytes, and the velocity among them in rad/s."""
        servo = self._servos[position]
        if data != servo.values:
            if servo.goals:
                servo.followed = min(servo.followed + 1, FOLLOWED)
            servo.values, servo.constant_ns, servo.since = data, now_ns, stamp
            servo.goals, servo.readings, servo.travel = 0, 0, 0.0
            if servo.goal is not None:
                servo.low = servo.high = servo.goal
        elif velocity is not None:
            servo.travel += abs(velocity) * (now_ns - servo.seen_ns) / 1e9
        servo.readings += 1
        servo.seen_ns = now_ns

    def command(self, instruction: bytes) -> bool:
        """A sync write, which may hold goals or switch torque; whether it did."""
        if len(instruction) < PREFIX_BYTES + 7 or instruction[7] != Instruction.SYNC_WRITE:
            return False
        address = int.from_bytes(instruction[8:10], "little")
        length = int.from_bytes(instruction[10:12], "little")
        # A stuffed one is seldom and skipped: the next has other goals.
        body = instruction[12:-2]
        if not length or len(body) % (length + 1):
            return False
        known = False
        for start in range(0, len(body), length + 1):
            position = self._chain.position.get(body[start])
            if position is not None:
                known |= self._written(position, address, body[start + 1 : start + 1 + length])
        return known

    def gone(self, position: int) -> None:
        """A servo is out of reach; it may come back without torque."""
        servo = self._servos[position]
        self._servos[position] = _Servo(before=max(servo.before, servo.followed))

    def torque(self, position: int, enabled: bool) -> None:
        """Torque Enable was read or written."""
        servo = self._servos[position]
        servo.torque_off = not enabled
        if enabled:
            servo.followed = max(servo.followed, servo.before)
        else:
            servo.followed = servo.goals = servo.before = 0

    def findings(self, alerts: Alerts) -> list[Finding]:
        """Servos whose values cannot be true; one that reports an error may have let go."""
        found = []
        for position, servo in enumerate(self._servos):
            # Up to the last reading: nothing is known of the time since.
            constant_ns = servo.seen_ns - servo.constant_ns
            if (
                not servo.values
                or servo.readings < READINGS
                or constant_ns < CONSTANT_NS
                or alerts.complains(position)
            ):
                continue
            ignores = (
                servo.followed >= FOLLOWED
                and servo.goals >= GOALS
                and servo.high - servo.low >= GOAL_SPAN
                and not servo.torque_off
            )
            if not ignores and servo.travel < TRAVEL:
                continue
            why = (
                f"{servo.goals} new goals"
                if ignores
                else f"a reported velocity that amounts to {servo.travel:.2f} rad"
            )
            found.append(
                Finding(
                    "frozen_values",
                    self._chain.servo(position),
                    0.9,
                    servo.since,
                    f"exactly the same values for {constant_ns / 1e9:.1f} s despite {why}",
                    {"goals": servo.goals, "goal_span": round(servo.high - servo.low, 4)},
                )
            )
        return found

    def _written(self, position: int, address: int, data: bytes) -> bool:
        """Whether what was written is a goal or switches torque."""
        model = self._models[position]
        for name in ("goal_position", "goal_velocity"):
            register = model.registers.get(name)
            if register and register.address == address and register.length == len(data):
                self._goal(position, register.to_si(register.decode(data)))
                return True
        torque = model.registers.get("torque_enable")
        if torque and torque.address == address and len(data) == 1:
            self.torque(position, bool(data[0]))
            return True
        return False

    def _goal(self, position: int, goal: float) -> None:
        servo = self._servos[position]
        if goal == servo.goal:
            return
        if servo.goal is None:
            servo.low = servo.high = goal
        servo.goal = goal
        servo.goals += 1
        servo.low, servo.high = min(servo.low, goal), max(servo.high, goal)
