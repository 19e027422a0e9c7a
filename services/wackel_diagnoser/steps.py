"""The paper's Steps I to IV: candidates, signatures, redundancy, and their verdicts in words.

This is what a person can follow; it does not decide (:mod:`wackel_diagnoser.sequential` does).
Thresholds are fixed, found by experiment, as in the paper.
"""

import math
from itertools import compress
from typing import NamedTuple

import numpy as np

from wackel_drive.layout import Layout
from wackel_kinematics.array import Bools, Floats
from wackel_kinematics.candidates import Candidates
from wackel_kinematics.signatures import as_text, drive_signatures, steering_signatures
from wackel_schemas import component
from wackel_schemas.residuals import Candidate, PaperStep

SPEED = 0.05
"""m/s by which vx and vy of a candidate may miss; of the yaw rate the same by length. Encoder steps
of one cycle at the greatest noise gain that Step I leaves are a third of it."""


class Judgement(NamedTuple):
    """What the four steps say of one moment.

    Attributes:
        twists: Of the candidates, shape (m, 3).
        at_contact, coincident: Step I, singular of kind A and B, shape (m,).
        left: Those that Step I leaves, shape (m,).
        deviates: Step II, shape (m,).
        components: What Step III names, or Step II where that is enough.
        fault: ``sensor`` or ``actuator`` by Step IV; empty where it says nothing.
        texts: A sentence for each step.
    """

    twists: Floats
    at_contact: Bools
    coincident: Bools
    left: Bools
    deviates: Bools
    components: list[str]
    fault: str
    texts: dict[str, str]


class PaperSteps:
    """Applies them.

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
        signatures = np.array([signature for _, signature in suspects], dtype=float)
        # As numbers, so that products of matrices count candidates.
        self._signatures: Floats = signatures.reshape(len(suspects), len(drives[0]))
        self._tolerance = np.array([SPEED, SPEED, SPEED / layout.drive.length_m])
        self.labels = self._candidates.labels

    def judge(
        self, heading: Floats, rate: Floats, goal: Floats, command: Floats, yaw: float
    ) -> Judgement:
        """The steps for one moment.

        Args:
            heading: Measured directions of the wheels, rad, shape (n,); NaN of those that are not
                known, or do not steer.
            rate: Measured wheel rates, rad/s, shape (n,).
            goal: Directions that were commanded, for Step I; NaN where they are not known.
            command: The commanded twist; NaN if none is known.
            yaw: What the gyro shows, rad/s; NaN if there is none.
        """
        candidates, drive = self._candidates, self._drive
        both = heading.tolist(), goal.tolist()
        whole = math.isfinite(sum(map(sum, both)))
        rows, aimed = drive.known_rows(*both) if whole else drive.rows_along(np.array(both))
        twists = candidates.twists(rows, drive.values(rate))
        singular = candidates.singularities(aimed)
        left = ~singular.any & np.isfinite(twists[:, 0])
        texts = {"I": self._text_of_first(singular.at_contact, singular.coincident)}
        off = left & self._apart(twists, command)
        components: list[str] = []
        fault = ""
        if not math.isfinite(sum(command.tolist())):
            texts["II"] = "No command is known to compare with."
        elif not off.any():
            texts["II"] = "All candidates agree with the command."
        else:
            components = self._match(off, left)
            texts["II"] = f"Candidates {as_text(off[left])} miss the command: " + (
                f"the signature of {_words(components)}."
                if components
                else "no signature of a single component."
            )
        if off.any():
            found, consensus = self._consistent(twists, left)
            if found is not None:
                components = found
            texts["III"] = self._text_of_third(found)
            if components and consensus is not None:
                fault, texts["IV"] = self._fourth(consensus, command, yaw)
        return Judgement(twists, *singular, left, off, components, fault, texts)

    def candidates(self, judged: Judgement) -> list[Candidate]:
        """As a message."""
        result = []
        for label, twist, a, b, off in zip(
            self.labels,
            judged.twists.tolist(),
            judged.at_contact.tolist(),
            judged.coincident.tolist(),
            judged.deviates.tolist(),
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
        return as_text(judged.deviates[judged.left])

    @staticmethod
    def steps(judged: Judgement) -> list[PaperStep]:
        """As messages."""
        return [
            PaperStep(
                step=step,
                text=text,
                components=judged.components if step in ("III", "IV") else [],
            )
            for step, text in judged.texts.items()
        ]

    def _apart(self, a: Floats, b: Floats) -> Bools:
        """Whether twists differ by more than a threshold in any component (eq. 10 and 12)."""
        return np.asarray((np.abs(a - b) > self._tolerance).any(axis=-1))

    def _match(self, off: Bools, left: Bools) -> list[str]:
        """Components whose signature the candidates show, some of which are off."""
        same = (self._signatures * left == off).all(axis=1)
        return [self._suspects[i] for i in same.nonzero()[0]]

    def _consistent(self, twists: Floats, left: Bools) -> tuple[list[str] | None, Floats | None]:
        """Step III: components without which all agree, while every candidate with them does not.

        Of several, those that leave the largest set that agrees.
        """
        differs = self._apart(twists[:, None], twists).astype(float)
        with_it = self._signatures * left
        without = left - with_it
        sizes, others = np.add.reduce(without, axis=1), np.add.reduce(with_it, axis=1)
        # How many of those without differ from each candidate.
        differing = without @ differs
        possible = (sizes >= 2) & (others > 0)
        possible &= np.vecdot(differing, without) == 0
        possible &= np.vecdot(differing, with_it) == sizes * others
        if possible.any():
            best = (possible & (sizes == sizes[possible].max())).nonzero()[0]
            return [self._suspects[i] for i in best], _mean(twists[without[best[-1]] > 0])
        agree = not left @ differs @ left
        return (None, _mean(twists[left])) if agree else ([], None)

    def _fourth(self, consensus: Floats, command: Floats, yaw: float) -> tuple[str, str]:
        """Step IV: a sensor if gyro and consensus both match the command, else an actuator."""
        if not math.isfinite(yaw):
            return "", "No gyro to tell a sensor from an actuator."
        follows = bool(not self._apart(consensus, command))
        turns = abs(yaw - command[2]) <= self._tolerance[2]
        if follows and turns:
            return "sensor", "The others and the gyro match the command: its sensor is wrong."
        return "actuator", "The robot does not move as commanded: it is not only a sensor."

    def _text_of_first(self, at_contact: Bools, coincident: Bools) -> str:
        said = [
            f"{', '.join(compress(self.labels, which))} singular ({kind})"
            for kind, which in (("A", at_contact.tolist()), ("B", coincident.tolist()))
            if any(which)
        ]
        return f"Left out: {'; '.join(said)}." if said else "No candidate is singular."

    @staticmethod
    def _text_of_third(found: list[str] | None) -> str:
        if found is None:
            return "All candidates agree with each other, though not with the command."
        if not found:
            return "No single component explains which candidates agree."
        if len(found) == 1:
            return f"All candidates without {_words(found)} agree with each other."
        return f"Candidates agree without {_words(found, ' or without ')}."


def _mean(twists: Floats) -> Floats:
    return np.asarray(np.add.reduce(twists) / len(twists))


def _words(components: list[str], between: str = " or ") -> str:
    return between.join(component.in_words(each) for each in components)
