"""The diagnoser of one robot: messages in, residuals, fault reports and exclusions out.

Time is the stamps of the messages, so a recording gives the same as the robot.
"""

import math
from collections import Counter, deque
from collections.abc import Mapping

import numpy as np

from wackel_diagnoser.bank import Bank
from wackel_diagnoser.commands import CommandWatch, Complaint
from wackel_diagnoser.constants import Shown
from wackel_diagnoser.efforts import Efforts
from wackel_diagnoser.forced import ForcedMotion, can_force
from wackel_diagnoser.gyro_bias import GyroBias
from wackel_diagnoser.history import BLOCKED, STICKING, History, Moment
from wackel_diagnoser.hypotheses import Class, Hypotheses
from wackel_diagnoser.idle import IdleMotors
from wackel_diagnoser.kinds import WINDOW_S, KindTest
from wackel_diagnoser.reference import Reference, Target
from wackel_diagnoser.references import ReferenceErrors
from wackel_diagnoser.reports import Finding, Reports
from wackel_diagnoser.rows import Measured, Rows
from wackel_diagnoser.scaling import Scaling
from wackel_diagnoser.sequential import Sequential, threshold
from wackel_diagnoser.small_faults import SmallFaults
from wackel_diagnoser.steps import PaperSteps
from wackel_drive.alignment import Alignment, Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_schemas import component
from wackel_schemas.bus import BusState
from wackel_schemas.drive import Exclusion, Exclusions, ImuSample, TwistCommand
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message
from wackel_schemas.residuals import HypothesisState, Residuals, RowState

RATE = 100.0
"""Hz for which false alarms are designed; at another rate they scale with it."""
LEARN_EVERY = 4
"""Steps; what is learnt changes within seconds."""
SHOW_NS = 100_000_000
"""How often residuals are published: as fast as people read."""
EXAMINE_NS = 50_000_000
"""How often faults are looked at while one is suspected."""
CALM = 1 / 3
"""Share of the alarm's limit up to which nothing is suspected."""
MOVING_M_S = 0.05
"""Slower, residuals say nothing of calibration, and a faulty wheel looks sound."""
SOUND_S = 1.0
"""For how long a part must have shown itself sound before it is healed."""
UNSTUCK_S = 3.0
"""The same of a wheel that stood: one that sticks now and then rolls well in between."""
STOOD = ("wheel_blocked", "wheel_sticks")
AGAIN_NS = 30_000_000
"""A wheel that has not stood for so long rolls again."""
CONTRARY = 0.5
"""Evidence of one step for the fault that begins this anew."""
TRAVELLED_RAD = 0.1
"""How far a steering must have been told to turn meanwhile, or have turned since the verdict: one
that is blocked looks sound until then."""
ACQUAINTED_S = 3.0
"""Of driving, in which lags and noise are learnt and no verdict is passed: half a dozen changes of
speed."""
ALARM_STEPS = 4
"""How long an alarm takes at least."""
FORCED_STEPS = 5
"""That are compared at once with how wheels force each other."""
OFF_S = 1.5
"""A torque that is off for so long is no transient of switching on: a gateway reads the register of
each servo once a second, so for a second those that have been read say on and the others off."""
SHOWN = 5
"""Hypotheses that are published."""


class Diagnoser:
    """Names faulty drives, steerings and sensors.

    Args:
        config: The drive.
        gyros: By name, as published on ``imu/<name>``.
    """

    def __init__(self, config: DriveConfig, gyros: Mapping[str, GyroConfig]) -> None:
        layout = self._layout = Layout(config)
        self._gyros = tuple(gyros)
        self._alignment = Alignment(layout, gyros)
        self._reference = Reference(layout, config)
        self._commands = CommandWatch(layout)
        rows = self._rows = Rows(layout, config, gyros)
        hypotheses = self._hypotheses = Hypotheses(layout, gyros)
        self._bank = Bank(hypotheses.spread)
        self._sensors = Scaling(rows.count, first=9.0, least=0.15)
        self._manoeuvre = Scaling(rows.count, first=1.0, least=0.25)
        limit = threshold(len(hypotheses), RATE)
        self._sequential = Sequential(hypotheses.prior, hypotheses.explanation, limit)
        self._small = SmallFaults(layout, config, rows, gyros)
        self._bias = GyroBias(list(gyros.values()))
        self._efforts = Efforts(layout)
        self._idle = IdleMotors(len(layout.drive.roll_wheels), RATE / LEARN_EVERY)
        self._references = ReferenceErrors(layout, rows)
        self._paper = PaperSteps(layout)
        self._history = History()
        self._reports = Reports()
        self._steps_made = 0
        self._driven_s = 0.0
        self._restarts = 0
        self._shown: int | None = None
        self._examined = 0
        self._since = 0  # of the verdict
        self._sound_s = self._travelled = 0.0
        self._heading_then = np.zeros(len(layout.names))  # when the verdict was passed
        self._kind_test: KindTest | None = None
        self._recent: deque[tuple[Measured, Floats, Floats, float]] = deque(maxlen=ALARM_STEPS)
        self._motion = ForcedMotion(layout) if can_force(layout.drive) else None
        self._block: list[tuple[Step, Target, Measured, list[float]]] = []
        self._kind: Class = ""
        self._said: Finding | None = None  # of a drive
        self._steers_wrong = False
        self._is_small = False
        self._complaint: Complaint | None = None
        self._off_s = [0.0] * len(layout.drive.roll_wheels)
        self._exclusions: list[Exclusion] | None = None
        self._target_before: Floats | None = None

    def bus_state(self, bus: str, state: BusState) -> list[Message]:
        """Takes in what the servos of a bus said.

        Returns:
            Residuals, fault reports and exclusions; numbered by who publishes.
        """
        self._alignment.bus_state(bus, state)
        self._efforts.bus_state(bus, state)
        return self._steps()

    def imu(self, name: str, sample: ImuSample) -> list[Message]:
        """Takes in a sample of a gyro; one that is not configured is ignored."""
        if name not in self._gyros:
            return []
        self._alignment.gyro(name, sample)
        return self._steps()

    def command(self, message: TwistCommand) -> None:
        """Takes in what the drive is told; what cannot be a command is ignored."""
        if self._reference.command(message):
            twist = np.array((message.vx, message.vy, message.omega))
            self._complaint = self._commands.look(twist, message.stamp)

    def active(self) -> list[FaultReport]:
        """The faults that are active, in the order in which they began."""
        return self._reports.active()

    def _steps(self) -> list[Message]:
        self._alignment.refused.clear()
        if self._alignment.restarts != self._restarts:
            self._restarts = self._alignment.restarts
            self._reference.forget()
            self._sequential.forget()
            self._small.forget()
        messages: list[Message] = []
        while (step := self._alignment.step()) is not None:
            messages += self._step(step)
        return messages

    def _step(self, step: Step) -> list[Message]:
        sequential, rows = self._sequential, self._rows
        young = self._driven_s < ACQUAINTED_S
        calm = young or (sequential.verdict == 0 and sequential.alarm < CALM)
        self._steps_made += 1
        learning = calm and self._steps_made % LEARN_EVERY == 0
        learnt_s = step.seconds * LEARN_EVERY if learning else 0.0
        target = self._reference.step(step, learnt_s)
        measured = rows.measure(step, target, self._bias.value)
        variance = measured.base * self._sensors.factors
        variance += measured.loose * self._manoeuvre.factors
        variance[rows.gyros] += self._bias.variance
        likelihood = self._bank.evaluate(measured.z, measured.h, variance, measured.size)
        sequential.step(likelihood, step.seconds)
        moving = measured.speed > MOVING_M_S
        if young:
            self._driven_s += step.seconds if moving else 0.0
            sequential.forget()
        driven_s = learnt_s if moving else 0.0
        efforts = self._efforts.step(step.seconds, target.speed, driven_s, needed=not calm)
        self._history.add(Moment(step.end, step.heading, measured.z[rows.rolls], target))
        if learning:
            self._learn(measured, variance, learnt_s, moving)
        currents = self._efforts.currents
        # A steering that shows something else than it is told would be taken for a wrong zero.
        if (
            not young
            and not self._steers_wrong
            and self._references.step(step, target, measured, currents)
        ):
            self._correct()
        shown = Shown(step, target, measured, self._bias.value, currents)
        self._small.step(shown, calm=calm)
        rows.lag_s = self._small.lag_s
        changed = self._judge(step, target, (measured, variance, efforts), likelihood)
        self._watch_torque(step.seconds)
        if self._steps_made % LEARN_EVERY == 0 and (rolling := self._efforts.rolling()) is not None:
            self._idle.step(step.seconds * LEARN_EVERY, target.speed, *rolling)
        suspected = (
            sequential.verdict != 0
            or self._references.found is not None
            or self._complaint is not None
            or any(self._off_s)
            or any(self._idle.found)
        )
        messages: list[Message] = []
        # The first word: what a diagnoser before this one excluded is to be believed again.
        if (
            changed
            or self._exclusions is None
            or (
                (suspected or self._reports.active())
                and not 0 <= step.end - self._examined < EXAMINE_NS
            )
        ):
            messages += self._examine(step.end)
        if changed or self._shown is None or not 0 <= step.end - self._shown < SHOW_NS:
            messages.append(self._show(step, target, measured, variance))
        return messages

    def _learn(self, measured: Measured, variance: Floats, seconds: float, moving: bool) -> None:
        """What residuals are like when nothing is wrong, and the gyros' bias."""
        rows, covariance = self._rows, self._bank.covariance()
        off = measured.z - measured.h @ (covariance @ self._bank.right())
        # What the estimate took from a row itself does not show in its residual.
        left = 1.0 - np.vecdot(measured.h @ covariance, measured.h) / variance
        seen = measured.present & (left > 0.1)
        left = np.maximum(left, 0.1)
        if moving:
            squares = off * off / (variance * left)
            # A step teaches of what its variance is mostly made of.
            loose = measured.loose * self._manoeuvre.factors > 0.5 * variance
            self._sensors.learn(squares * self._sensors.factors, seen & ~loose, seconds)
            self._manoeuvre.learn(squares * self._manoeuvre.factors, seen & loose, seconds)
        g = rows.gyros
        self._bias.learn(off[g] / left[g], variance[g] / left[g], seen[g], seconds, moving)

    def _correct(self) -> None:
        """The zero of a steering is wrong, or right again: what was concluded before is void."""
        reference = self._references.found
        zeros = np.zeros(self._layout.drive.n)
        if reference is not None:
            zeros[reference.wheel] = reference.angle
        self._rows.correct(zeros)
        self._sequential.forget()
        self._sequential.accept(0)
        self._kind_test, self._kind = None, ""

    def _judge(
        self,
        step: Step,
        target: Target,
        evidence: tuple[Measured, Floats, Floats],
        likelihood: Floats,
    ) -> bool:
        """Follows the verdict; says whether it, or its kind, has changed."""
        sequential, hypotheses = self._sequential, self._hypotheses
        verdict = sequential.verdict
        if verdict:
            self._watch_soundness(step, target, likelihood)
        changed = False
        proposal = sequential.proposal()
        small = self._small.found
        is_small = proposal is None and not verdict and small is not None
        if is_small and small is not None:
            proposal = hypotheses.explanations.index((small.component,))
        if proposal is not None:
            names, now = (set(hypotheses.explanations[i]) for i in (proposal, verdict))
            if not names < now or (
                self._sound_s >= SOUND_S  # the least; how much it is takes long to say
                and self._sound_s >= self._sound_needed_s()
                and (small is None or small.component not in now)
            ):
                sequential.accept(proposal)
                self._is_small = is_small
                if not names:
                    self._small.forget()
                self._take(proposal, step)
                verdict, changed = proposal, True
        self._recent.append((*evidence, step.seconds))
        if self._kind_test is not None and self._kind_test.seconds < WINDOW_S:
            if changed:  # an alarm takes some steps, which tell of the kind already
                for each in self._recent:
                    self._kind_test.step(*each)
            else:
                self._kind_test.step(*evidence, step.seconds)
            if self._motion is not None and self._kind_test.steering:
                self._block.append((step, target, evidence[0], self._efforts.currents))
                if len(self._block) >= FORCED_STEPS:
                    references = self._references
                    self._kind_test.force(self._block, self._rows, self._motion, references)
                    self._block.clear()
            kind = self._kind_test.kind()
            if small is not None and self._is_small:
                kind = small.kind or kind
            changed |= kind != self._kind
            self._kind = kind
        return changed

    def _take(self, verdict: int, step: Step) -> None:
        """A new verdict."""
        components = self._hypotheses.explanations[verdict]
        self._since = step.begin
        self._heading_then = step.heading
        self._sound_s = self._travelled = 0.0
        self._kind_test, self._kind = None, ""
        self._said = None
        places = [self._hypotheses.place(path) for path in components]
        self._steers_wrong = any(place is not None and place[0] == "steering" for place in places)
        self._block.clear()
        if len(components) != 1:
            return
        place = places[0]
        if place is None:
            self._kind = "sensor" if components[0].startswith("gyro/") else ""
            return
        part, wheel = place
        rolls = self._layout.drive.roll_wheels.tolist()
        own = rolls.index(wheel) if part == "drive" else len(rolls) + wheel
        spoilt = self._hypotheses.own_rows(components[0])
        self._kind_test = KindTest(spoilt, self._rows.gyros, own, len(rolls))
        self._kind = "sensor"

    def _sound_needed_s(self) -> float:
        """For how long what is faulty must look sound to be so."""
        for path in self._hypotheses.explanations[self._sequential.verdict]:
            part, wheel = self._hypotheses.place(path) or ("", 0)
            if part == "drive":
                share = self._history.standing_share(self._rows.roll_of(wheel), self._since)
                if share is not None and share >= STICKING:
                    return UNSTUCK_S
        return SOUND_S

    def _watch_soundness(self, step: Step, target: Target, likelihood: Floats) -> None:
        """For how long the faulty part has shown that nothing is wrong with it."""
        hypotheses, verdict = self._hypotheses, self._sequential.verdict
        members = hypotheses.members
        evidence = float(likelihood[members[verdict]].max() - likelihood[members[0]].max())
        before, self._target_before = self._target_before, target.heading
        shows = True
        for path in hypotheses.explanations[verdict]:
            place = hypotheses.place(path)
            if place is None:
                continue
            part, wheel = place
            roll = self._rows.roll_of(wheel)
            shows &= roll < 0 or abs(float(target.speed[roll])) > MOVING_M_S
            if part == "steering" and before is not None:
                turned = abs(float(target.heading[wheel] - before[wheel]))
                # Half turns are the same direction.
                self._travelled += turned if turned < 1.0 else 0.0
                moved = abs(float(step.heading[wheel] - self._heading_then[wheel]))
                shows &= max(self._travelled, moved) > TRAVELLED_RAD
        if evidence > CONTRARY:
            self._sound_s = self._travelled = 0.0
        elif shows:
            self._sound_s += step.seconds

    def _watch_torque(self, seconds: float) -> None:
        off = self._efforts.off()
        if any(off) or any(self._off_s):
            self._off_s = [
                s + seconds if is_off else 0.0 for s, is_off in zip(self._off_s, off, strict=True)
            ]

    def _examine(self, now: int) -> list[Message]:
        """What has changed of faults and exclusions."""
        self._examined = now
        found = [*self._findings(now)]
        messages: list[Message] = [*self._reports.update(found, now)]
        exclusions = self._excluded(found)
        if exclusions != self._exclusions:
            self._exclusions = exclusions
            messages.append(Exclusions(stamp=now, excluded=exclusions))
        return messages

    def _findings(self, now: int) -> list[Finding]:
        found = []
        components = self._hypotheses.explanations[self._sequential.verdict]
        free = []
        for wheel, off_s, idle in zip(
            self._layout.drive.roll_wheels.tolist(), self._off_s, self._idle.found, strict=True
        ):
            off = off_s >= OFF_S
            if off or idle:
                path = component.wheel_drive(self._layout.names[wheel])
                summary = "its torque is off while that of others is on"
                if not off:
                    summary = "its motor needs no more than to turn by itself while others work"
                free.append(path)
                confidence = 0.99 if off else 0.95
                found.append(Finding("wheel_free", path, summary, now, confidence=confidence))
        if len(components) == 2:
            a, b = components
            for path, other in ((a, b), (b, a)):
                words = {"others": component.in_words(other)}
                summary = "two at once explain the residuals, neither alone"
                found.append(self._finding("two_faults", path, summary, words))
        elif components:
            single = self._single(components[0], free)
            # A wheel without torque that swings in its play is no further fault; a blocked one is.
            if components[0] not in free or single.code in STOOD:
                found.append(single)
        reference = self._references.found
        if reference is not None:
            angle = f"{math.degrees(reference.angle):+.0f}°"
            found.append(
                Finding(
                    "steering_reference",
                    component.wheel_steering(self._layout.names[reference.wheel]),
                    f"the robot moves as it would if this stood {angle} off",
                    now,
                    {"angle_rad": reference.angle, "log_likelihood_ratio": reference.sure},
                    {"angle": angle},
                )
            )
        if self._complaint is not None:
            complaint = self._complaint
            words = {"reason": complaint.reason, "wheel": complaint.wheel}
            summary = complaint.reason or f"the centre of rotation is at wheel {complaint.wheel}"
            found.append(Finding(complaint.code, component.COMMAND, summary, now, words=words))
        return found

    def _single(self, path: str, free: list[str]) -> Finding:
        """The verdict on one component, by its row of table 1."""
        place = self._hypotheses.place(path)
        if place is None:
            if path == component.DRIVE:
                return self._finding("drive_disturbed", path, "all wheels slip at once")
            if path == component.COMMAND:
                return self._finding("command_not_followed", path, "the wheels agree on another")
            return self._finding("gyro_deviates", path, "all wheels agree on another yaw rate")
        part, wheel = place
        history = self._history
        if self._said is not None and self._said.code in STOOD:
            now = max(self._since, self._examined - AGAIN_NS)
            if not history.standing_share(self._rows.roll_of(wheel), now):
                return self._said  # it rolls again: still watched, but with no other fault
        if self._kind == "sensor" and path not in free:
            what = "the gyro and the motors say that the robot moves as the others show"
            return self._finding(f"{'wheel' if part == 'drive' else part}_sensor", path, what)
        if part == "steering":
            if history.steering_frozen(wheel, self._since):
                stands = "it stands though it is told to turn"
                return self._finding("steering_blocked", path, stands)
            off = math.degrees(history.off(wheel, self._since))
            return self._finding("steering_offset", path, f"it stands {off:+.1f}° off")
        share = history.standing_share(self._rows.roll_of(wheel), self._since)
        if share is not None and share >= BLOCKED:
            said = self._finding("wheel_blocked", path, "it stands though it is told to roll")
        elif share is not None and share >= STICKING:
            said = self._finding("wheel_sticks", path, f"it stood for {share:.0%} of the time")
        else:
            said = self._finding("wheel_deviates", path, "it slips against all others")
        self._said = said
        return said

    def _finding(
        self, code: str, path: str, summary: str, words: dict[str, str] | None = None
    ) -> Finding:
        posterior = self._sequential.posterior()
        hypotheses = self._hypotheses
        here = float(posterior[hypotheses.members[self._sequential.verdict]].sum())
        others = [
            (float(posterior[i]), name)
            for i in hypotheses.singles.tolist()
            for name in hypotheses.each[i].components
            if posterior[i] > 0.02 and name != path
        ]
        values: dict[str, float | int | str] = {"probability": round(here, 4)}
        small = self._small.found
        if small is not None and small.component == path:
            values |= {"change": round(small.size, 5), "change_sigma": round(small.sigma, 5)}
        if self._kind_test is not None:
            strain, strained = self._kind_test.strains
            for name, value in (
                ("gyro_share", self._kind_test.share[0]),
                ("current_ratio", strain),
                ("others_current_ratio", strained),
            ):
                if math.isfinite(value):
                    values[name] = round(value, 3)
        return Finding(
            code,
            path,
            summary,
            self._since,
            values,
            words or {},
            min(max(here, 0.5), 0.99),
            tuple(dict.fromkeys(name for _, name in sorted(others, reverse=True))),
        )

    def _excluded(self, found: list[Finding]) -> list[Exclusion]:
        """What odometry must not believe."""
        result: dict[str, Exclusion] = {}
        for finding in found:
            if finding.component in (component.DRIVE, component.COMMAND):
                continue
            sensor = finding.code.endswith("_sensor") or finding.code == "gyro_deviates"
            result[finding.component] = Exclusion(
                component=finding.component,
                fault="sensor" if sensor else "actuator",
                reason=f"{finding.code}: {finding.summary}",
            )
        return list(result.values())

    def _show(self, step: Step, target: Target, measured: Measured, variance: Floats) -> Residuals:
        """What is seen, for people."""
        self._shown = step.end
        hypotheses, rows, drive = self._hypotheses, self._rows, self._layout.drive
        twist = self._bank.covariance() @ self._bank.right()
        off = (measured.z - measured.h @ twist).tolist()
        sigma = np.sqrt(variance).tolist()
        scale = np.sqrt(self._sensors.factors).tolist()
        posterior = self._sequential.posterior()
        shown: Counter[tuple[tuple[str, ...], Class]] = Counter()
        for hypothesis, probability in zip(hypotheses.each, posterior.tolist(), strict=True):
            # How far a fault spoils the rows, of which there are several ways, is not told.
            shown[hypothesis.components, hypothesis.kind] += probability
        gyro = measured.z[rows.gyros][measured.present[rows.gyros]]
        judged = self._paper.judge(
            drive.steering(step.heading),
            step.wheel_rate,
            drive.steering(np.where(np.isfinite(target.goal), target.goal, step.heading)),
            target.twist,
            float(gyro.mean()) if len(gyro) else math.nan,
        )
        known = bool(np.isfinite(target.twist).all())
        return Residuals(
            stamp=step.end,
            commanded=target.twist.tolist() if known else None,
            candidates=self._paper.candidates(judged),
            signature=self._paper.signature(judged),
            steps=self._paper.steps(judged),
            rows=[
                RowState(name=name, residual=r, sigma=s, scale=k)
                for name, r, s, k, there in zip(
                    rows.names, off, sigma, scale, measured.present.tolist(), strict=True
                )
                if there
            ],
            hypotheses=[
                HypothesisState(
                    components=list(components), fault=kind, probability=min(probability, 1.0)
                )
                for (components, kind), probability in shown.most_common(SHOWN)
            ],
            alarm=self._sequential.alarm,
            verdict=list(hypotheses.explanations[self._sequential.verdict]),
            lags_s=list(self._reference.lags_s),
        )
