"""What is wrong now, in words: each verdict by its row of the paper's table 1, and what follows."""

import math
from collections.abc import Collection, Iterable, Sequence

from wackel_diagnoser.absences import Absences
from wackel_diagnoser.commands import Complaint
from wackel_diagnoser.history import BLOCKED, STICKING, History
from wackel_diagnoser.hypotheses import Hypotheses
from wackel_diagnoser.references import ReferenceErrors, WrongZero
from wackel_diagnoser.reports import Finding
from wackel_diagnoser.rows import Rows
from wackel_diagnoser.sequential import Sequential
from wackel_diagnoser.small_faults import SmallFaults
from wackel_diagnoser.verdicts import Verdicts
from wackel_drive.layout import Layout
from wackel_schemas import component
from wackel_schemas.drive import Exclusion

STOOD = ("wheel_blocked", "wheel_sticks")
AGAIN_NS = 30_000_000
"""A wheel that has not stood for so long rolls again."""
_OF_A_FREE_WHEEL = ((component.DRIVE,), (component.COMMAND,))
"""Are no further faults: the others, which do its work, may all slip, and fail to do it."""
HARMLESS = ("gyro_deviates", "wheel_free")
"""Make no other wheel slip: one without torque rolls along."""
AS_OF_A_ZERO = ("gyro_deviates", "drive_disturbed", "wheel_deviates")
"""What a wrong zero of a steering looks like, until several directions have told: the robot turns
otherwise than its wheels say, and they slip."""
LIKELY = 0.02
"""Probability from which on another explanation is told."""
LEAST_CONFIDENCE = 0.5
"""Of a verdict that stands: one that is less probable is about to heal."""
CHANGED = 0.95
"""Of one that a lasting change explains: its part is 400 times as likely as any other, and of
changes that large, chance makes few. What residuals say moment by moment is no doubt of it."""
UNSURE = 0.6
"""At most, of one beside which something is wrong that no reading shows."""


class Findings:
    """Puts into words what the parts of the diagnoser have found.

    Args:
        layout: The drive.
        hypotheses: What a verdict may be.
        rows: How measurements are numbered.
        sequential: How likely each is.
        verdicts: Which holds.
        small: Changes of constants.
        references: Zeros of steerings.
        absences: Who is not heard.
        history: The last seconds of each wheel.
    """

    def __init__(
        self,
        layout: Layout,
        hypotheses: Hypotheses,
        rows: Rows,
        *,
        sequential: Sequential,
        verdicts: Verdicts,
        small: SmallFaults,
        references: ReferenceErrors,
        absences: Absences,
        history: History,
    ) -> None:
        self._names = layout.names
        self._rolling = [component.wheel_drive(layout.names[i]) for i in layout.drive.roll_wheels]
        self._hypotheses = hypotheses
        self._rows = rows
        self._sequential = sequential
        self._verdicts = verdicts
        self._small = small
        self._references = references
        self._absences = absences
        self._history = history
        self._said: dict[str, Finding] = {}  # last, of each drive

    def free(self, off: Sequence[bool], idle: Sequence[bool], now: int) -> list[Finding]:
        """Wheels that roll freely.

        Args:
            off: Which of the rolling motors have no torque.
            idle: Which of them move nothing.
            now: Stamp.
        """
        found = []
        for path, is_off, is_idle in zip(self._rolling, off, idle, strict=True):
            if is_off:
                summary = "its torque is off while that of others is on"
                found.append(Finding("wheel_free", path, summary, now, confidence=0.99))
            elif is_idle:
                summary = "its motor needs no more than to turn by itself while others work"
                found.append(Finding("wheel_free", path, summary, now))
        return found

    def verdict(self, free: Collection[Finding], now: int) -> list[Finding]:
        """What the verdict means, given which wheels roll freely."""
        components = self._verdicts.components
        rolling = {each.component for each in free}
        if rolling and components in _OF_A_FREE_WHEEL:
            return []
        found = []
        for path in components:
            others = [other for other in components if other != path]
            if others and path not in self._verdicts.kinds:
                if path in rolling and not self._verdicts.stands(path):
                    continue
                words = {"others": component.in_words(others[0])}
                summary = "two at once explain the residuals, neither alone"
                found.append(self._finding("two_faults", path, summary, words))
                continue
            one = self._one(path, path in rolling, now)
            # A wheel without torque that swings in its play is no further fault; a blocked one is.
            if path not in rolling or (one.code in STOOD and self._verdicts.stands(path)):
                found.append(one)
        return found

    def reference(self, zero: WrongZero, now: int) -> Finding:
        """A steering whose zero is wrong."""
        angle = f"{math.degrees(zero.angle):+.0f}°"
        return Finding(
            "steering_reference",
            component.wheel_steering(self._names[zero.wheel]),
            f"the robot moves as it would if this stood {angle} off",
            now,
            {"angle_rad": zero.angle, "log_likelihood_ratio": zero.sure},
            {"angle": angle},
        )

    @staticmethod
    def command(complaint: Complaint, now: int) -> Finding:
        """A command that this drive cannot do."""
        words = {"reason": complaint.reason, "wheel": complaint.wheel}
        summary = complaint.reason or f"the centre of rotation is at wheel {complaint.wheel}"
        return Finding(complaint.code, component.COMMAND, summary, now, words=words)

    def _one(self, path: str, is_free: bool, now: int) -> Finding:
        """The verdict on a component whose kind is known, by its row of table 1."""
        place = self._hypotheses.place(path)
        if place is None:
            if path == component.DRIVE:
                return self._finding("drive_disturbed", path, "all wheels slip at once")
            if path == component.COMMAND:
                return self._finding("command_not_followed", path, "the wheels agree on another")
            return self._finding("gyro_deviates", path, "all wheels agree on another yaw rate")
        part, wheel = place
        history, stood, since = self._history, self._said.get(path), self._verdicts.since[path]
        if stood is not None and (stood.since != since or stood.code not in STOOD):
            stood = None
        if stood is not None:
            lately = max(since, now - AGAIN_NS)
            if not history.standing_share(self._rows.roll_of(wheel), lately):
                return stood  # it rolls again: still watched, but with no other fault
        kind = self._verdicts.kinds.get(path)
        if kind == "sensor" and not is_free:
            what = "the gyro and the motors say that the robot moves as the others show"
            return self._finding(f"{'wheel' if part == 'drive' else part}_sensor", path, what)
        if part == "steering":
            if history.steering_frozen(wheel, since):
                stands = "it stands though it is told to turn"
                return self._finding("steering_blocked", path, stands)
            off = math.degrees(history.off(wheel, since))
            if not kind:
                shows = f"it shows {off:+.1f}°; whether it stands so, this motion does not tell"
                return self._finding("steering_deviates", path, shows)
            return self._finding("steering_offset", path, f"it stands {off:+.1f}° off")
        share = history.standing_share(self._rows.roll_of(wheel), since)
        if share is not None and share >= BLOCKED:
            said = self._finding("wheel_blocked", path, "it stands though it is told to roll")
        elif share is not None and (stood is not None or share >= STICKING):
            said = self._finding("wheel_sticks", path, f"it stood for {share:.0%} of the time")
        else:
            said = self._finding("wheel_deviates", path, "it slips against all others")
        self._said[path] = said
        return said

    def _finding(
        self, code: str, path: str, summary: str, words: dict[str, str] | None = None
    ) -> Finding:
        posterior = self._sequential.posterior().tolist()
        hypotheses, verdicts = self._hypotheses, self._verdicts
        here = sum(posterior[i] for i in hypotheses.members[self._sequential.verdict])
        others = [
            (posterior[i], name)
            for i in hypotheses.singles
            if posterior[i] > LIKELY
            for name in hypotheses.each[i].components
            if name != path
        ]
        values: dict[str, float | int | str] = {"probability": round(here, 4)}
        small = self._small.found
        if small is not None and small.component == path:
            values |= {"change": round(small.size, 5), "change_sigma": round(small.sigma, 5)}
            here = max(here, CHANGED)
        if (test := verdicts.tests.get(path)) is not None:
            strain, strained = test.strains
            for name, value in (
                ("gyro_share", test.share[0]),
                ("current_ratio", strain),
                ("others_current_ratio", strained),
            ):
                if math.isfinite(value):
                    values[name] = round(value, 3)
        suspects = [name for _, name in sorted(others, reverse=True)]
        # What is not heard may stand as it pleases.
        unseen = [each for each in self._absences.absent if each != path]
        if code in AS_OF_A_ZERO:
            zeros = self._references.suspects
            unseen += [component.wheel_steering(self._names[wheel]) for wheel in zeros]
        return Finding(
            code,
            path,
            summary,
            verdicts.since[path],
            values,
            words or {},
            min(max(here, LEAST_CONFIDENCE), UNSURE if unseen else 0.99),
            tuple(dict.fromkeys(unseen + suspects)),
        )


def excluded(found: Iterable[Finding]) -> list[Exclusion]:
    """What odometry must not believe."""
    result: dict[str, Exclusion] = {}
    for finding in found:
        if finding.component in (component.DRIVE, component.COMMAND):
            continue
        slips = not (finding.code.endswith("_sensor") or finding.code in HARMLESS)
        result[finding.component] = Exclusion(
            component=finding.component,
            fault="actuator" if slips else "sensor",
            reason=f"{finding.code}: {finding.summary}",
        )
    return list(result.values())
