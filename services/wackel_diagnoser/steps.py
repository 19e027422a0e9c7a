"""The paper's Steps I to IV: candidates, signatures, redundancy, and their verdicts in words.

This is what a person can follow; it does not decide (:mod:`wackel_diagnoser.sequential` does).
Thresholds are fixed, found by experiment, as in the paper.
"""

import math
from collections.abc import Sequence
from itertools import compress
from operator import not_
from typing import NamedTuple

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.candidates import Candidates
from wackel_kinematics.signatures import as_text, drive_signatures, steering_signatures
from wackel_schemas import component
from wackel_schemas.residuals import Candidate, PaperStep, Redundancy

SPEED = 0.05
"""m/s by which vx and vy of a candidate may miss; of the yaw rate the same by length. Encoder steps
of one cycle at the greatest noise gain that Step I leaves are a third of it."""


class Judgement(NamedTuple):
    """What the four steps say of one moment.

    Attributes:
        twists: Of each of the m candidates; NaN where its rows determine none.
        at_contact, coincident: Step I, which are singular of kind A and B.
        left: Which Step I leaves.
        deviates: Step II, which of those miss the command.
        matched: Whose signature that is.
        redundancy: Step III's conditions; none while no candidate deviates.
        components: What Step III names.
        fault: ``sensor`` or ``actuator`` by Step IV; empty where it says nothing.
        texts: A sentence for each step.
    """

    twists: list[list[float]]
    at_contact: list[bool]
    coincident: list[bool]
    left: list[bool]
    deviates: list[bool]
    matched: list[str]
    redundancy: list[Redundancy]
    components: list[str]
    fault: str
    texts: dict[str, str]


class PaperSteps:
    """Applies them.

    Lists: for some candidates, Python is faster with them than numpy.

    Args:
        layout: The drive; one with fewer than three candidates has no steps to apply.
    """

    def __init__(self, layout: Layout) -> None:
        self._candidates = Candidates(layout.drive)
        self._drive = layout.drive
        names = layout.names
        steers = layout.drive.steers
        drives = drive_signatures(self._candidates)
        steerings = steering_signatures(self._candidates)
        suspects = [
            *((component.wheel_drive(names[i]), drives[i]) for i in range(len(names))),
            *((component.wheel_steering(names[i]), steerings[i]) for i in np.flatnonzero(steers)),
        ]
        suspects = [each for each in suspects if each[1].any()]
        self._suspects = [path for path, _ in suspects]
        # The candidates that each leaves sound: its signature (eq. 11), turned round.
        self._sound: list[list[bool]] = [(~signature).tolist() for _, signature in suspects]
        self._tolerance = SPEED, SPEED, SPEED / layout.drive.length_m
        self.labels = self._candidates.labels

    def judge(
        self,
        heading: Sequence[float],
        rate: Sequence[float],
        goal: Sequence[float],
        command: Sequence[float],
        yaw: float,
    ) -> Judgement:
        """The steps for one moment.

        Args:
            heading: Measured directions of the wheels, rad; NaN of those that are not known, or do
                not steer.
            rate: Measured wheel rates, rad/s.
            goal: Directions that were commanded, for Step I; NaN where they are not known.
            command: The commanded twist; NaN if none is known.
            yaw: What the gyro shows, rad/s; NaN if there is none.
        """
        candidates, drive = self._candidates, self._drive
        both = heading, goal
        whole = math.isfinite(sum(map(sum, both)))
        rows, aimed = drive.known_rows(*both) if whole else drive.rows_along(np.array(both))
        twists = candidates.twists(rows, drive.values(np.array(rate))).tolist()
        at_contact, coincident = (kind.tolist() for kind in candidates.singularities(aimed))
        left = [
            not (a or b) and math.isfinite(twist[0])
            for twist, a, b in zip(twists, at_contact, coincident, strict=True)
        ]
        texts = {"I": self._text_of_first(at_contact, coincident)}
        off = [
            usable and self._apart(twist, command)
            for usable, twist in zip(left, twists, strict=True)
        ]
        matched: list[str] = []
        redundancy: list[Redundancy] = []
        components: list[str] = []
        fault = ""
        if any(off):
            sound = [list(compress(each, left)) for each in self._sound]
            seen = list(compress(off, left))
            matched = self._match(seen, sound)
            texts["II"] = f"Candidates {as_text(seen)} miss the command: " + (
                f"the signature of {_words(matched)}."
                if matched
                else "no signature of a single component."
            )
            usable = list(compress(twists, left))
            redundancy = self._conditions(usable, sound)
            if self._agree(usable):
                texts["III"] = "All candidates agree with each other, though not with the command."
            else:
                components, consensus = self._consistent(usable, sound, redundancy)
                texts["III"] = self._text_of_third(components)
                if components:
                    fault, texts["IV"] = self._fourth(consensus, command, yaw)
        elif math.isfinite(sum(command)):
            texts["II"] = "All candidates agree with the command."
        else:
            texts["II"] = "No command is known to compare with."
        return Judgement(
            twists, at_contact, coincident, left, off, matched, redundancy, components, fault, texts
        )

    def candidates(self, judged: Judgement) -> list[Candidate]:
        """As a message."""
        result = []
        for label, twist, a, b, off in zip(
            self.labels,
            judged.twists,
            judged.at_contact,
            judged.coincident,
            judged.deviates,
            strict=True,
        ):
            known = twist[0] == twist[0]
            vx, vy, omega = twist if known else (None, None, None)
            result.append(
                Candidate(
                    name=label,
                    vx=vx,
                    vy=vy,
                    omega=omega,
                    singular="A" if a else "B" if b else "",
                    deviates=off,
                )
            )
        return result

    @staticmethod
    def signature(judged: Judgement) -> str:
        """Of Step II, as the paper prints it."""
        return as_text(compress(judged.deviates, judged.left))

    @staticmethod
    def steps(judged: Judgement) -> list[PaperStep]:
        """As messages."""
        named = {"II": judged.matched, "III": judged.components, "IV": judged.components}
        return [
            PaperStep(step=step, text=text, components=named.get(step, []))
            for step, text in judged.texts.items()
        ]

    def _apart(self, a: Sequence[float], b: Sequence[float]) -> bool:
        """Whether twists differ by more than a threshold in any component (eq. 10 and 12)."""
        vx, vy, omega = self._tolerance
        return abs(a[0] - b[0]) > vx or abs(a[1] - b[1]) > vy or abs(a[2] - b[2]) > omega

    def _match(self, off: list[bool], sound: list[list[bool]]) -> list[str]:
        """Components whose signature the candidates show, some of which are off."""
        agree = [*map(not_, off)]
        return [path for path, each in zip(self._suspects, sound, strict=True) if each == agree]

    def _conditions(self, twists: list[list[float]], sound: list[list[bool]]) -> list[Redundancy]:
        """Step III, by component.

        Args:
            twists: Of the candidates that Step I leaves.
            sound: Which of those each component leaves sound.
        """
        # Pairs of candidates by the hundred: numpy is faster with them than Python.
        each = np.array(twists)
        far = (np.abs(each[:, None] - each) > self._tolerance).any(axis=2).astype(np.float64)
        inside = np.array(sound, dtype=np.float64)
        outside, sizes = 1.0 - inside, inside.sum(axis=1)
        from_inside = inside @ far
        agree = (sizes >= 2) & (np.vecdot(from_inside, inside) == 0)
        apart = np.vecdot(from_inside, outside) == sizes * outside.sum(axis=1)
        return [
            Redundancy(component=path, agree=agree, apart=apart)
            for path, agree, apart in zip(
                self._suspects, agree.tolist(), apart.tolist(), strict=True
            )
        ]

    def _consistent(
        self, twists: list[list[float]], sound: list[list[bool]], redundancy: list[Redundancy]
    ) -> tuple[list[str], list[float]]:
        """Step III: components without which all agree, while every candidate with them does not.

        Of several, those that leave the largest set that agrees.

        Args:
            twists: Of the candidates that Step I leaves.
            sound: Which of those each component leaves sound.
            redundancy: Of the same components.

        Returns:
            The components, and the twist of the candidates that agree; or neither.
        """
        sizes = [
            sum(each) if holds.agree and holds.apart else 0
            for each, holds in zip(sound, redundancy, strict=True)
        ]
        largest = max(sizes)
        if not largest:
            return [], []
        best = [i for i, size in enumerate(sizes) if size == largest]
        return [self._suspects[i] for i in best], _mean([*compress(twists, sound[best[-1]])])

    def _agree(self, twists: list[list[float]]) -> bool:
        """Whether no two are apart: then the least and the greatest of each component are not."""
        return all(
            max(column) - min(column) <= most
            for column, most in zip(zip(*twists, strict=True), self._tolerance, strict=True)
        )

    def _fourth(
        self, consensus: Sequence[float], command: Sequence[float], yaw: float
    ) -> tuple[str, str]:
        """Step IV: a sensor if gyro and consensus both match the command, else an actuator."""
        if not math.isfinite(yaw):
            return "", "No gyro to tell a sensor from an actuator."
        if not self._apart(consensus, command) and abs(yaw - command[2]) <= self._tolerance[2]:
            return "sensor", "The others and the gyro match the command: its sensor is wrong."
        return "actuator", "The robot does not move as commanded: it is not only a sensor."

    def _text_of_first(self, at_contact: list[bool], coincident: list[bool]) -> str:
        said = [
            f"{', '.join(compress(self.labels, which))} singular ({kind})"
            for kind, which in (("A", at_contact), ("B", coincident))
            if any(which)
        ]
        return f"Left out: {'; '.join(said)}." if said else "No candidate is singular."

    @staticmethod
    def _text_of_third(found: list[str]) -> str:
        if not found:
            return "No single component explains which candidates agree."
        if len(found) == 1:
            return f"All candidates without {_words(found)} agree with each other."
        return f"Candidates agree without {_words(found, ' or without ')}."


def _mean(twists: list[list[float]]) -> list[float]:
    return [sum(column) / len(twists) for column in zip(*twists, strict=True)]


def _words(components: list[str], between: str = " or ") -> str:
    return between.join(component.in_words(each) for each in components)
