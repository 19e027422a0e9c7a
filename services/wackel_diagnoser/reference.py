"""What the wheels should do: the commanded twist through inverse kinematics and the drives' lag.

Nobody states how quickly his drives follow. So several lags run side by side, for steering and for
rolling, and the one that the measurements follow best is used.
"""

import math
from collections import deque
from typing import NamedTuple

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
FASTEST = 20.0
"""m/s and rad/s; no robot on servos does more, and nothing larger is a command."""
_MOST_WAITING = 64


class Target(NamedTuple):
    """What the wheels should have done in a step; NaN where it is not known.

    Attributes:
        heading: Direction of each wheel, rad to the left of forward, shape (n,); not wrapped, on
            the side on which the wheel stands.
        heading_gap: How far that still was from the command, rad.
        speed: Rolling speed of each roll row, m/s.
        speed_gap: How far that still was from the command, m/s.
        goal: Commanded headings, on the side on which each wheel stands.
        twist: Commanded.
    """

    heading: Floats
    heading_gap: Floats
    speed: Floats
    speed_gap: Floats
    goal: Floats
    twist: Floats


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
        self._roll_wheels = drive.roll_wheels
        self._rolls = drive.roll_wheels.tolist()
        self._radius = drive.roll_radius
        self._fixed_roll = drive.rows(drive.steering(np.zeros(n)))[drive.slide_count :]
        self._roll_steers = drive.steers[drive.roll_wheels]
        self._all_steer = bool(self._roll_steers.all())
        self._waiting: deque[tuple[int, Floats]] = deque(maxlen=_MOST_WAITING)
        self._current: tuple[int, Floats] | None = None
        mounted = [wheel.heading for wheel in config.wheels]
        self._heading = list(mounted)
        self._speed = [0.0] * n
        # Headings of all wheels, then speeds of the roll rows; a row for each lag.
        self._goal = np.zeros(n + len(drive.roll_wheels))
        self._state = np.zeros((len(LAGS_S), len(self._goal)))
        self._known = False
        self._turn_half_round(np.zeros(n))
        self._envelope = np.zeros(n)
        # Which of the state are headings, which speeds.
        self._kinds = np.repeat(np.eye(2), (n, len(drive.roll_wheels)), axis=0)
        self._misses = np.zeros((2, len(LAGS_S)))
        self._chosen = [3, 3]
        self._since_choice = 0.0
        self._steering_rate = LEAST_STEERING_RATE
        self._turned_before = [0.0] * n
        self._unknown = Target(
            np.full(drive.n, np.nan),
            np.zeros(drive.n),
            np.full(len(drive.roll_wheels), np.nan),
            np.zeros(len(drive.roll_wheels)),
            np.full(drive.n, np.nan),
            np.full(3, np.nan),
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
        self._waiting.append((message.stamp, np.array(twist)))
        return True

    def forget(self) -> None:
        """Time was started anew."""
        self._waiting.clear()
        self._current = None
        self._known = False

    def step(self, step: Step, learnt_s: float) -> Target:
        """What the wheels should have done in a step.

        Args:
            step: What they did.
            learnt_s: For how much driving without a fault it stands; 0: nothing can be learnt.
        """
        while self._waiting and self._waiting[0][0] <= step.begin:
            self._current = self._waiting.popleft()
            self._aim(self._current[1])
        current = self._current
        if current is None or not 0 <= step.begin - current[0] <= FRESH_NS:
            self._known = False
            return self._unknown
        if not self._known:
            self._start(step)
        dt, n = step.seconds, self._n
        reached = -np.expm1(-dt / LAGS_S)
        state = self._state
        # The measured heading may be that of the same wheel turned half round and rolling back.
        halves = np.rint((step.heading - state[self._chosen[0], :n]) * (1 / math.pi))
        if halves.tolist() != self._halves:  # hardly ever, or what is not known
            self._turn_half_round(halves)
        half_turns, sign = self._half_turns, self._sign
        self._learn_steering_rate(step)
        gap = self._goal - state
        moved = reached * gap
        middle = gap - LAGS_S / dt * moved
        most = self._steering_rate * dt
        turned = moved[:, :n]
        angles = turned.ravel().tolist()
        if max(angles) > most or min(angles) < -most:
            # One that turns as fast as it can is half way in the middle of a step.
            limited = np.minimum(np.maximum(turned, -most), most)
            middle[:, :n] = np.where(limited == turned, middle[:, :n], 0.5 * limited)
            moved[:, :n] = limited
        middle += state
        state += moved
        if learnt_s:
            self._learn(step, learnt_s, middle)
        steering, rolling = self._chosen
        envelope = np.abs(gap[steering, :n])
        self._envelope *= math.exp(-dt / SETTLING_S)
        self._envelope = np.maximum(envelope, self._envelope)
        return Target(
            middle[steering, :n] + half_turns,
            self._envelope,
            sign * middle[rolling, n:],
            gap[rolling, n:],
            self._goal[:n] + half_turns,
            current[1],
        )

    def _aim(self, twist: Floats) -> None:
        """Inverse kinematics: each wheel turns to the nearer of the two directions.

        Single numbers: for some wheels, Python is several times faster with them than numpy.
        """
        vx, vy, omega = twist.tolist()
        headings, speeds = self._heading, self._speed
        for i, (x, y, steers) in enumerate(self._places):
            ux, uy = vx - omega * y, vy + omega * x
            heading = headings[i]
            if steers and math.hypot(ux, uy) >= STANDSTILL_M_S:
                turn = math.atan2(uy, ux) - heading
                headings[i] = heading = heading + turn - math.pi * round(turn / math.pi)
            speeds[i] = ux * math.cos(heading) + uy * math.sin(heading)
        goal = self._goal
        goal[:] = headings + [speeds[i] for i in self._rolls]
        if not self._all_steer:
            fixed = self._fixed_roll @ twist
            goal[self._n :] = np.where(self._roll_steers, goal[self._n :], fixed)

    def _start(self, step: Step) -> None:
        """The wheels are where they are; where they are not known, where they should be."""
        known = np.isfinite(step.heading)
        heading = np.where(known, step.heading, self._heading)
        half = np.round((heading - self._heading) / math.pi)
        self._heading = (np.array(self._heading) + math.pi * half).tolist()
        assert self._current is not None
        self._aim(self._current[1])
        self._state[:] = np.concatenate([heading, self._goal[self._n :]])
        self._known = True

    def _turn_half_round(self, halves: Floats) -> None:
        """Each wheel stands so many half turns from its reference, where it is known."""
        halves = np.where(np.isfinite(halves), halves, 0.0)
        self._halves: list[float] = halves.tolist()
        self._half_turns = halves * math.pi
        self._sign = 1.0 - 2.0 * (halves.take(self._roll_wheels) % 2.0)

    def _learn_steering_rate(self, step: Step) -> None:
        """How fast the steering can turn: whatever is wrong, as one has turned, so it can; but a
        reading that jumps, which lasts one step, is no turn."""
        # Single numbers: for some wheels, Python is faster with them than numpy.
        seconds, before = step.seconds, self._turned_before
        turned = self._turned_before = [abs(angle) / seconds for angle in step.steered.tolist()]
        for now, then in zip(turned, before, strict=True):
            # NaN is not greater than anything.
            if now > self._steering_rate < then and min(now, then) <= FASTEST:
                self._steering_rate = min(now, then)

    def _learn(self, step: Step, learnt_s: float, middle: Floats) -> None:
        """Which lag the measurements follow."""
        off = np.concatenate(
            (
                step.heading - self._half_turns,
                step.wheel_rate.take(self._roll_wheels) * self._radius * self._sign,
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
            self._chosen = self._misses.argmin(axis=1).tolist()
