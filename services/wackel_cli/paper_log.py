"""What was heard of the paper's experiment, and what it says: pure, time by stamps.

The paper: Rienmüller, Gruber, Hofbaur, "Odometriebasierte Fehlerdiagnose für quasiomnidirektionale
mobile Radroboter", section 5.
"""

from collections import Counter
from collections.abc import Sequence
from statistics import fmean

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.inverse import inverse
from wackel_node.config_drive import DriveConfig
from wackel_schemas.bus import BusState
from wackel_schemas.drive import ImuSample, TwistCommand
from wackel_schemas.fault import FaultReport
from wackel_schemas.residuals import Residuals

BLOCKED_S = 36.0
"""When wheel 3 is blocked (paper, section 5)."""
END_S = 52.0
"""The paper shows candidates at 49 s."""
FREE_PHASE_S = (15.0, BLOCKED_S - 0.5)
"""Fast enough for thresholds in m/s to mean something, and before the block."""
BLOCKED_PHASE_S = (BLOCKED_S + 1.0, END_S)
NOTHING = "names nothing"
EXPECTED = "000101"
"""Signature of the rate of wheel 3 (paper, section 4.2)."""


class PaperLog:
    """The experiment as its topics tell it; times in s since the first command.

    Args:
        drive: Of the robot.

    Attributes:
        times: Of the states.
        rates: Of the wheels at those, rad/s, absent as NaN.
        wanted: What the commanded twists want of the wheels, times and rad/s.
        residuals: With their times.
        faults: Confirmed and healed, with their times.
        yaw_rates: Of the gyro, with their times, rad/s.
        wanted_yaw_rates: Of the commands, with their times, rad/s.
    """

    def __init__(self, drive: DriveConfig) -> None:
        self._layout = Layout(drive)
        self._steering = self._layout.drive.steering(np.zeros(self._layout.drive.n))
        self._start_ns: int | None = None
        self.times: list[float] = []
        self.rates: list[list[float]] = []
        self.wanted: list[tuple[float, list[float]]] = []
        self.residuals: list[tuple[float, Residuals]] = []
        self.faults: list[tuple[float, FaultReport]] = []
        self.yaw_rates: list[tuple[float, float]] = []
        self.wanted_yaw_rates: list[tuple[float, float]] = []

    @property
    def started(self) -> bool:
        """Whether a command has come."""
        return self._start_ns is not None

    @property
    def now_s(self) -> float:
        """Time of the last state."""
        return self.times[-1] if self.times else 0.0

    def on_command(self, command: TwistCommand) -> None:
        """Takes in what is asked of the drive."""
        if self._start_ns is None:
            self._start_ns = command.stamp
        twist = np.array([command.vx, command.vy, command.omega])
        motion = inverse(self._layout.drive, twist, self._steering)
        self._steering = motion.steering
        self.wanted.append((self._since(command.stamp), motion.wheel_rate.tolist()))
        self.wanted_yaw_rates.append((self._since(command.stamp), command.omega))

    def on_state(self, state: BusState) -> None:
        """Takes in what the servos do."""
        shown = {servo.id: servo.velocity for servo in state.servos}
        joints = [joint for joint in self._layout.rolling if joint is not None]
        rates = [shown.get(joint.servo.id) for joint in joints]
        if self.started and any(rate is not None for rate in rates):
            self.times.append(self._since(state.stamp))
            self.rates.append(
                [
                    float("nan") if rate is None else joint.sign * rate
                    for joint, rate in zip(joints, rates, strict=True)
                ]
            )

    def on_residuals(self, residuals: Residuals) -> None:
        """Takes in what the diagnoser sees."""
        if self.started:
            self.residuals.append((self._since(residuals.stamp), residuals))

    def on_fault(self, report: FaultReport) -> None:
        """Takes in what it concludes."""
        if self.started and not report.repeated:
            self.faults.append((self._since(report.stamp), report))

    def on_imu(self, sample: ImuSample) -> None:
        """Takes in how the robot turns."""
        if self.started:
            self.yaw_rates.append((self._since(sample.stamp), sample.angular_velocity[2]))

    def between(self, phase: tuple[float, float]) -> list[tuple[float, Residuals]]:
        """The residuals of a phase."""
        return [each for each in self.residuals if phase[0] <= each[0] <= phase[1]]

    def at(self, time_s: float) -> Residuals | None:
        """The residuals nearest to a time."""
        if not self.residuals:
            return None
        return min(self.residuals, key=lambda each: abs(each[0] - time_s))[1]

    def swinging(self) -> Residuals | None:
        """Of the free phase, what shows the paper's signature best, if anything does."""
        phase = self.between(FREE_PHASE_S)
        telling = [each for _, each in phase if each.signature == EXPECTED]
        return max(telling or [each for _, each in phase], key=_swing, default=None)

    def mean_rates(self, phase: tuple[float, float]) -> Floats:
        """Mean speed of each wheel by what was wanted of it; NaN where nothing was heard."""
        shown = [
            rates
            for at, rates in zip(self.times, self.rates, strict=True)
            if phase[0] <= at <= phase[1]
        ]
        wanted = [rates for at, rates in self.wanted if phase[0] <= at <= phase[1]]
        if not shown or not wanted:
            return np.full(len(self._layout.names), np.nan)
        shares: Floats = np.nanmean(shown, axis=0) / np.mean(wanted, axis=0)
        return shares

    def mean_yaw(self, phase: tuple[float, float]) -> float:
        """Mean yaw rate by the gyro by what was wanted; NaN where nothing was heard."""
        turns = [rate for at, rate in self.yaw_rates if phase[0] <= at <= phase[1]]
        wanted = [rate for at, rate in self.wanted_yaw_rates if phase[0] <= at <= phase[1]]
        return fmean(turns) / fmean(wanted) if turns and any(wanted) else float("nan")

    def _since(self, stamp: int) -> float:
        return (stamp - (self._start_ns or stamp)) / 1e9


def _swing(residuals: Residuals) -> float:
    """How far the candidates that use the rate of wheel 3 miss the command, m/s."""
    wanted = (residuals.commanded or [0.0])[0]
    return max(
        (
            abs(candidate.vx - wanted)
            for candidate in residuals.candidates
            if candidate.vx is not None and candidate.name.endswith(";3)")
        ),
        default=0.0,
    )


def signatures(residuals: Sequence[tuple[float, Residuals]]) -> list[tuple[str, float]]:
    """Signatures by share, the most frequent first."""
    counts = Counter(each.signature for _, each in residuals)
    return [(name, count / len(residuals)) for name, count in counts.most_common()]


def verdicts(residuals: Sequence[tuple[float, Residuals]], step: str) -> dict[str, float]:
    """What a step of the paper names, and what it says of it, by share of the residuals."""
    counts: Counter[str] = Counter()
    for _, each in residuals:
        found = [s for s in each.steps if s.step == step and s.components]
        counts[f"{' or '.join(found[0].components)}: {found[0].text}" if found else NOTHING] += 1
    return {words: count / len(residuals) for words, count in counts.most_common()}
