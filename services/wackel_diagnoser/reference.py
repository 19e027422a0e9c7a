"""What the wheels should do: the commanded twist through inverse kinematics and the drives' lag.

Nobody states how quickly his drives follow. So several lags run side by side, for steering and for
rolling, and the one that the measurements follow best is used.
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

LAGS_S = np.array([0.005, 0.015, 0.03, 0.05, 0.08, 0.12, 0.2])[:, None]
"""From a stiff servo to a heavy wheel in a soft loop; neighbours differ by what hardly matters."""
SETTLING_S = 0.15
"""A servo that turns as fast as it can takes longer than its lag: a quarter turn at 60 rev/min
0.25 s."""
LEAST_STEERING_RATE = 2.0
"""rad/s that every steering reaches; how much faster this one is, driving shows."""
FRESH_NS = 500_000_000
"""A command older than this is no longer what drives the robot."""
MEMORY_S = 10.0
"""In which the lag is learnt."""
CHOOSE_S = 0.5
CLEARER = 0.7
"""Of the squares that the present lag misses, what another must miss at most: after a rest a single
start decides, in which drives wait for their steering. Lags that miss alike will do alike."""
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
        goal: Commanded headings, on this side or half a turn round.
        twist: Commanded.
        known: Whether there is a command to follow.
    """

    heading: Floats
    turned: Floats
    heading_gap: list[float]
    speed: Floats
    speed_gap: list[float]
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
        # Headings of all wheels, then speeds of the roll rows; a row for each lag.
        self._goal = np.zeros(n + len(drive.roll_wheels))
        self._state = np.zeros((len(LAGS_S), len(self._goal)))
        self._known = False
        # What the states are off what wheels show that stand the other way round.
        self._half_turns = np.zeros(len(self._goal))
        self._sign = np.ones(len(self._goal))
        self._turn_half_round(np.zeros(n))
        self._envelope = [0.0] * n
        # Which of the state are headings, which speeds.
        self._kinds = np.repeat(np.eye(2), (n, len(drive.roll_wheels)), axis=0)
        self._misses = np.zeros((2, len(LAGS_S)))
        self._choose(3, 3)
        self._since_choice = 0.0
        self._steering_rate = LEAST_STEERING_RATE
        self._turned_before = [0.0] * n, 1.0  # rad, s
        self._unknown = Target(
            np.full(drive.n, np.nan),
            np.full(drive.n, np.nan),
            [0.0] * drive.n,
            np.full(len(drive.roll_wheels), np.nan),
            [0.0] * len(drive.roll_wheels),
            np.full(drive.n, np.nan),
            np.full(3, np.nan),
            known=False,
        )

    @property
    def lags_s(self) -> tuple[float, float]:
        """Of steering and of rolling, as learnt."""
        steering, rolling = self._chosen
        return float(LAGS_S[steering, 0]), float(LAGS_S[rolling, 0])

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
        dt, n, goal, picked = step.seconds, self._n, self._goal, self._picked
        # The measured heading may be that of the same wheel turned half round and rolling back.
        apart = step.heading - self._state.take(self._picked_headings)
        off, halves = apart.tolist(), self._halves
        if not all(-_QUARTER <= off[i] - halves[i] <= _QUARTER for i in self._steered):
            # Hardly ever, or what is not known.
            self._turn_half_round(np.rint(apart * (1 / math.pi)))
        self._learn_steering_rate(step)
        missing = self._state - goal
        moved = missing * np.expm1(-dt / LAGS_S)
        turned, most = moved[:, :n], self._steering_rate * dt
        held = turned.item(turned.argmax()) > most or turned.item(turned.argmin()) < -most
        if held or learnt_s:
            middles = goal - LAGS_S / dt * moved
            if held:
                self._hold(moved, middles, most)
            if learnt_s:
                self._learn(step, learnt_s, middles)
                picked = self._picked
            middle, change = middles.take(picked), moved.take(picked)
        else:
            change = moved.take(picked)
            middle = goal - self._lag_s / dt * change
        self._state += moved
        gap, fade = [*map(abs, missing.take(picked).tolist())], math.exp(-dt / SETTLING_S)
        self._envelope = [
            max(now, fade * before) for now, before in zip(gap[:n], self._envelope, strict=True)
        ]
        if any(self._halves):
            middle *= self._sign
            middle += self._half_turns
        return Target(
            middle[:n], change[:n], self._envelope, middle[n:], gap[n:], goal[:n], self._twist
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
        return [
            lag if misses[lag] < CLEARER * misses[now] else now
            for lag, now, misses in zip(best, self._chosen, self._misses.tolist(), strict=True)
        ]

    def _choose(self, steering: int, rolling: int) -> None:
        """Takes lags as those of the drive."""
        rolls, width = len(self._rolls), len(self._goal)
        rows = np.repeat((steering, rolling), (self._n, rolls))
        self._chosen = steering, rolling
        self._picked = rows * width + np.arange(width)
        self._picked_headings = self._picked[: self._n]
        self._lag_s = LAGS_S[rows, 0]

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
        self._misses *= 1.0 - learnt_s / MEMORY_S
        added = squares @ self._kinds
        if math.isfinite(float(added.sum())):
            self._misses += added.T
        self._since_choice += learnt_s
        if self._since_choice >= CHOOSE_S:
            self._since_choice = 0.0
            self._choose(*self._followed())
