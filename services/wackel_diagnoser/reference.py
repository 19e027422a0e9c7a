"""What the wheels should do: the commanded twist through inverse kinematics and the drives' lag.

Nobody states how quickly his drives follow. So several lags run side by side, for steering and for
rolling; the one that the measurements follow best is used, refined by how well its neighbours do.
"""

import math
from collections import deque
from typing import NamedTuple, TypeAlias

import numpy as np

from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.inverse import STANDSTILL_M_S
from wackel_node.config_drive import DriveConfig
from wackel_schemas.drive import TwistCommand

LAGS_S = np.array([0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.05, 0.065, 0.08, 0.1, 0.12, 0.16, 0.2])
"""That are tried: from a stiff servo to a heavy wheel in a soft loop."""
FIRST = 6
"""Number of the one that is taken first."""
SETTLING_S = 0.15
"""A servo that turns as fast as it can takes longer than its lag: a quarter turn at 60 rev/min
0.25 s."""
LEAST_STEERING_RATE = 2.0
"""rad/s that every steering reaches; how much faster this one is, driving shows."""
FRESH_NS = 500_000_000
"""A command older than this is no longer what drives the robot."""
TELLS = 0.01
"""m/s and rad that a drive or a steering must still be off the command to tell of its lag; at rest,
and at an even speed, nothing is learnt, and nothing forgotten."""
MEMORY_S = 10.0
"""Of what tells, in which the lag is learnt."""
CHOOSE_S = 0.5
"""Of that from choice to choice: a single change of speed, in which drives wait for their steering,
does not decide."""
CLEARER = 0.7
"""Of the squares that the present lag misses, what another must miss at most. Lags that miss alike
will do alike."""
ALIGNED_RAD = 0.1
SLOWED = 0.35
"""The same of what was missed while a wheel had to turn by more than that, for a longer lag of
rolling: wheels that point elsewhere slow each other down, which is no lag of theirs."""
FASTEST = 20.0
"""m/s and rad/s; no robot on servos does more, and nothing larger is a command."""
_MOST_WAITING = 64
_QUARTER = math.pi / 2  # of a turn

Twist: TypeAlias = tuple[float, float, float]


class Target(NamedTuple):
    """What the wheels should have done in a step; NaN where it is not known.

    Attributes:
        heading: Direction of each wheel, rad to the left of forward, shape (n,); not wrapped, on
            the side on which the wheel stands.
        turned: How far each was steered meanwhile, rad, shape (n,).
        heading_gap: How far the heading still was from the command, rad, of each wheel.
        speed: Rolling speed of each roll row, m/s.
        speed_gap: How far that still was from the command, m/s, of each roll row.
        speed_late: Derivative of that by the logarithm of the lag: a tenth of it is by how much the
            speed would be another if the drive lagged a tenth more or less.
        goal: Commanded headings, on this side or half a turn round.
        twist: Commanded.
        known: Whether there is a command to follow.
    """

    heading: Floats
    turned: Floats
    heading_gap: list[float]
    speed: Floats
    speed_gap: list[float]
    speed_late: list[float]
    goal: Floats
    twist: Floats
    known: bool = True


class Reference:
    """Follows the commands.

    Args:
        layout: The drive.
        config: The same, as configured.
    """

    def __init__(self, layout: Layout, config: DriveConfig) -> None:
        drive = layout.drive
        self._n = n = drive.n
        self._places = [
            (*place, bool(steers))
            for place, steers in zip(drive.xy.tolist(), drive.steers, strict=True)
        ]
        self._steered: list[int] = np.flatnonzero(drive.steers).tolist()
        self._roll_wheels = drive.roll_wheels
        self._rolls = drive.roll_wheels.tolist()
        self._radius = drive.roll_radius
        self._fixed_roll = drive.rows(drive.steering(np.zeros(n)))[drive.slide_count :]
        self._roll_steers = drive.steers[drive.roll_wheels]
        self._all_steer = bool(self._roll_steers.all())
        self._waiting: deque[tuple[int, Twist]] = deque(maxlen=_MOST_WAITING)
        self._since: int | None = None  # when what is commanded now was
        self._twist = np.zeros(3)
        mounted = [wheel.heading for wheel in config.wheels]
        self._heading = list(mounted)
        self._speed = [0.0] * n
        # Headings of all wheels, then speeds of the roll rows; a row for each lag that is tried,
        # and the last one for those that are used.
        self._goal = np.zeros(n + len(drive.roll_wheels))
        self._state = np.zeros((len(LAGS_S) + 1, len(self._goal)))
        self._lags_s = np.repeat(np.append(LAGS_S, LAGS_S[FIRST])[:, None], len(self._goal), axis=1)
        self._known = False
        # What the states are off what wheels show that stand the other way round.
        self._half_turns = np.zeros(len(self._goal))
        self._sign = np.ones(len(self._goal))
        self._turn_half_round(np.zeros(n))
        self._envelope = [0.0] * n
        self._late = [0.0] * len(self._rolls)
        # Which of the state are headings, which speeds.
        self._kinds = np.repeat(np.eye(2), (n, len(drive.roll_wheels)), axis=0)
        # Of steering and of rolling; and of the latter those while wheels turned.
        self._misses = np.zeros((2, len(LAGS_S)))
        self._slowed = np.zeros(len(LAGS_S))
        self._chosen = [FIRST, FIRST]
        self._since_choice = 0.0
        self._steering_rate = LEAST_STEERING_RATE
        self._turned_before = [0.0] * n, 1.0  # rad, s
        self._unknown = Target(
            np.full(drive.n, np.nan),
            np.full(drive.n, np.nan),
            [0.0] * drive.n,
            np.full(len(drive.roll_wheels), np.nan),
            [0.0] * len(drive.roll_wheels),
            [0.0] * len(drive.roll_wheels),
            np.full(drive.n, np.nan),
            np.full(3, np.nan),
            known=False,
        )

    @property
    def lags_s(self) -> tuple[float, float]:
        """Of steering and of rolling, as learnt."""
        return float(self._lags_s[-1, 0]), float(self._lags_s[-1, -1])

    def command(self, message: TwistCommand) -> bool:
        """Takes in a command; says whether it can be one."""
        twist = (message.vx, message.vy, message.omega)
        if not all(abs(value) <= FASTEST for value in twist):
            return False
        newest = self._waiting[-1][0] if self._waiting else None
        if newest is not None and message.stamp <= newest:
            self._waiting.clear()  # time was set back; what waits belongs to another
        self._waiting.append((message.stamp, twist))
        return True

    def forget(self) -> None:
        """Time was started anew."""
        self._waiting.clear()
        self._since = None
        self._known = False

    def step(self, step: Step, learnt_s: float) -> Target:
        """What the wheels should have done in a step.

        Args:
            step: What they did.
            learnt_s: For how much driving without a fault it stands; 0: nothing can be learnt.
        """
        while self._waiting and self._waiting[0][0] <= step.begin:
            self._since, twist = self._waiting.popleft()
            self._twist = np.array(twist)
            self._aim(*twist)
        since = self._since
        if since is None or not 0 <= step.begin - since <= FRESH_NS:
            self._known = False
            return self._unknown
        if not self._known:
            self._start(step)
        dt, n, goal, lags_s = step.seconds, self._n, self._goal, self._lags_s
        # The measured heading may be that of the same wheel turned half round and rolling back.
        apart = step.heading - self._state[-1, :n]
        off, halves = apart.tolist(), self._halves
        if not all(-_QUARTER <= off[i] - halves[i] <= _QUARTER for i in self._steered):
            # Hardly ever, or what is not known.
            self._turn_half_round(np.rint(apart * (1 / math.pi)))
        self._learn_steering_rate(step)
        missing = self._state - goal
        moved = missing * np.expm1(-dt / lags_s)
        turned, most = moved[:, :n], self._steering_rate * dt
        held = turned.item(turned.argmax()) > most or turned.item(turned.argmin()) < -most
        change, gap = moved[-1], missing[-1].tolist()
        tells = learnt_s and (max(gap) > TELLS or min(gap) < -TELLS)
        if held or tells:
            middles = goal - lags_s / dt * moved
            if held:
                self._hold(moved, middles, most)
            middle = middles[-1]
        else:
            middle = goal - lags_s[-1] / dt * change
        self._state += moved
        if tells:
            self._learn(step, learnt_s, middles[:-1])
        fade = math.exp(-dt / SETTLING_S)
        self._envelope = [
            max(abs(now), fade * before)
            for now, before in zip(gap[:n], self._envelope, strict=True)
        ]
        lags = dt / float(lags_s[-1, -1])
        fade = math.exp(-lags)
        late = self._late = [
            fade * (before + lags * now) for now, before in zip(gap[n:], self._late, strict=True)
        ]
        if any(self._halves):
            middle *= self._sign
            middle += self._half_turns
        return Target(
            middle[:n],
            change[:n],
            self._envelope,
            middle[n:],
            [*map(abs, gap[n:])],
            [*map(abs, late)],
            goal[:n],
            self._twist,
        )

    def _hold(self, moved: Floats, middles: Floats, most: float) -> None:
        """No steering turns by more than it can.

        Args:
            moved: By how much each state would move in a step; set to what it does.
            middles: What it would be on average; likewise.
            most: rad.
        """
        n = self._n
        turned = moved[:, :n]
        limited = np.minimum(np.maximum(turned, -most), most)
        # One that turns as fast as it can is half way in the middle of a step.
        half_way = self._state[:, :n] + 0.5 * limited
        middles[:, :n] = np.where(limited == turned, middles[:, :n], half_way)
        moved[:, :n] = limited

    def _aim(self, vx: float, vy: float, omega: float) -> None:
        """Inverse kinematics: each wheel turns to the nearer of the two directions.

        Single numbers: for some wheels, Python is several times faster with them than numpy.
        """
        headings, speeds = self._heading, self._speed
        for i, (x, y, steers) in enumerate(self._places):
            ux, uy = vx - omega * y, vy + omega * x
            heading = headings[i]
            speed = math.hypot(ux, uy)
            if steers and speed >= STANDSTILL_M_S:
                turn = math.atan2(uy, ux) - heading
                halves = round(turn / math.pi)
                headings[i] = heading + turn - math.pi * halves
                speeds[i] = -speed if halves % 2 else speed
            else:
                speeds[i] = ux * math.cos(heading) + uy * math.sin(heading)
        goal = self._goal = np.array(headings + [speeds[i] for i in self._rolls])
        if not self._all_steer:
            fixed = self._fixed_roll @ (vx, vy, omega)
            goal[self._n :] = np.where(self._roll_steers, goal[self._n :], fixed)

    def _start(self, step: Step) -> None:
        """The wheels are where they are; where they are not known, where they should be."""
        known = np.isfinite(step.heading)
        heading = np.where(known, step.heading, self._heading)
        half = np.round((heading - self._heading) / math.pi)
        self._heading = (np.array(self._heading) + math.pi * half).tolist()
        self._aim(*self._twist.tolist())
        self._state[:] = np.concatenate([heading, self._goal[self._n :]])
        self._known = True

    def _turn_half_round(self, halves: Floats) -> None:
        """Each wheel stands so many half turns from its reference, where it is known."""
        halves = np.where(np.isfinite(halves), halves, 0.0)
        self._half_turns[: self._n] = halves * math.pi
        self._halves: list[float] = self._half_turns[: self._n].tolist()
        self._sign[self._n :] = 1.0 - 2.0 * (halves.take(self._roll_wheels) % 2.0)

    def _learn_steering_rate(self, step: Step) -> None:
        """How fast the steering can turn: whatever is wrong, as one has turned, so it can; but a
        reading that jumps, which lasts one step, is no turn."""
        before, self._turned_before = self._turned_before, (step.steered.tolist(), step.seconds)
        turned, seconds = self._turned_before
        most = self._steering_rate * seconds
        if max(turned) <= most and min(turned) >= -most:  # not so if the first is not known
            return
        for now, then in zip(turned, before[0], strict=True):
            rates = abs(now) / seconds, abs(then) / before[1]
            if rates[0] > self._steering_rate < rates[1] and min(rates) <= FASTEST:
                self._steering_rate = min(rates)

    def _followed(self) -> list[int]:
        """Lags of steering and rolling: others than now only where they are clearly followed."""
        best = self._misses.argmin(axis=1).tolist()
        _, rolling = self._chosen
        slowed = float(self._slowed[rolling]) if best[1] > rolling else 0.0
        return [
            lag if misses[lag] < CLEARER * misses[now] - less else now
            for lag, now, misses, less in zip(
                best,
                self._chosen,
                self._misses.tolist(),
                (0.0, (CLEARER - SLOWED) * slowed),
                strict=True,
            )
        ]

    def _choose(self) -> None:
        """Takes the lags that are followed as those of the drive."""
        chosen, n = self._followed(), self._n
        for kind, part in enumerate((slice(n), slice(n, None))):
            now = chosen[kind]
            if now != self._chosen[kind]:
                self._state[-1, part] = self._state[now, part]
            misses = self._misses[kind] - self._slowed if kind else self._misses[kind]
            self._lags_s[-1, part] = _refined(misses, now)
        self._chosen = chosen

    def _learn(self, step: Step, learnt_s: float, middle: Floats) -> None:
        """Which lag the measurements follow."""
        off = np.concatenate(
            (
                step.heading - self._half_turns[: self._n],
                step.wheel_rate.take(self._roll_wheels) * self._radius * self._sign[self._n :],
            )
        )
        off = off - middle
        squares = np.minimum(off * off, 0.01)
        fade = 1.0 - learnt_s / MEMORY_S
        self._misses *= fade
        self._slowed *= fade
        added = squares @ self._kinds
        if math.isfinite(float(added.sum())):
            self._misses += added.T
            if max(self._envelope) > ALIGNED_RAD:
                self._slowed += added[:, 1]
        self._since_choice += learnt_s
        if self._since_choice >= CHOOSE_S:
            self._since_choice = 0.0
            self._choose()


def _refined(misses: Floats, at: int) -> float:
    """Lag where a parabola through the misses of one that is tried and its neighbours is lowest, s;
    no further off than half way to them."""
    if not 0 < at < len(LAGS_S) - 1:
        return float(LAGS_S[at])
    left, here, right = LAGS_S[at - 1 : at + 2].tolist()
    before, now, after = misses[at - 1 : at + 2].tolist()
    falls, rises = (now - before) / (here - left), (after - now) / (right - here)
    first, last = 0.5 * (left + here), 0.5 * (here + right)
    if not rises > falls:
        return float(here)
    lowest = first - falls * (last - first) / (rises - falls)
    return float(min(max(lowest, first), last))
