"""The diagnoser of one robot: messages in, residuals, fault reports and exclusions out.

Time is the stamps of the messages, so a recording gives the same as the robot.
"""

import math
from collections.abc import Callable, Mapping
from operator import or_

import numpy as np

from wackel_diagnoser.absences import Absences
from wackel_diagnoser.bank import Bank
from wackel_diagnoser.command_times import FRESH_NS
from wackel_diagnoser.commands import NO_COMMAND, CommandWatch, Complaint
from wackel_diagnoser.constants import Shown
from wackel_diagnoser.display import Display
from wackel_diagnoser.efforts import Efforts
from wackel_diagnoser.findings import LEAST_CONFIDENCE, Findings, excluded
from wackel_diagnoser.gyro_bias import GyroBias
from wackel_diagnoser.history import History
from wackel_diagnoser.hypotheses import Hypotheses
from wackel_diagnoser.idle import IdleMotors
from wackel_diagnoser.reference import Reference, Target
from wackel_diagnoser.references import ReferenceErrors
from wackel_diagnoser.reports import Finding, Reports
from wackel_diagnoser.rows import MOVING_M_S, Measured, Rows
from wackel_diagnoser.scaling import Scaling
from wackel_diagnoser.sequential import Sequential, threshold
from wackel_diagnoser.small_faults import SmallFaults
from wackel_diagnoser.standing import stand
from wackel_diagnoser.verdicts import Verdicts
from wackel_drive.alignment import Alignment, Step
from wackel_drive.layout import Layout
from wackel_drive.stuck import StuckValue
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas import component
from wackel_schemas.bus import BusState
from wackel_schemas.drive import Exclusion, Exclusions, ImuSample, TwistCommand
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message

RATE = 100.0
"""Hz for which false alarms are designed; at another rate they scale with it."""
LEARN_EVERY, LAGS_EVERY, YOUNG_EVERY = 32, 16, 8
"""Steps; what is learnt changes within seconds, and neighbouring steps teach the same. Lags are
learnt more often, for what tells of them is soon over, and all is until there are verdicts."""
LOOK_EVERY = 4
"""Steps, at hypotheses while nothing stirs: of neighbouring steps, a quarter is new
(:mod:`wackel_diagnoser.sequential`). Of those that teach, it is all: they are multiples of it."""
MOTORS_EVERY = 4
"""Steps, from look to look at what they push, which hardly changes meanwhile. Seen half as often,
a motor of a badly calibrated robot was called idle after minutes."""
STIRS = 9.0
"""Square of a miss, by its variance, that has hypotheses looked at in the same step: three standard
deviations, which a sound robot hardly ever misses by. What misses by less takes many steps to be
told, of which every fourth is looked at."""
SHOW_NS = 240_000_000
"""How often residuals are published: as fast as people read, and with every sixth look at them."""
EXAMINE_NS = 50_000_000
"""How often faults are looked at while one is suspected."""
CALM = 1 / 3
"""Share of the alarm's limit up to which nothing is suspected."""
LEAST_FORCED = 0.33
"""Of the variance of what a manoeuvre adds, however little most of them do: slip that references
force is then about two standard deviations where one wheel takes all of it."""
LEAST_LEFT = 0.1
"""Share of its variance that is left of a row's residual by what the estimate took from it, below
which it tells nothing."""
SKIDS_NS = 500_000_000
"""For how long wheels may slip after a command that they or their tyres cannot follow: what a
steering takes for half a turn, and twice as long until it is believed that they do not. It was the
command that disturbed the drive, and no part of it."""
SKIDDING = {"drive_disturbed", "wheel_deviates", "gyro_deviates"}
"""What that looks like: wheels turn as they are told, but do not go where they show."""
ACQUAINTED_S = 3.0
"""Of driving, in which lags and noise are learnt and no verdict is passed: half a dozen changes of
speed."""


# Of numpy's own kind: it takes longer for a number of Python's.
_HALF, _LEAST_LEFT = map(np.array, (0.5, LEAST_LEFT))
_MANOEUVRE = np.array([[False], [True]])
"""Which of the scalings a step teaches whose variance is mostly of its manoeuvre."""


class Diagnoser:
    """Names faulty drives, steerings and sensors.

    Args:
        config: The drive.
        gyros: By name, as published on ``imu/<name>``.
        shown: Whether anyone looks at residuals now; else they are not made.
    """

    def __init__(
        self,
        config: DriveConfig,
        gyros: Mapping[str, GyroConfig],
        shown: Callable[[], bool] = lambda: True,
    ) -> None:
        layout = Layout(config)
        self._values = {name: StuckValue() for name in gyros}
        self._stuck: list[str] = []
        self._alignment = Alignment(layout, gyros)
        self._reference = Reference(layout, config)
        self._commands = CommandWatch(layout)
        rows = self._rows = Rows(layout, config, gyros)
        hypotheses = Hypotheses(layout, gyros)
        self._bank = Bank(hypotheses.spread)
        # Of sensors, and of what manoeuvres add: in one, as numpy takes long to be called.
        self._scaling = Scaling(
            np.repeat([[9.0], [1.0]], rows.count, axis=1), least=np.array([[0.3], [LEAST_FORCED]])
        )
        limit = threshold(len(hypotheses), RATE)
        self._sequential = Sequential(hypotheses.prior, hypotheses.explanation, limit)
        self._small = SmallFaults(layout, config, rows, gyros)
        self._bias = GyroBias(list(gyros.values()))
        self._efforts = Efforts(layout)
        self._rolling = layout.drive.roll_wheels
        self._idle = IdleMotors(len(self._rolling), RATE / MOTORS_EVERY)
        self._absences = Absences(layout)
        self._off = [False] * len(self._rolling)  # motors without torque
        self._references = ReferenceErrors(layout, rows)
        self._adopt()
        self._history = History(layout)
        self._verdicts = Verdicts(
            layout,
            hypotheses,
            rows,
            sequential=self._sequential,
            small=self._small,
            references=self._references,
        )
        self._findings = Findings(
            layout,
            hypotheses,
            rows,
            sequential=self._sequential,
            verdicts=self._verdicts,
            small=self._small,
            references=self._references,
            absences=self._absences,
            history=self._history,
        )
        self._reports = Reports()
        self._display = Display(
            layout,
            hypotheses,
            rows,
            bank=self._bank,
            scaling=self._scaling,
            sequential=self._sequential,
            reference=self._reference,
        )
        self._wheels = layout.drive.n
        self._steps_made = 0
        self._likelihood: Floats = np.zeros(len(hypotheses))  # as last looked at
        self._usual: list[float] = []  # variances then of what wheels and gyros miss
        self._unlooked, self._unlooked_s = 0, 0.0  # steps since
        self._unwatched_s = 0.0  # since motors were looked at
        self._driven_s = 0.0
        self._stands = False  # whether, before there can be a verdict, a wheel stands
        self._restarts = 0
        self._is_shown = shown
        self._shown: int | None = None
        self._examined = 0
        # About the latest command, and of those that were none; and ends of the first step since.
        self._complaints: dict[bool, Complaint] = {}
        self._complained: dict[bool, int] = {}
        # Stamp of the last command that wheels or tyres cannot follow; and of each part that was
        # named, since when it is, and whether that is a slip which the command made.
        self._astray: int | None = None
        self._commanded: dict[str, tuple[int, bool]] = {}
        self._exclusions: list[Exclusion] | None = None

    def bus_state(self, bus: str, state: BusState) -> list[Message]:
        """Takes in what the servos of a bus said.

        Returns:
            Residuals, fault reports and exclusions; numbered by who publishes.
        """
        taken = self._alignment.bus_state(bus, state)
        self._efforts.bus_state(bus, state)
        if not taken:
            self._alignment.refused.clear()
            return []
        return self._steps()

    def imu(self, name: str, sample: ImuSample) -> list[Message]:
        """Takes in a sample of a gyro; one that is not configured is ignored."""
        if name not in self._values:
            return []
        self._values[name].sample(sample.stamp, sample.angular_velocity)
        self._alignment.gyro(name, sample)
        return self._steps()

    def command(self, message: TwistCommand) -> None:
        """Takes in what the drive is told; what cannot be a command is told as such."""
        known = self._reference.command(message)
        complaint = self._commands.look(message) if known else NO_COMMAND
        self._complained.pop(known, None)
        if complaint is not None:
            self._complaints[known] = complaint
            if complaint.code == "command_infeasible":
                self._astray = message.stamp
        else:
            self._complaints.pop(known, None)

    def active(self) -> list[FaultReport]:
        """The faults that are active, in the order in which they began."""
        return self._reports.active()

    def _steps(self) -> list[Message]:
        self._alignment.refused.clear()  # the odometry tells of it
        if self._alignment.restarts != self._restarts:
            self._restarts = self._alignment.restarts
            self._absences.all_back(self._alignment.done or 0)
            self._reference.forget()
            self._sequential.forget()
            self._small.forget()
        messages: list[Message] = []
        while (step := self._alignment.step()) is not None:
            messages += self._step(self._absences.step(step))
        return messages

    def _step(self, step: Step) -> list[Message]:
        sequential, rows, seconds = self._sequential, self._rows, step.seconds
        young = self._driven_s < ACQUAINTED_S
        calm = sequential.verdict == 0 and sequential.alarm < CALM and not self._stands
        self._steps_made += 1
        lags_every, every = (YOUNG_EVERY,) * 2 if young else (LAGS_EVERY, LEARN_EVERY)
        often = calm and self._steps_made % lags_every == 0
        target = self._reference.step(step, seconds * lags_every if often else 0.0)
        learning = often and self._steps_made % every == 0
        learnt_s = seconds * every if learning else 0.0
        currents = self._efforts.currents
        measured = rows.measure(step, target, self._bias.value, currents)
        if measured.skids:
            self._astray = step.end
        looked = self._look(measured, seconds, known=target.known)
        moving = measured.speed > MOVING_M_S
        if young:
            self._driven_s += seconds if moving else 0.0
            sequential.forget()
        self._stands = young and self._one_stands(target, measured)
        efforts = self._efforts.step(
            seconds,
            target.speed,
            measured.turning,
            learnt_s if moving else 0.0,
            needed=not calm,
        )
        if learning:
            self._learn(measured, learnt_s, moving=moving, guessed=target.is_guessed)
        # A steering that shows something else than it is told would be taken for a wrong zero.
        if (
            not young
            and not self._verdicts.steers_wrong
            and self._references.step(step, target, measured, currents)
        ):
            self._correct()
        shown = Shown(step, target, measured, self._bias.value, currents, self._reference.lags_s[1])
        self._history.add(step, target, measured)
        # While lags are not known, they would be taken for what drives yield.
        self._small.step(shown, calm=calm and not young)
        rows.lag_s, rows.following = self._small.lag_s, self._small.following
        if learning:
            self._adopt()
        self._watch_gyros(step.end, measured)
        changed = self._verdicts.step(
            step, target, measured, efforts, self._likelihood, currents=currents
        )
        self._unwatched_s += seconds
        if self._steps_made % MOTORS_EVERY == 0:
            if (rolling := self._efforts.rolling()) is not None:
                self._idle.step(
                    self._unwatched_s,
                    target.speed,
                    measured.turning,
                    rolling,
                    faulty=self._verdicts.faulty,
                )
            self._off = self._absences.lasting(self._rolling, self._efforts.off)
            self._verdicts.free(map(or_, self._off, self._idle.found))
            self._unwatched_s = 0.0
        if self._complaints:
            self._age_complaints(step.end)
        messages: list[Message] = []
        if changed or self._to_examine(step.end):
            messages += self._examine(step.end)
        if changed:
            self._shown = None
        if looked and (self._shown is None or not 0 <= step.end - self._shown < SHOW_NS):
            self._shown = step.end
            if self._is_shown():
                messages.append(self._display.residuals(step, target, measured))
        return messages

    def _look(self, measured: Measured, seconds: float, *, known: bool) -> bool:
        """Looks at hypotheses if it is time, or something stirs; says whether it did.

        Args:
            measured: The rows of a step.
            seconds: Its length.
            known: Whether it is known what wheels should do.
        """
        sequential = self._sequential
        self._unlooked_s += seconds
        self._unlooked += 1
        if (
            self._steps_made % LOOK_EVERY
            and known
            and sequential.at_rest
            and self._usual
            and not self._stirs(measured)
        ):
            return False
        self._likelihood = self._evaluate(measured)
        sequential.step(self._likelihood, self._unlooked_s, self._unlooked)
        self._unlooked_s, self._unlooked = 0.0, 0
        return True

    def _stirs(self, measured: Measured) -> bool:
        """Whether a wheel or a gyro is further off what it was told than it mostly is, by what
        was known of that when hypotheses were looked at last."""
        # Single numbers: for some rows, Python is faster with them than numpy.
        for off, variance in zip(measured.misses, self._usual, strict=True):
            if not off * off / variance <= STIRS:  # as what is not known may
                return True
        return False

    def _evaluate(self, measured: Measured) -> Floats:
        variance, _, size = measured.spread()
        self._usual = variance[self._rows.gyros.start :].tolist()
        return self._bank.evaluate(measured.z, measured.h, variance, size)

    def _one_stands(self, target: Target, measured: Measured) -> bool:
        """Whether a wheel that is told to roll stands while another rolls."""
        rolls = self._rows.rolls
        driven = stand(target.speed, measured.rolled, measured.present[rolls].tolist())
        return any(driven.values()) and not all(driven.values())

    def _learn(self, measured: Measured, seconds: float, *, moving: bool, guessed: bool) -> None:
        """What residuals are like when nothing is wrong, and the gyros' bias.

        Args:
            measured: The rows of a step.
            seconds: For how much driving it stands.
            moving: Whether the robot moves.
            guessed: Whether variances are of lags that are not learnt: they tell nothing then.
        """
        variance, loose, _ = measured.spread()
        covariance = self._bank.covariance()
        spread = measured.h.dot(covariance)
        off = measured.z - spread.dot(self._bank.right())
        # What the estimate took from a row itself does not show in its residual.
        left, least = variance - np.vecdot(spread, measured.h), _LEAST_LEFT * variance
        seen = measured.present & (left > least)
        # Where it is hardly known how drives follow, they do not tell how large noise is.
        rolling, rolled = self._rows.rolling, np.array(measured.rolled)
        seen[rolling] &= self._small.follows * rolled * rolled < _HALF * variance[rolling]
        np.maximum(left, least, out=left)
        if moving and not guessed:
            squares = off * off / left
            # A step teaches of what its variance is mostly made of.
            scaling = self._scaling
            mostly = loose * scaling.factors[1] > _HALF * variance
            scaling.learn(squares * scaling.factors, seen & (mostly == _MANOEUVRE), seconds)
        g = self._rows.gyros
        self._bias.learn(off[g], variance[g], left[g], seen[g], seconds=seconds, moving=moving)

    def _adopt(self) -> None:
        """What has been learnt goes into the rows."""
        self._references.adopt(self._small.following.gives_way)
        self._rows.adopt(
            self._small.calibration,
            follows=self._small.follows,
            biases=self._bias.variance,
            scales=self._scaling.factors,
        )

    def _watch_gyros(self, end: int, measured: Measured) -> None:
        """Which of them are stuck, while the robot is told to turn otherwise than before."""
        stuck = []
        for name, value in self._values.items():
            if value.same > 1:
                told = measured.followed[2]
                if math.isfinite(told):
                    value.turns(end, told)
                if value.stuck:
                    stuck.append(name)
        if stuck != self._stuck:
            self._stuck = stuck
            self._verdicts.stuck(stuck)

    def _correct(self) -> None:
        """The zero of a steering is wrong, or right again: what was concluded before is void."""
        reference = self._references.found
        zeros = np.zeros(self._wheels)
        if reference is not None:
            zeros[reference.wheel] = reference.angle
        self._rows.correct(zeros)
        self._verdicts.void()

    def _age_complaints(self, now: int) -> None:
        """A command that is no longer what drives the robot is no longer wrong."""
        for known in list(self._complaints):
            if not 0 <= now - self._complained.setdefault(known, now) <= FRESH_NS:
                del self._complaints[known], self._complained[known]

    def _to_examine(self, now: int) -> bool:
        """Whether it is time to look at faults."""
        if self._exclusions is None:
            # The first word: what a diagnoser before this one excluded is to be believed again.
            return True
        if 0 <= now - self._examined < EXAMINE_NS:
            return False
        return (
            self._sequential.verdict != 0
            or self._references.found is not None
            or bool(self._complaints)
            or any(self._off)
            or any(self._idle.found)
            or self._reports.any_active
        )

    def _is_commanded(self, finding: Finding, now: int) -> bool:
        """Whether wheels slip for a command that they or their tyres cannot follow, and not longer
        than for that; nor is it told then, if it is about to heal. A push that begins and ends
        meanwhile is not told."""
        since, path = finding.since, finding.component
        if finding.code not in SKIDDING or path in map(component.gyro, self._stuck):
            return False
        then, commanded = self._commanded.get(path, (None, False))
        if since != then:
            commanded = self._astray is not None and abs(since - self._astray) <= SKIDS_NS
            self._commanded[path] = since, commanded
        if now - since > 3 * SKIDS_NS and finding.confidence > LEAST_CONFIDENCE:
            commanded = False
            self._commanded[path] = since, commanded  # from now on it is told
        return commanded

    def _examine(self, now: int) -> list[Message]:
        """What has changed of faults and exclusions."""
        self._examined = now
        findings = self._findings
        found: list[Finding] = findings.free(self._off, self._idle.found, now)
        found += [
            each for each in findings.verdict(found, now) if not self._is_commanded(each, now)
        ]
        if self._references.found is not None:
            found.append(findings.reference(self._references.found, now))
        found += [findings.command(each, now) for each in self._complaints.values()]
        messages: list[Message] = [*self._reports.update(found, now)]
        exclusions = excluded(found)
        if exclusions != self._exclusions:
            self._exclusions = exclusions
            messages.append(Exclusions(stamp=now, excluded=exclusions))
        return messages
