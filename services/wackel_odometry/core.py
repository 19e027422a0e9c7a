"""The odometry of one robot: messages in, odometry and fault reports out.

Time is the stamps of the messages, so a recording gives the same as the robot.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import compress
from operator import add, and_, gt, itemgetter, not_

import numpy as np
from msgspec.structs import replace

from wackel_drive.alignment import AHEAD_NS, Alignment, Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.complaints import InputWatch
from wackel_odometry.dispute import Dispute
from wackel_odometry.filter import FIRST_BIAS, OMEGA, POSE, TWIST, Estimate, PlanarFilter
from wackel_odometry.gate import GATE, TOLD, Verdict, gate
from wackel_odometry.gyro_watch import GyroWatch
from wackel_odometry.reports import Complaint, Reports
from wackel_odometry.rows import Measurements, Rows, blocked
from wackel_odometry.slip import SETTLING_S
from wackel_odometry.standstill import REST_SIGMA, Standstill
from wackel_odometry.witness import Witness
from wackel_schemas import component
from wackel_schemas.bus import BusState, BusStatistics
from wackel_schemas.drive import (
    Exclusion,
    Exclusions,
    GyroState,
    ImuSample,
    InputState,
    Odometry,
    OdometryReply,
    OdometryRequest,
    Result,
)
from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Message

BLIND_VARIANCE = (0.2**2, 0.2**2, 0.5**2)
"""Squares of the m/s, m/s and rad/s beyond which a twist is as good as unknown: without any
measurement they are reached in 0.1 s."""
SILENT_NS = 250_000_000
"""Without a step for so long the wheels are silent."""
TELL_NS = 100_000_000
"""How often that is said."""
RELEARN_S = 3.0
"""Of wheels at rest and a gyro that steadily shows something else: nobody turns a robot on its
wheels so evenly, so the bias has jumped."""
UNSEEN_SPEED = 0.5
"""m/s and rad/s at which a robot may have moved during a gap."""
UNSEEN_LONGEST_S = 60.0
ANEW_NS = 1_000_000_000
"""For how long after such a gap it is said that the pose is to be set: until who subscribes has
seen it, and twice what health takes to believe it."""
EXAMINE_NS = 250_000_000
"""How often faults are looked at; all of them need longer to be seen."""
FARTHEST = 1e6
"""m; a pose that is set beyond would have no millimetres left."""

MOST_REASON = 200
"""Characters; each step repeats it."""

UNHEARD = 1e6
"""(rad/s)²: variance of a gyro that says nothing."""
REGULAR = 1e-6 * np.eye(3)
"""For wheels that do not determine the twist."""

GATE_SIGMAS = math.sqrt(GATE)


class Odometer:
    """Pose and twist of a robot.

    Args:
        config: Its drive.
        gyros: By name, as published on ``imu/<name>``.
    """

    def __init__(self, config: DriveConfig, gyros: Mapping[str, GyroConfig]) -> None:
        layout = Layout(config)
        settings = list(gyros.values())
        density = np.array([gyro.noise_density for gyro in settings])
        self._gyros = {name: GyroWatch(gyro) for name, gyro in gyros.items()}
        self._alignment = Alignment(layout, gyros)
        self._rows = Rows(layout, config, gyros)
        self._filter = PlanarFilter(
            # A data sheet's limit is taken for three standard deviations.
            np.array([gyro.bias_limit / 3 for gyro in settings]),
            np.array([gyro.bias_stability for gyro in settings]),
        )
        size = FIRST_BIAS + len(settings)
        self._pose_block, self._twist_block = _submatrix(size, POSE), _submatrix(size, TWIST)
        self._standstill = Standstill(layout.drive.roll_wheels, config.encoder_step, density)
        self._at_rest = np.zeros((3, size))
        self._at_rest[:, TWIST] = np.eye(3)
        self._still, self._still_variance = np.zeros(3), REST_SIGMA**2
        self._reports = Reports()
        self._inputs = InputWatch()
        buses = {bus for wheel in config.wheels for bus, _ in wheel.servos()}
        self._buses = {bus: Witness() for bus in buses}
        self._excluded: list[Exclusion] = []
        self._block(())
        self._slipping = False
        self._dispute, self._length_m = Dispute(), layout.drive.length_m
        self._pulled = 1.0  # factor by which wheels that pull each other are less exact than others
        self._rejections = [0] * len(self._rows.names)
        self._contradicted = [0.0] * len(settings)  # s of each gyro against wheels at rest
        self._latest: Odometry | None = None
        self._examined: int | None = None
        self._silent = False  # the wheels are, and it has been told
        self._told = 0
        self._backlog = False  # samples of gyros wait for wheels, of a fast one more than are kept
        self._lost = ""  # why the pose is
        self._lost_until = math.inf  # UTC ns, unless it is set before

    def bus_state(self, bus: str, state: BusState) -> list[Message]:
        """Takes in what the servos of a bus said.

        Returns:
            Odometry for each step that it completes, and fault reports; numbered by who publishes.
        """
        restarts, before = self._alignment.restarts, self._alignment.done
        taken = self._alignment.bus_state(bus, state)
        if self._alignment.restarts != restarts:
            self._unseen(before or 0, self._alignment.done or 0)
        messages = self._steps() if taken else []
        if self._alignment.refused:
            messages += self._refusals(state.stamp)
        return messages

    def imu(self, name: str, sample: ImuSample) -> list[Message]:
        """Takes in a sample of an inertial sensor; one that is not configured is ignored.

        Returns:
            As :meth:`bus_state`; while the wheels are silent, that the pose is not known.
        """
        watch, stamp = self._gyros.get(name), sample.stamp
        if watch is None:
            return []
        rate = self._alignment.gyro(name, sample)
        sound = True
        if refused := self._alignment.refused:
            why = refused[-1][1]  # the only one: of this sample
            sound = why == "late"
            if why == "flood" and (self._backlog or self._overdue(stamp)):
                self._backlog = True
                refused.clear()
        watch.sample(stamp, sample.angular_velocity, rate, sound, self._alignment.newest)
        messages = self._steps()
        if self._alignment.refused:
            messages += self._refusals(stamp)
        # One that was never in step may have any clock.
        if watch.in_step and watch.witness.waited(stamp, self._alignment.done) >= SILENT_NS:
            messages += self._silence(stamp)
        return messages

    def bus_statistics(self, bus: str, statistics: BusStatistics) -> list[Message]:
        """Takes the time from a bus, whose gateway tells it even while no servo says anything.

        Returns:
            While the wheels are silent, that the pose is not known.
        """
        witness, stamp = self._buses.get(bus), statistics.stamp
        if witness is None or witness.waited(stamp, self._alignment.done) < SILENT_NS:
            return []
        return self._silence(stamp)

    def exclusions(self, message: Exclusions) -> None:
        """Obeys from the next step on; a component that is not there is ignored.

        Of one that is named more than once the last word counts.
        """
        named = {each.component: each for each in message.excluded}
        self._excluded = [
            replace(each, reason=each.reason[:MOST_REASON])
            for each in named.values()
            if self._rows.of_component(each.component) is not None
        ]
        self._block([each.component for each in self._excluded])
        self._slipping = any(each.fault == "actuator" for each in self._excluded)
        if self._dispute.open and not any(self._believed[1]):
            self._filter.turn_back(self._dispute.turned_rad)
            self._dispute.settle(0.0)

    def _block(self, components: Collection[str]) -> None:
        """Rows of these are not used."""
        allowed = self._allowed = [*map(not_, blocked(self._rows, components))]
        self._believed = [allowed[row] for row in self._rows.rolls], allowed[self._rows.wheels :]

    def active(self) -> list[FaultReport]:
        """The faults that are active, in the order in which they began."""
        return self._reports.active()

    def request(
        self, request: OdometryRequest, stamp: int, now: int | None = None
    ) -> OdometryReply:
        """Answers a request.

        Args:
            request: What is asked.
            stamp: Of the answer.
            now: The same in the time of the messages, which in a playback is another.
        """
        now = stamp if now is None else now
        if request.operation == "reset":
            self._place(np.zeros(3), 0.0, 0.0)
            text = "the pose is the origin"
        elif request.operation == "set_pose":
            pose = request.x, request.y, request.theta
            sigmas = request.position_sigma, request.heading_sigma
            if not (
                all(abs(value) <= FARTHEST for value in pose)
                and all(0 <= sigma <= FARTHEST for sigma in sigmas)
            ):
                return OdometryReply(
                    stamp=stamp,
                    ok=False,
                    text=f"pose and sigmas must be numbers up to {FARTHEST:g}, sigmas from 0 up",
                    odometry=self._as_of(now),
                )
            self._place(np.array(pose), *sigmas)
            text = f"the pose is {request.x:g} m, {request.y:g} m, {request.theta:g} rad"
        else:
            text = "the latest" if self._latest is not None else "no step has been made yet"
        return OdometryReply(stamp=stamp, ok=True, text=text, odometry=self._as_of(now))

    def _steps(self) -> list[Message]:
        messages: list[Message] = []
        while (step := self._alignment.step()) is not None:
            messages.append(self._step(step))
            messages += self._examine(step.end)
        return messages

    def _step(self, step: Step) -> Odometry:
        rates = zip(self._gyros.values(), step.gyro_rate, strict=True)
        usable_rates = [watch.usable(step, rate) for watch, rate in rates]
        if usable_rates != step.gyro_rate:
            step = replace(step, gyro_rate=usable_rates)
        self._silent = self._backlog = False
        estimator = self._filter
        estimator.seconds = step.seconds
        if self._latest is not None and self._latest.standing:
            estimator.may_start()
        estimator.predict()
        rows = self._rows.measure(step, estimator.x[TWIST], self._slipping)
        usable = rows.present
        if self._excluded:
            usable = [*map(and_, usable, self._allowed)]
        resting = self._standstill.step(step, *self._believed)
        if not self._standstill.wheels_s:
            self._contradicted = [0.0] * len(self._contradicted)
        verdict = self._rest(rows, usable, step.seconds) if resting else None
        standing = verdict is not None
        if verdict is None:
            verdict = self._move(rows, usable, step.seconds)
        else:
            self._dispute.settle(step.seconds)
        estimate = estimator.estimate()
        self._watch_gyros(rows, usable, verdict, step, estimate.x, standing=standing)
        if not estimate.sound:
            estimator.restart()
            estimate = estimator.estimate()
            self._lost = "the arithmetic has failed; the pose starts anew"
            self._lost_until = math.inf
        elif self._lost and step.end >= self._lost_until:
            self._lost = ""
        self._latest = self._odometry(step, rows, usable, verdict, estimate, standing=standing)
        return self._latest

    def _move(self, rows: Measurements, usable: list[bool], seconds: float) -> Verdict:
        """Takes in what passes the gates."""
        estimator, z, h, noise = self._filter, rows.z, rows.h, rows.at_once
        first, whole = self._rows.wheels, all(usable)
        if not whole:
            first = sum(usable[:first])
            z, h, noise = z[usable], h[usable], noise[np.ix_(usable, usable)]
        measured = estimator.expect(z, h)
        before = 1.0 + (self._pulled - 1.0) * math.exp(-seconds / SETTLING_S)
        judge = partial(gate, before=before, most=rows.most_pulled)
        verdict = judge(measured.innovation, measured.spread, noise)
        heard, extra = verdict.accepted[first:], None
        if self._dispute.open or (heard and not any(heard)):
            off = measured.innovation
            extra = self._disputed(z, h, noise.diagonal(), off, first=first, seconds=seconds)
        else:
            self._dispute.settle(seconds)
        if extra is not None:
            measured = estimator.expect(z, h)
            after = judge(measured.innovation, measured.spread, noise + extra)
            # What gyros contradict is told as it was before.
            verdict = replace(
                after,
                innovation=after.innovation[:first] + verdict.innovation[first:],
                sigma=after.sigma[:first] + verdict.sigma[first:],
            )
        self._pulled = verdict.pulled
        lasting = self._rows.widened(rows, verdict.pulled, seconds)
        if not whole:
            lasting = lasting[np.ix_(usable, usable)]
        if extra is not None:
            lasting = lasting + extra
        if not all(verdict.accepted):
            kept = np.array(verdict.accepted)
            measured, lasting = measured.only(kept), lasting[np.ix_(kept, kept)]
        if len(lasting):
            estimator.correct(measured, lasting, learn_bias=False)
        return verdict

    def _disputed(
        self, z: Floats, h: Floats, variance: Floats, off: Floats, *, first: int, seconds: float
    ) -> Floats | None:
        """By what errors of those who are wrong are larger where gyros contradict all wheels.

        Args:
            z, h, variance: Of measurements.
            off: How far they are from what was predicted.
            first: Number of the first gyro among them.
            seconds: Of the step.

        Returns:
            Covariance that R lacks, shape (m, m).
        """
        # What the wheels say by themselves: what is predicted has followed who was believed.
        rows = h[:first, TWIST]
        weighed = rows.T / variance[:first]
        covariance = np.linalg.inv(weighed @ rows + REGULAR)
        omega = covariance[2] @ weighed @ z[:first]
        biases = h[first:, FIRST_BIAS:] @ self._filter.x[FIRST_BIAS:]
        against = z[first:] - biases - omega
        if not len(against):
            return None  # there is no sample for a moment
        if (against**2 <= GATE * (covariance[2, 2] + variance[first:])).any():
            self._dispute.settle(seconds)
            return None
        wrong = self._dispute.step(
            against.tolist(), off[first:].tolist(), seconds, dragged=self._slipping
        )
        if not wrong:
            return None
        extra = np.zeros(len(z))
        if wrong == "wheels":
            # All slip together: with it they say no more than as many rows as there are unknowns.
            slip = float(np.abs(against).min()) * self._length_m
            extra[:first] = slip * slip * max(first / TOLD, 1.0)
        else:
            extra[first:] = UNHEARD
            self._filter.turn_back(self._dispute.turned_rad)
        return np.diag(extra)

    def _rest(self, rows: Measurements, usable: list[bool], seconds: float) -> Verdict | None:
        """Takes the robot to stand still; ``None`` if a gyro contradicts."""
        estimator, first = self._filter, self._rows.wheels
        heard = usable[first:]
        off, sigma = self._off(rows, heard)
        contradicts = [
            abs(each) > GATE_SIGMAS * wide for each, wide in zip(off, sigma, strict=True)
        ]
        for number, contradicted in enumerate(contradicts):
            self._contradicted[number] += seconds
            if not contradicted:
                self._contradicted[number] = 0.0
            elif self._contradicted[number] >= RELEARN_S:
                estimator.forget_bias(number, off[number])
                self._contradicted[number] = 0.0
        if any(contradicts):
            return None
        z, h, variance = self._still, self._at_rest, self._still_variance
        if any(heard):
            gyros = [first + number for number, each in enumerate(heard) if each]
            z = np.concatenate((z, rows.z[gyros]))
            h = np.concatenate((h, rows.h[gyros]))
            variance = np.concatenate((variance, [rows.white[each] for each in gyros]))
        estimator.correct(estimator.expect(z, h), np.diag(variance), learn_bias=True)
        innovation = [*rows.values[:first], *off]
        spread = [*map(math.sqrt, rows.white[:first]), *sigma]
        if usable is not self._rows.every:
            innovation, spread = [*compress(innovation, usable)], [*compress(spread, usable)]
        return Verdict([True] * len(innovation), innovation, spread)

    def _off(self, rows: Measurements, heard: list[bool]) -> tuple[list[float], list[float]]:
        """What each gyro shows beyond its bias, 0 where it is not used; and how far it may be."""
        first, estimator = self._rows.wheels, self._filter
        biases = estimator.x[FIRST_BIAS:].tolist()
        variances = estimator.P.diagonal()[FIRST_BIAS:].tolist()
        shown = zip(rows.values[first:], biases, heard, strict=True)
        off = [rate - bias if used else 0.0 for rate, bias, used in shown]
        return off, [*map(math.sqrt, map(add, variances, rows.white[first:]))]

    def _watch_gyros(
        self,
        rows: Measurements,
        usable: list[bool],
        verdict: Verdict,
        step: Step,
        x: list[float],
        *,
        standing: bool,
    ) -> None:
        """Holds each gyro against the yaw rate that the rest says, which its innovation leaves."""
        if self._gyros:
            first = self._rows.wheels
            shown = rows.values[first:]
            for i, watch in enumerate(self._gyros.values()):
                bias, others = x[FIRST_BIAS + i], x[OMEGA]
                if standing:
                    others = 0.0  # else a bias that is learned looks like a turn
                elif usable[first + i]:
                    at = sum(usable[: first + i])  # among those that were judged
                    known = verdict.sigma[at] ** 2 < BLIND_VARIANCE[2]
                    others = shown[i] - bias - verdict.innovation[at] if known else math.nan
                watch.step(step, others, shown[i], bias)

    def _odometry(
        self,
        step: Step,
        rows: Measurements,
        usable: list[bool],
        verdict: Verdict,
        estimate: Estimate,
        *,
        standing: bool,
    ) -> Odometry:
        covariance, variances = estimate.covariance, estimate.variances
        inputs = self._input_states(usable, verdict)
        reason = self._lost
        if any(map(gt, variances[TWIST], BLIND_VARIANCE)):
            reason = f"too few inputs: {_left_out(inputs)}"
        done, newest = step.end, self._alignment.newest or step.end
        px, py, theta, vx, vy, omega, *biases = estimate.x
        return Odometry(
            stamp=done,
            x=px,
            y=py,
            theta=math.remainder(theta, math.tau),
            vx=vx,
            vy=vy,
            omega=omega,
            pose_covariance=[*self._pose_block(covariance)],
            twist_covariance=[*self._twist_block(covariance)],
            valid=not reason,
            reason=reason,
            age_s=max(newest - done, 0) / 1e9,
            standing=standing,
            gyros=[
                GyroState(name=name, bias=bias, sigma=math.sqrt(variance))
                for name, bias, variance in zip(
                    self._gyros, biases, variances[FIRST_BIAS:], strict=True
                )
            ],
            inputs=inputs,
            slip=self._rows.slip(rows, self._filter.x),
            excluded=self._excluded,
            discarded={
                f"{source}: {why}": count for (source, why), count in self._alignment.counts.items()
            },
            restarts=self._alignment.restarts,
        )

    def _input_states(self, usable: list[bool], verdict: Verdict) -> list[InputState]:
        judged = zip(verdict.accepted, verdict.innovation, verdict.sigma, strict=True)
        missing = False, None, None
        told = judged if all(usable) else [next(judged) if used else missing for used in usable]
        states, rejections = [], self._rejections
        for i, (name, (accepted, innovation, sigma)) in enumerate(
            zip(self._rows.names, told, strict=True)
        ):
            result: Result = "used"
            if not accepted:
                if usable[i]:
                    rejections[i] += 1
                    result = "rejected"
                else:
                    result = "missing" if self._allowed[i] else "excluded"
            states.append(
                InputState(
                    name=name,
                    result=result,
                    innovation=innovation,
                    sigma=sigma,
                    rejections=rejections[i],
                )
            )
        return states

    def _place(self, pose: Floats, position_sigma: float, heading_sigma: float) -> None:
        """Sets the pose, in the latest odometry, too; with that it is no longer lost."""
        self._filter.set_pose(pose, position_sigma, heading_sigma)
        self._dispute.settle(0.0)
        lost, self._lost = self._lost, ""
        if (latest := self._latest) is None:
            return
        px, py, theta = self._filter.x[POSE].tolist()
        reason = "" if latest.reason == lost else latest.reason
        self._latest = replace(
            latest,
            x=px,
            y=py,
            theta=math.remainder(theta, math.tau),
            pose_covariance=self._filter.P[POSE, POSE].ravel().tolist(),
            valid=not reason,
            reason=reason,
        )

    def _examine(self, now: int) -> list[FaultReport]:
        """Faults as of the end of a step."""
        # On a grid of the stamps: when it is looked does not depend on when the service started.
        if self._examined == now // EXAMINE_NS:
            return []
        self._examined = now // EXAMINE_NS
        found = self._inputs.complaints(now)
        biases = self._filter.x[FIRST_BIAS:].tolist()
        sigmas = np.sqrt(self._filter.P.diagonal()[FIRST_BIAS:]).tolist()
        for (name, watch), bias, sigma in zip(self._gyros.items(), biases, sigmas, strict=True):
            path = component.gyro(name)
            found[path] = found.get(path, []) + watch.complaints(now, bias, sigma)
        reason = self._latest.reason if self._latest is not None else ""
        found[component.ODOMETRY] = [_pose_unknown(reason)] if reason else []
        return [
            report
            for path, complaints in found.items()
            for report in self._reports.update(path, complaints, now)
        ]

    def _refusals(self, now: int) -> list[FaultReport]:
        """What is wrong with samples that have just come; told even where no step is made."""
        now = self._alignment.newest or now
        self._inputs.refuse(self._alignment.refused, now)
        self._alignment.refused.clear()
        return [
            report
            for path, complaints in self._inputs.complaints(now).items()
            if complaints
            for report in self._reports.begin(path, complaints, now)
        ]

    def _silence(self, now: int) -> list[Message]:
        """Says now and then, on the time of one who goes on, that the wheels say nothing."""
        if not self._overdue(now) or (self._silent and 0 <= now - self._told < TELL_NS):
            return []
        self._silent, self._told = True, now
        self._latest = self._as_of(now)
        # A report stays as it began, so it does not tell for how long.
        complaint = _pose_unknown("the wheels say nothing")
        reports = self._reports.begin(component.ODOMETRY, [complaint], now)
        return [*([] if self._latest is None else [self._latest]), *reports]

    def _overdue(self, now: int) -> bool:
        """Whether there should have been a step by now."""
        done = self._alignment.done
        # Of a little before the latest step may be what a gyro tells late.
        return done is None or not -AHEAD_NS < now - done < SILENT_NS

    def _as_of(self, now: int) -> Odometry | None:
        """The latest, as old as it is by now."""
        latest, done = self._latest, self._alignment.done
        if latest is None or done is None:
            return latest
        age_s = max(now - done, 0) / 1e9
        if not self._overdue(now):
            return replace(latest, age_s=age_s) if age_s else latest
        lasts = f"for {age_s:.1f} s" if age_s else "since the clock was set back"
        reason = f"the wheels have said nothing {lasts}"
        return replace(latest, valid=False, reason=reason, age_s=age_s)

    def _unseen(self, before: int, after: int) -> None:
        """Time was started anew: the robot may have moved meanwhile."""
        seconds = abs(after - before) / 1e9
        gap_s = min(seconds, UNSEEN_LONGEST_S)
        self._filter.widen_pose(UNSEEN_SPEED * gap_s, UNSEEN_SPEED * gap_s)
        way = "on" if after > before else "back"
        self._lost = f"time went {way} by {seconds:.1f} s at once; the robot may have moved unseen"
        self._lost_until = after + ANEW_NS


def _submatrix(size: int, block: slice) -> Callable[[Sequence[float]], tuple[float, ...]]:
    """Takes rows and columns out of a square matrix, row by row, from its numbers, row by row."""
    return itemgetter(*np.arange(size * size).reshape(size, size)[block, block].ravel().tolist())


def _pose_unknown(reason: str) -> Complaint:
    return Complaint("pose_unknown", reason, {}, {"reason": reason})


def _left_out(inputs: list[InputState]) -> str:
    """The inputs that are not used, by why; a wheel is named once where that is so of both rows."""
    by_result: dict[Result, list[str]] = {}
    for each in inputs:
        if each.result != "used":
            by_result.setdefault(each.result, []).append(each.name)
    return "; ".join(f"{why} {', '.join(_shortened(names))}" for why, names in by_result.items())


def _shortened(names: list[str]) -> list[str]:
    wheels = Counter(name.rpartition("/")[0] for name in names if name.startswith("wheel/"))
    whole = [name.rpartition("/")[0] for name in names]
    return list(
        dict.fromkeys(
            wheel if wheels[wheel] > 1 else name for wheel, name in zip(whole, names, strict=True)
        )
    )
