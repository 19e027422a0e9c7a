"""What is seen, for people: the ``residuals`` message."""

import math
from itertools import compress

import numpy as np

from wackel_diagnoser.bank import Bank
from wackel_diagnoser.hypotheses import Hypotheses
from wackel_diagnoser.reference import Reference, Target
from wackel_diagnoser.rows import Measured, Rows
from wackel_diagnoser.scaling import Scaling
from wackel_diagnoser.sequential import Sequential
from wackel_diagnoser.steps import PaperSteps
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_schemas.residuals import HypothesisState, Residuals, RowState

SHOWN = 5
"""Hypotheses that are published."""


class Display:
    """Makes it.

    Args:
        layout: The drive.
        hypotheses: What a verdict may be.
        rows: How measurements are numbered.
        bank: Which evaluates them.
        scaling: How large residuals usually are, by sensors and by manoeuvres.
        sequential: How likely each hypothesis is.
        reference: What the wheels should do.
    """

    def __init__(
        self,
        layout: Layout,
        hypotheses: Hypotheses,
        rows: Rows,
        *,
        bank: Bank,
        scaling: Scaling,
        sequential: Sequential,
        reference: Reference,
    ) -> None:
        self._paper = PaperSteps(layout)
        self._explanations = hypotheses.explanations
        # How far a fault spoils the rows, of which there are several ways, is not told.
        told = [(hypothesis.components, hypothesis.kind) for hypothesis in hypotheses.each]
        self._told = list(dict.fromkeys(told))
        # The number of what each hypothesis tells.
        self._tells = np.array([self._told.index(each) for each in told])
        self._rows = rows
        self._bank = bank
        self._scaling = scaling
        self._sequential = sequential
        self._reference = reference

    def residuals(self, step: Step, target: Target, measured: Measured) -> Residuals:
        """Of the step that was evaluated last.

        Args:
            step: What the sensors said.
            target: What the wheels should have done.
            measured: The rows of that.
        """
        rows = self._rows
        twist = self._bank.covariance().dot(self._bank.right())
        off = (measured.z - measured.h.dot(twist)).tolist()
        sigma = np.sqrt(measured.spread().variance).tolist()
        scale = np.sqrt(self._scaling.factors[0]).tolist()
        probabilities = np.bincount(self._tells, self._sequential.posterior()).tolist()
        numbers = range(len(probabilities))
        likeliest = sorted(numbers, key=probabilities.__getitem__, reverse=True)[:SHOWN]
        shown = [(probabilities[at], *self._told[at]) for at in likeliest]
        present = measured.present.tolist()
        gyro = list(compress(measured.z[rows.gyros].tolist(), present[rows.gyros]))
        judged = self._paper.judge(
            step.heading,
            step.wheel_rate,
            target.goal if target.known else step.heading,
            target.twist,
            sum(gyro) / len(gyro) if gyro else math.nan,
        )
        return Residuals(
            stamp=step.end,
            commanded=list(target.twist) if target.known else None,
            candidates=self._paper.candidates(judged),
            signature=self._paper.signature(judged),
            redundancy=judged.redundancy,
            steps=self._paper.steps(judged),
            rows=[
                RowState(name=name, residual=r, sigma=s, scale=k)
                for name, r, s, k, there in zip(rows.names, off, sigma, scale, present, strict=True)
                if there
            ],
            hypotheses=[
                HypothesisState(
                    components=list(components), fault=kind, probability=min(probability, 1.0)
                )
                for probability, components, kind in shown
            ],
            alarm=self._sequential.alarm,
            verdict=list(self._explanations[self._sequential.verdict]),
            lags_s=list(self._reference.lags_s),
        )
