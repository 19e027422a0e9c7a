"""What the wheels should do: the commanded twist through inverse kinematics and the drives' lag."""

import math
from collections import deque
from operator import add, mul, sub
from typing import TypeAlias

import msgspec
import numpy as np

from wackel_diagnoser.command_times import CommandTimes
from wackel_diagnoser.drive_lags import DriveLags
from wackel_diagnoser.pace import Pace
from wackel_diagnoser.steering_rate import SteeringRate
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.inverse import STANDSTILL_M_S
from wackel_node.config_drive import DriveConfig
from wackel_schemas.drive import TwistCommand

SETTLING_S = 0.15
"""A servo that turns as fast as it can takes longer than its lag: a quarter turn at 60 rev/min
0.25 s."""
PENDING = 0.15
"""Share of what is still to come (command less reference) by which a reference may be off: a real
drive is no first-order lag."""
LAG = 0.2
"""Share by which the lag of rolling may be another: those that are tried lie so far apart, and one
that fits alike is kept."""
PENDING_UNLEARNT = 1.0
"""The first while the lag of steering is not learnt: all of it. Some robots drive straight on for
long until they are steered for the first time."""
LAG_UNLEARNT = 2.0
"""The second while that of rolling is not: SETTLING_S is twice as much longer than where learning
begins as that is long."""
TELLS = 0.01
"""m/s and rad that a drive or a steering must still be off the command to tell of its lag; at rest,
and at an even speed, nothing is learnt, and nothing forgotten."""
JUMPS = 0.1
"""rad and m/s by which commands differ between which it matters that one was missed."""
EITHER_RAD = 0.5
"""Turn of a wheel within commands one of which was missed, after which it is not known which way
round the wheel turns: the one between may have been nearer to the opposite direction."""
FASTER = 1.2
"""Times as fast as was known that steerings turn, from which on what was learnt of their lag is
void. In the first turn it is three times; later some hundredths, by which little falls behind."""
ALIGNED_RAD = 0.1
"""Wheels that have to turn by more than that slow each other down."""
FASTEST = 20.0
"""m/s and rad/s; no robot on servos does more, and nothing larger is a command."""
AS_FAST = 0.9
"""Share of its fastest from which a steering turns as fast as it can; stamps are a little off."""
_MOST_WAITING = 64
_QUARTER = math.pi / 2  # of a turn
FAR_RAD = _QUARTER
"""How far one that turns so may still be from a goal that is not known: a command is never further
off, but many that follow each other may have moved it on."""

Twist: TypeAlias = tuple[float, float, float]
_NO_TWIST: Twist = (math.nan, math.nan, math.nan)


class Target(msgspec.Struct, frozen=True, gc=False):
    """What the wheels should have done in a step; NaN where it is not known.

    Attributes:
        heading: Direction of each wheel, rad to the left of forward; not wrapped, on the side on
            which the wheel stands.
        turned: How far each was steered meanwhile, rad.
        heading_gap: How far the heading still was from the command, rad, of each wheel; where that
            is not known, how far it may be at least, since it turns as fast as it can.
        speed: Rolling speed of each roll row, m/s.
        speed_gap: How far that still was from the command, m/s, of each roll row.
        speed_late: Derivative of that by the logarithm of the lag: a tenth of it is by how much the
            speed would be another if the drive lagged a tenth more or less. Until the lag is
            learnt, the same of a step up to SETTLING_S.
        goal: Commanded headings, on this side or half a turn round.
        twist: Commanded.
        off_s: By how much the step is longer than most, as far as its stamps may be wrong.
        pending_share: Of the first gap, by which headings may be off: PENDING, and more if the lag
            of steering is not learnt.
        lag_share: By which the lag of rolling may be another: LAG, and more if it is not learnt.
        known: Whether there is a command to follow.
    """

    heading: list[float]
    turned: list[float]
    heading_gap: list[float]
    speed: list[float]
    speed_gap: list[float]
    speed_late: list[float]
    goal: list[float]
    twist: Twist
    off_s: float
    pending_share: float = PENDING
    lag_share: float = LAG
    known: bool = True

    @property
    def is_guessed(self) -> bool:
        """Whether drives are on their way to their command with a lag that is not learnt; not so
        where commands change too little to tell of it."""
        turns = self.pending_share > PENDING and max(self.heading_gap) > TELLS
        hastens = self.lag_share > LAG and max(self.speed_late, default=0.0) > TELLS
        return turns or hastens


class Reference:
    """Follows the commands.

    Single numbers: for some wheels, Python is faster with them than numpy.

    Args:
        layout: The drive.
        config: The same, as configured.
    """

    def __init__(self, layout: Layout, config: DriveConfig) -> None:
        drive = layout.drive
        self._n = n = drive.n
        self._steered: list[int] = np.flatnonzero(drive.steers).tolist()
        self._places = [(i, *drive.xy[i].tolist()) for i in self._steered]
        self._rolls: list[int] = drive.roll_wheels.tolist()
        # Where the goal has the speeds of wheels that steer, too.
        self._both = [self._n + at for at, i in enumerate(self._rolls) if drive.steers[i]]
        self._radius: list[float] = drive.roll_radius.tolist()
        # Roll rows of wheels that do not steer.
        rows = drive.rows(drive.steering(np.zeros(n)))[drive.slide_count :].tolist()
        self._fixed = [
            (at, row)
            for at, (i, row) in enumerate(zip(self._rolls, rows, strict=True))
            if not drive.steers[i]
        ]
        self._waiting: deque[tuple[int, Twist]] = deque(maxlen=_MOST_WAITING)
        self._times = CommandTimes(self._steered)
        self._pace = Pace()
        self._twist: Twist = (0.0, 0.0, 0.0)
        self._heading = [wheel.heading for wheel in config.wheels]
        self._speed = [0.0] * n
        # Headings of all wheels, then speeds of the roll rows.
        self._goal = self._state = [0.0] * (n + len(self._rolls))
        self._known = False
        # By how many half turns wheels stand the other way round, and which way those roll.
        self._halves = [0] * n
        self._sign = [1.0] * len(self._rolls)
        self._envelope = [0.0] * n
        self._late = [0.0] * len(self._rolls)
        self._lags = DriveLags(n, len(self._rolls))
        self._steering_rate = SteeringRate(n, config.encoder_step)
        self._rate = self._steering_rate.now  # with which they were followed last
        self._fast_s = [0.0] * n  # for how long each turns as fast as it can
        unknown, none = [math.nan] * n, [math.nan] * len(self._rolls)
        still = [0.0] * len(self._rolls)
        self._nowhere = unknown, none, still

    @property
    def lags_s(self) -> tuple[float, float]:
        """Of steering and of rolling, as learnt."""
        steering, rolling = self._lags.used_s
        return steering, rolling

    def command(self, message: TwistCommand) -> bool:
        """Takes in a command; says whether it can be one."""
        vx, vy, omega = twist = message.vx, message.vy, message.omega
        if not (abs(vx) <= FASTEST and abs(vy) <= FASTEST and abs(omega) <= FASTEST):
            return False  # nor if one is NaN, which no comparison holds for
        newest = self._waiting[-1][0] if self._waiting else None
        if newest is not None and message.stamp <= newest:
            self._waiting.clear()  # time was set back; what waits belongs to another
        self._waiting.append((message.stamp, twist))
        return True

    def forget(self) -> None:
        """Time was started anew."""
        self._waiting.clear()
        self._times.forget()
        self._known = False

    def step(self, step: Step, learnt_s: float) -> Target:
        """What the wheels should have done in a step.

        Args:
            step: What they did.
            learnt_s: For how much driving without a fault it stands; 0: nothing can be learnt.
        """
        missed, before = False, self._goal
        while self._waiting and self._waiting[0][0] <= step.begin:
            stamp, twist = self._waiting.popleft()
            if not self._times.is_overtaken(stamp):
                missed |= self._times.follow(stamp)
                self._twist = twist
                self._aim()
        self._times.pass_to(step.begin)
        if missed and self._may_have_turned_round(before):
            self._times.doubt(step.begin)
        off_s = self._pace.off_s(step.seconds)
        self._steering_rate.step(step.steered, step.seconds)
        if not self._times.is_known(step.begin, step.steered, step.seconds):
            self._known = False
            return self._unknown(step, off_s)
        heading = step.heading
        if not self._known:
            self._start(heading, step.wheel_rate)
        elif missed and max(map(abs, map(sub, self._goal, before))) > JUMPS:
            self._state = _known(self._shown(heading, step.wheel_rate), self._state)
        n, dt, goal, state, halves = self._n, step.seconds, self._goal, self._state, self._halves
        # The measured heading may be that of the same wheel turned half round and rolling back.
        for i in self._steered:
            if not -_QUARTER <= heading[i] - state[i] - math.pi * halves[i] <= _QUARTER:
                self._turn_half_round(i, heading[i] - state[i])
        before_rate, rate = self._rate, self._steering_rate.now
        self._rate = rate
        if rate > before_rate:
            self._catch_up(rate - before_rate)
            if rate > FASTER * before_rate:
                shown = self._shown(heading, step.wheel_rate)[:n]
                self._lags.turn_faster([*map(sub, shown, [0.5 * each for each in step.steered])])
        most = rate * dt
        gap = [*map(sub, state, goal)]
        turns, hastens = gap[:n], gap[n:]
        middle, turned = self._move(turns, hastens, dt, most)
        self._lags.follow(goal, dt, most, off_s)
        if learnt_s and (max(gap) > TELLS or min(gap) < -TELLS):
            self._learn(heading, step, learnt_s, (_tells(turns), _tells(hastens)))
        fade = math.exp(-dt / SETTLING_S)
        self._envelope = [*map(max, map(abs, turns), [fade * each for each in self._envelope])]
        steering_learnt, rolling_learnt = self._lags.learnt
        lags = dt / (self._lags.used_s[1] if rolling_learnt else SETTLING_S)
        fade = math.exp(-lags)
        late = self._late = [
            fade * (before + lags * now) for before, now in zip(self._late, hastens, strict=True)
        ]
        speed = middle[n:]
        if any(halves):
            for i, half in enumerate(halves):
                middle[i] += math.pi * half
            speed = [*map(mul, self._sign, speed)]
        return Target(
            middle[:n],
            turned,
            self._envelope,
            speed,
            [*map(abs, hastens)],
            [*map(abs, late)],
            goal[:n],
            self._twist,
            off_s,
            PENDING if steering_learnt else PENDING_UNLEARNT,
            LAG if rolling_learnt else LAG_UNLEARNT,
        )

    def _may_have_turned_round(self, before: list[float]) -> bool:
        """Whether a command between this goal and the one before may have turned a wheel the other
        way round: where it goes now is far off, or the way back, with next to nothing in between.
        """
        goal = self._goal
        return max(map(abs, map(sub, goal[: self._n], before))) > EITHER_RAD or any(
            goal[at] * before[at] < 0.0 for at in self._both
        )

    def _unknown(self, step: Step, off_s: float) -> Target:
        fast = AS_FAST * self._steering_rate.now * step.seconds
        gap = [FAR_RAD if abs(each) > fast else 0.0 for each in step.steered]
        heading, speed, still = self._nowhere
        return Target(
            heading, heading, gap, speed, still, still, heading, _NO_TWIST, off_s, known=False
        )

    def _move(
        self, turns: list[float], hastens: list[float], dt: float, most: float
    ) -> tuple[list[float], list[float]]:
        """Headings and speeds follow the goal.

        Args:
            turns, hastens: By which they are off it, rad of each wheel and m/s of each roll row.
            dt: How long, s.
            most: By how much a steering can turn meanwhile, rad.

        Returns:
            What they were on average, and by how much steerings turned.
        """
        steering_s, rolling_s = self._lags.used_s
        before = self._state
        share, lag = math.expm1(-dt / steering_s), steering_s / dt
        turned = [share * each for each in turns]
        off = [lag * each for each in turned]
        share, lag = math.expm1(-dt / rolling_s), rolling_s / dt
        moved = turned + [share * each for each in hastens]
        off += [lag * each for each in moved[self._n :]]
        middle = [*map(sub, self._goal, off)]
        for i, each in enumerate(turned):
            if -most <= each <= most:
                self._fast_s[i] = 0.0
            else:
                # One that turns as fast as it can is half way in the middle of a step.
                turned[i] = moved[i] = math.copysign(most, each)
                middle[i] = before[i] + 0.5 * moved[i]
                self._fast_s[i] += dt
        self._state = [*map(add, before, moved)]
        return middle, turned

    def _catch_up(self, faster: float) -> None:
        """Steerings that turn as fast as they can have done so faster, by rad/s, than was known."""
        for i, fast_s in enumerate(self._fast_s):
            off = self._goal[i] - self._state[i]
            self._state[i] += math.copysign(min(faster * fast_s, abs(off)), off)

    def _aim(self) -> None:
        """Inverse kinematics: each wheel turns to the nearer of the two directions."""
        headings, speeds, (vx, vy, omega) = self._heading, self._speed, self._twist
        pi, hypot, atan2 = math.pi, math.hypot, math.atan2
        for i, x, y in self._places:
            ux, uy = vx - omega * y, vy + omega * x
            heading = headings[i]
            speed = hypot(ux, uy)
            if speed >= STANDSTILL_M_S:
                turn = atan2(uy, ux) - heading
                halves = round(turn / pi)
                headings[i] = heading + turn - pi * halves
                speeds[i] = -speed if halves % 2 else speed
            else:
                speeds[i] = ux * math.cos(heading) + uy * math.sin(heading)
        goal = headings + [speeds[i] for i in self._rolls]
        for at, (a, b, c) in self._fixed:
            goal[self._n + at] = a * vx + b * vy + c * omega
        self._goal = goal

    def _start(self, shown: list[float], rates: list[float]) -> None:
        """The wheels do what they do; where that is not known, what they should."""
        heading = _known(shown, self._heading)
        for i, should in enumerate(self._heading):
            self._heading[i] += math.pi * round((heading[i] - should) / math.pi)
            self._turn_half_round(i, 0.0)
        self._aim()
        self._state = heading + self._goal[self._n :]
        self._state = _known(self._shown(shown, rates), self._state)
        self._lags.begin(self._state)
        self._fast_s = [0.0] * self._n
        self._known = True

    def _turn_half_round(self, wheel: int, off: float) -> None:
        """A wheel stands so far off its reference, rad: so many half turns, if it is known."""
        self._halves[wheel] = round(off / math.pi) if math.isfinite(off) else 0
        self._sign = [1.0 - 2.0 * (self._halves[i] % 2) for i in self._rolls]

    def _shown(self, heading: list[float], rates: list[float]) -> list[float]:
        """Headings and rolling speeds as the state has them, but measured."""
        shown = self._state[: self._n]  # one that does not steer stands as it should
        for i in self._steered:
            shown[i] = heading[i] - math.pi * self._halves[i]
        shown += [
            rates[i] * radius * sign
            for i, radius, sign in zip(self._rolls, self._radius, self._sign, strict=True)
        ]
        return shown

    def _learn(
        self, heading: list[float], step: Step, learnt_s: float, tells: tuple[bool, bool]
    ) -> None:
        """Which lags the measurements follow; ``tells``: steering, and rolling."""
        shown = self._shown(heading, step.wheel_rate)
        self._lags.learn(shown, learnt_s, tells, slowed=max(self._envelope) > ALIGNED_RAD)
        self._state = self._lags.choose(self._state)


def _tells(gap: list[float]) -> bool:
    """Whether drives are so far off their command, rad or m/s, that they tell of their lag."""
    return bool(gap) and (max(gap) > TELLS or min(gap) < -TELLS)


def _known(measured: list[float], should: list[float]) -> list[float]:
    """What is measured, and where that is not a number, what should be."""
    return [
        does if math.isfinite(does) else told for does, told in zip(measured, should, strict=True)
    ]
