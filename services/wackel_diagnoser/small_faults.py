"""Small faults: changes of what is constant in a sound robot.

A wheel that shows 3 % too much, or a steering half a degree off, drowns in what tyres and drives do
from step to step. But it lasts, and calibration does not change by itself. So what has been learnt
of the robot's constants (:mod:`wackel_diagnoser.constants`) is held against the last seconds; a
fault is a change that a single part explains. What this motion does not show changes nothing.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from operator import mul
from typing import NamedTuple

import numpy as np

from wackel_diagnoser.constants import GIVES_WAY, Constants, Shown
from wackel_diagnoser.hypotheses import Class
from wackel_diagnoser.rows import UNKNOWN, YAWING, Following, Rows
from wackel_diagnoser.scaling import Scaling
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas import component

BLOCK_S = 0.1
"""Of a mean: encoder steps cancel, and wheels hardly turn."""
LEAST_STEPS = 2
LOOK_S = 0.3
WINDOWS = (3, 12, 33)
"""Looks in which a change is sought: what is clear is named in seconds, what is hardly larger than
the tyres' slip in ten."""
DELAY = WINDOWS[-1]
"""Looks after which what was seen counts as normal, if nothing is suspected by then."""
EARLIEST_S = -0.005
LATEST_S = 0.03
"""By how much wheels may follow later than encoders show: gears are stiffer; stamps may be late."""
MOVING_M_S = 0.05
NORMAL_S = 600.0
"""Over which the normal is forgotten: a gyro's bias and a floor change."""
SURE = 36.0
"""Square of how many standard deviations a change must have. Chance alone makes five in an hour in
3e-7 of them; slip is not quite normally distributed, hence six."""
LARGEST = 0.9
"""Share, rad or rad/s: a sensor that shows half as much seems 0.6 off, one that stands 1.0. What a
wheel that stands or points elsewhere makes the others show is no change of a constant."""
SUSPECTED = 16.0
"""The same from which on nothing is learnt."""
CLEAR = 6.0
"""Logarithm of how much likelier the part must be than any other."""
UNEXPLAINED = 0.2
"""Share of the evidence that may be left when the part has explained its own: of more than one
part's, or of what is no change of constants, this knows nothing."""
SHOCKED = 2
"""Looks that a shock may spoil, if it falls between them."""
AGREE = 3
"""Looks in a row that must name the same: those that a shock spoilt leave the first window."""
SURER = 3.0
"""Logarithm of how much likelier another kind must be."""
FORCED = 0.7
"""Share of what calibration makes wheels contradict each other that shows otherwise in another
motion: which of them slip, friction decides, and how that turns the robot. From 0.5 on, robots that
drive circle after circle are not accused; at 1, one jump in fifty of a gyro by 0.02 rad/s to 0.03
is missed."""
ANOTHER_RAD = 0.5
"""Angle in the space of velocities (a yaw rate as a wheel's speed by it) at which a motion is
another one, in which other wheels slip. The same way back is none: all slips turn round."""
YIELDS = 0.2
"""Share by which a wheel slips whose motor is too fast, 0.1 to 0.3; drives give way by the rest."""
ACCURATE = {
    "direction": 0.001,
    "scale": 0.002,
    "gyro": 0.0015,
    "off": 0.002,
    "stands": 0.0005,
}
"""By how much constants change in a sound robot, all at once: with load, tyres' warmth, and
floor."""

SHIFTS = 0.5
"""Share of the wheels' calibration by which that seems to change with the motion: which of them
slip, friction decides."""
NOISE = 0.01
"""Share of the currents' squares that is noise: they sway by 5 mA, of 50 that driving needs."""
TINY = 1e-9
"""Share of what is known before driving that is as good as nothing."""
ROUNDED = 0.3
"""Encoder steps, the same for what stays rounded alike: 1/√12."""


@dataclass(frozen=True)
class Change:
    """A change that one part explains.

    Attributes:
        component: The part.
        kind: As far as it can be told.
        size: By how much: share, rad or rad/s.
        sigma: Standard deviation of that.
    """

    component: str
    kind: Class
    size: float
    sigma: float


class _Look(NamedTuple):
    """What has been seen in some blocks.

    Attributes:
        told: Normal equations: information and, in the last column, right side, shape (P, P + 1).
        creep: Of all wheels, m/s.
        another: How much of another motion has begun with it, 0 … 1.
        odd: Whether that is what noise hardly says.
    """

    told: Floats
    creep: float
    another: float
    odd: bool


class SmallFaults:
    """Looks for them.

    Args:
        layout: The drive.
        config: The same, as configured.
        rows: How measurements are numbered.
        gyros: By name.

    Attributes:
        found: The change that is there.
        lag_s: By how much wheels follow later than their steering's encoders show, as learnt.
        following: How drives follow their references, as learnt.
        calibration: Squares of the shares by which slide and roll rows (of speed) and gyros (of
            their rate) are expected to be off, by what driving has shown.
        follows: The same of what drives are faster than their references, beyond ``following``,
            shape (roll rows,). One that has hardly rolled yet may be so by anything.
    """

    def __init__(
        self, layout: Layout, config: DriveConfig, rows: Rows, gyros: Mapping[str, GyroConfig]
    ) -> None:
        constants = self._constants = Constants(layout, config, rows, gyros)
        self._paths, self._kinds, self._changes = _hypotheses(layout, constants, gyros)
        accurate = np.zeros(constants.count)
        for name, least in ACCURATE.items():
            accurate[getattr(constants, name)] = least
        # A steering that stays where it is stays off what its encoder shows.
        rounded = [*constants.direction, *constants.stands]
        accurate[rounded] = np.maximum(accurate[rounded], ROUNDED * config.encoder_step)
        self._accurate: Floats = np.diag(accurate**2)
        creeping = np.zeros(constants.count)  # variances, by the square of how much tyres creep
        creeping[constants.gyro] = (YAWING / layout.drive.length_m) ** 2
        self._creeping: Floats = np.diag(creeping)
        self._prior = np.diag(constants.prior)
        self._presumed = np.zeros(constants.count)  # right side of that
        self._drives = drives = slice(constants.off.start, constants.stands.start)
        self._drives_prior = self._prior[drives, drives].copy()
        self._drives_prior[constants.gives_way - drives.start] *= TINY
        # By parameter: only rows on the twist contradict each other, less the three that it takes.
        self._forced = np.zeros(constants.count)
        self._forced[constants.kinds[0]] = FORCED**2
        self._forced /= max(rows.gyros.stop - 3, 1)
        self._scaling = Scaling(np.full(constants.count, 2.0), least=0.05)
        # Takes means over parameters of the same kind.
        self._alike = np.zeros((constants.count, constants.count))
        for kind in constants.kinds:
            self._alike[kind, kind] = 1.0 / len(self._forced[kind])
        self._normal = np.zeros((constants.count, constants.count + 1))
        self._usual = np.zeros(constants.count)
        self._driven = 0
        self._length_m = layout.drive.length_m
        self._way: list[float] | None = None  # of the last motion, in the space of velocities
        self._motions = 1.0  # in what has been learnt
        self.lag_s = 0.0
        self.following = rows.following
        self._configured = rows.configured
        self.calibration: Floats = UNKNOWN**2 * rows.configured
        self.follows: Floats = np.zeros(len(constants.off))
        # Where each of them stands; how gyros and wheels disagree on turning is one for all gyros.
        self._wheels = constants.gyro.start
        turning = constants.askew.stop - 1
        self._calibrated = np.array([*range(self._wheels), *[turning] * len(gyros)])
        self.forget()

    def forget(self) -> None:
        """What was seen of late belongs to another time, or to another fault."""
        self.found: Change | None = None
        self._before: list[str] = []
        self._block: list[Shown] = []
        self._blocks: list[list[Shown]] = []
        self._block_s = self._look_s = self._crept = 0.0
        self._looks: deque[_Look] = deque()
        # Of each window, sums of what its looks say.
        self._told = np.zeros((len(WINDOWS), *self._normal.shape))
        self._creep = [0.0] * len(WINDOWS)
        self._motions_told = [1.0] * len(WINDOWS)

    def step(self, shown: Shown, *, calm: bool) -> None:
        """Takes in a step; ``calm``: nothing is suspected otherwise."""
        self._block.append(shown)
        self._block_s += shown.step.seconds
        if self._block_s < BLOCK_S or len(self._block) < LEAST_STEPS:
            return
        self._blocks.append(self._block)
        self._look_s += self._block_s
        self._crept += shown.measured.creep * self._block_s
        self._block, self._block_s = [], 0.0
        if self._look_s >= LOOK_S:
            # Without driving, no more is known of it; references take another from time to time.
            late = self._constants.late
            self._presumed[late] = self._prior[late, late] * shown.drive_lag_s
            # Of all its blocks at once: numpy takes long to be called.
            told = self._constants.equations(self._blocks)
            seconds, creep = self._look_s, self._crept / self._look_s
            self._blocks, self._look_s, self._crept = [], 0.0, 0.0
            moving = shown.measured.speed > MOVING_M_S
            another = self._begun(shown.measured.followed)
            self._take(told, creep, another, seconds, calm=calm, moving=moving)
            if calm:
                self._follow(shown.drive_lag_s)

    def _follow(self, drive_lag_s: float) -> None:
        """How drives follow references, which have this lag."""
        constants, usual = self._constants, self._usual.tolist()
        off = usual[constants.off.start : constants.off.stop]
        gives_way = usual[constants.gives_way]
        late_s = usual[constants.late] - drive_lag_s
        self.following = Following(off, gives_way, late_s)

    def _begun(self, twist: list[float]) -> float:
        """How much of another motion the robot has begun since the last look, 0 … 1."""
        vx, vy, omega = twist
        way = vx, vy, omega * self._length_m
        speed = math.hypot(*way)
        if not speed > MOVING_M_S:  # as one that is not known
            return 0.0
        before, self._way = self._way, [each / speed for each in way]
        if before is None:
            return 0.0
        along = abs(sum(map(mul, before, self._way)))
        return min(math.acos(min(along, 1.0)) / ANOTHER_RAD, 1.0)

    def _take(
        self,
        told: Floats,
        creep: float,
        another: float,
        seconds: float,
        *,
        calm: bool,
        moving: bool,
    ) -> None:
        """Looks once."""
        normal, scaling = self._normal, self._scaling
        known = normal / (1.0 + self._forced_slip(normal, self._usual) / self._motions)[:, None]
        covariance: Floats = np.asarray(np.linalg.inv(known[:, :-1] + self._prior))
        usual = self._usual = covariance @ (known[:, -1] + self._presumed)
        at = self._constants.gives_way
        if usual[at] < 0.0:
            # No drive runs ahead of its load: with none that gives way, the rest is otherwise, too.
            usual -= covariance[:, at] * (usual[at] / covariance[at, at])
            usual[at] = 0.0  # not what rounding leaves
        information = told[:, :-1]
        off, of_it = told[:, -1] - information @ usual, information.diagonal()
        squares = (
            off * off / np.maximum(of_it + np.vecdot(information @ covariance, information), 1e-9)
        )
        heard = of_it > 1e-3 * self._constants.prior
        told /= (self._alike @ scaling.factors)[:, None]
        odd = max(squares.tolist()) > SURE * max(scaling.factors.tolist())
        look = _Look(told, creep, another, odd)
        young = self._driven < DELAY
        if young:
            if calm and not look.odd:
                self._learn(look, seconds)
                self._driven += moving
            top = 0.0
        else:
            self._add(look)
            top = self._search(usual, covariance)
            if len(self._looks) > DELAY:
                old = self._looks.popleft()
                if calm and top < SUSPECTED and not old.odd:
                    self._learn(old, seconds)
        if calm and top < SUSPECTED:
            scaling.learn(squares, heard, seconds)
            self.lag_s = min(max(float(usual[self._constants.steering_lag]), EARLIEST_S), LATEST_S)
            # Readings of a robot agree with each other even where its wheels are pulled askew: to
            # take off what is learnt would turn its errors into contradictions.
            expected = (usual * usual + covariance.diagonal()).take(self._calibrated)
            self.calibration = np.maximum(expected, self._configured)
            self.follows = covariance.diagonal().take(self._constants.off)

    def _forced_slip(self, told: Floats, usual: Floats) -> Floats:
        """Variance of the slip that calibration forces, by that of noise, for each parameter.

        It does not become less with time: as long as the motion is the same, so is the slip. Where
        motions are several, it is so much less.

        Args:
            told: Normal equations, shape (..., P, P + 1).
            usual: Shape (P,).
        """
        errors, wheels = usual[: self._wheels], self._wheels
        contradiction = np.vecdot(told[..., :wheels, :wheels] @ errors, errors)
        return np.asarray(contradiction[..., None] * self._forced)

    def _learn(self, look: _Look, seconds: float) -> None:
        kept = 1.0 - min(1.0, seconds / NORMAL_S)
        self._normal *= kept
        self._normal += look.told
        self._motions = max(kept * self._motions + look.another, 1.0)

    def _add(self, look: _Look) -> None:
        """To the windows, from which others fall out."""
        self._looks.append(look)
        self._told += look.told
        for at, length in enumerate(WINDOWS):
            self._creep[at] += look.creep
            self._motions_told[at] += look.another
            if len(self._looks) > length:
                old = self._looks[-1 - length]
                told = self._told[at]
                told -= old.told
                self._creep[at] -= old.creep
                self._motions_told[at] -= old.another

    def _search(self, usual: Floats, covariance: Floats) -> float:
        """Follows what is found; returns the square of the surest change, by its variance."""
        top, found, now = 0.0, self.found, None
        # Wheels creep alike as long as they are loaded: no longer window averages that out.
        creep = [
            [[(each / length) ** 2]] for each, length in zip(self._creep, WINDOWS, strict=True)
        ]
        # At an even speed the currents' noise makes drives seem not to give way, ever more surely.
        # So what was learnt of that is as little known as before driving, and all that was
        # concluded with it; and what a window says of it is diluted by itself.
        at = self._constants.gives_way
        with_it = GIVES_WAY * covariance[:, at] / covariance[at, at]
        unsure = covariance + with_it[:, None] * with_it + self._accurate + creep * self._creeping
        unsure[:, self._drives, self._drives] += self._dilution(usual)
        errors, wheels = usual[: self._wheels], range(self._wheels)
        unsure[:, wheels, wheels] += SHIFTS**2 * errors.dot(errors) / self._wheels
        forced = self._forced_slip(self._told, usual) / np.array(self._motions_told)[:, None]
        tests = _Tests(self._changes, self._told, usual, unsure, forced)
        if found is not None and self._ended(tests, found):
            self.forget()
            return float(tests.sure[0].max())
        for at, best in enumerate(tests.best):
            top = max(top, float(tests.sure[at, best]))
            if abs(tests.size[at, best]) > LARGEST:
                break  # longer windows have it in them, and seem to show something smaller
            now = now or self._name(tests, at, best)
        if found is None:
            # It lasts, and what began within a look has become clear.
            self._before = [*self._before, now.component if now is not None else ""][-AGREE:]
            if now is not None and self._before == [now.component] * AGREE:
                self.found = now
        elif now is not None and now.component == found.component:
            self.found = now
        return top

    def _dilution(self, usual: Floats) -> Floats:
        """Covariances of what drives seem to change by where currents vary little beside their
        noise (regression dilution), of their D parameters in each window, shape (W, D, D).

        By the share of noise in what varies beyond speeds and accelerations, they seem to give way
        less. What each pushes all the while then seems its own.
        """
        drives, gives_way = self._drives, self._constants.gives_way
        told, at = self._told[:, drives, drives], gives_way - drives.start
        # What changes with how they give way, by the information that is left of that alone.
        change = np.linalg.inv(told + self._drives_prior)[:, :, at]
        noise = np.minimum(NOISE * told[:, at, at], 1.0 / change[:, at])
        change *= (usual[gives_way] * noise)[:, None]
        return change[:, :, None] * change[:, None, :]

    def _ended(self, tests: "_Tests", found: Change) -> bool:
        """Whether the part is as it was before, by the shortest window."""
        own = [at for at, path in enumerate(self._paths) if path == found.component]
        size = tests.size[0, own]
        missing = (size - found.size) ** 2 * tests.told[0, own]
        return bool(np.all(np.abs(size) < 0.5 * abs(found.size)) and np.all(missing > SURE / 2))

    def _name(self, tests: "_Tests", window: int, best: int) -> Change | None:
        """The change that a window shows best, if a part explains it, and no other does."""
        path, sure = self._paths[best], tests.sure[window]
        if not path or sure[best] < SURE:
            return None
        evidence = 0.5 * sure  # logarithms of how much likelier each is than no change
        others = [at for at, each in enumerate(self._paths) if each != path]
        if evidence[best] - evidence[others].max() < CLEAR:
            return None
        if tests.unexplained(window, best) > CLEAR + UNEXPLAINED * evidence[best]:
            return None
        if not self._lasts(tests, window, best):
            return None
        if self.found is not None and self.found.component == path:
            for at, each in enumerate(self._paths):
                same = each == path and self._kinds[at] == self.found.kind
                if same and evidence[best] - evidence[at] < SURER:
                    best = at
        size, sigma = float(tests.size[window, best]), 1.0 / math.sqrt(tests.told[window, best])
        return Change(path, self._kinds[best], size, sigma)

    def _lasts(self, tests: "_Tests", window: int, best: int) -> bool:
        """Whether it also shows without the looks that speak for it most, which no shock does."""
        change = self._changes[best] * math.copysign(1.0, tests.size[window, best])
        looks = WINDOWS[window]
        by_change = [change @ look.told for look in list(self._looks)[-looks:]]
        each = sorted(
            (float(told[-1] - told[:-1] @ tests.usual), float(told[:-1] @ change))
            for told in by_change
        )[: -min(SHOCKED, looks // 3)]
        for_it, told = sum(a for a, _ in each), sum(b for _, b in each)
        return for_it > 0.0 and for_it * for_it > 0.5 * SURE * told


class _Tests:
    """Each hypothesis against each window.

    The constants of a sound robot are known as well as driving has shown them, and change a little;
    so a window's equations are those of the change, once what they say of that is eliminated. That
    drives give way to their load is hardly learnt, for example, until a motor that is wrong makes
    all others push.

    Args:
        changes: What is looked for, shape (K, P).
        told: Normal equations of W windows, shape (W, P, P + 1).
        usual: The constants as learnt, shape (P,).
        unsure: Covariances of what they may be now, shape (W, P, P).
        forced: Variance of the slip that calibration forces, by that of noise, shape (W, P).

    Attributes:
        size: Of the change, shape (W, K).
        told: One over the variance of that.
        sure: Squares of the sizes by their variances.
        best: Which change each window shows best.
        usual: As above.
    """

    def __init__(
        self, changes: Floats, told: Floats, usual: Floats, unsure: Floats, forced: Floats
    ) -> None:
        self._changes, self.usual = changes, usual
        heard = told / (1.0 + forced)[:, :, None]
        information = heard[:, :, :-1]
        heard[:, :, -1] -= information @ usual
        mixed = information @ unsure
        mixed.reshape(len(told), -1)[:, :: told.shape[-1]] += 1.0
        self._left = np.linalg.solve(mixed, heard)
        by_change = changes @ self._left
        for_it = by_change[:, :, -1]
        self.told = np.maximum(np.vecdot(by_change[:, :, :-1], changes), 1e-9)
        self.size = for_it / self.told
        self.sure = for_it * self.size
        self.best: list[int] = self.sure.argmax(axis=1).tolist()

    def unexplained(self, window: int, best: int) -> float:
        """Evidence for any other change beside one."""
        left = self._left[window]
        left = left[:, -1] - left[:, :-1] @ (self.size[window, best] * self._changes[best])
        by_change = self._changes @ left
        return float((0.5 * by_change * by_change / self.told[window]).max())


def _hypotheses(
    layout: Layout, constants: Constants, gyros: Mapping[str, GyroConfig]
) -> tuple[list[str], list[Class], Floats]:
    """Components, kinds and changes of the constants, shape (K, P).

    A drive whose sensor is wrong seems off its reference, unless its controller believes the same
    sensor. What has no component is looked for, but not named: a wrong zero of a steering has its
    own test (:mod:`wackel_diagnoser.references`), and a drive off its references altogether is no
    fault of a part.
    """
    drive, names = layout.drive, layout.names
    slides, rolls = drive.slide_wheels.tolist(), drive.roll_wheels.tolist()
    unit = np.eye(constants.count)
    each: list[tuple[str, Class, Floats]] = []
    for wheel, scale, off in zip(rolls, constants.scale, constants.off, strict=True):
        path = component.wheel_drive(names[wheel])
        each.append((path, "sensor", unit[scale] + unit[off]))
        each.append((path, "sensor", unit[scale]))
        each.append((path, "actuator", unit[off] + YIELDS * unit[scale]))
    direction = dict(zip(slides, constants.direction, strict=True))
    steered = [wheel for wheel in slides if drive.steers[wheel]]
    for wheel, stands in zip(steered, constants.stands, strict=True):
        path = component.wheel_steering(names[wheel])
        each.append((path, "", unit[stands] - unit[direction[wheel]]))
        each.append((path, "", unit[stands]))
    for name, bias in zip(gyros, constants.gyro, strict=True):
        each.append((component.gyro(name), "", unit[bias]))
    each += [("", "", unit[at]) for at in constants.direction]
    each.append(("", "", unit[list(constants.off)].sum(axis=0)))
    return (
        [path for path, _, _ in each],
        [kind for _, kind, _ in each],
        np.array([change for _, _, change in each]),
    )
