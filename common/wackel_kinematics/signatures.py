"""Fault signatures (eq. 11): which candidates a faulty component spoils.

Component i of the drive or the steering means the mechanical part and its sensor together. Two
components at once spoil the union of their signatures.
"""

from collections.abc import Iterable

import numpy as np

from wackel_kinematics.array import Bools, Ints
from wackel_kinematics.candidates import Candidates


def drive_signatures(candidates: Candidates) -> Bools:
    """D_i: candidates that use the wheel rate of i, i = w; shape (n, m)."""
    spoilt: Bools = _wheels(candidates) == candidates.w
    return spoilt


def steering_signatures(candidates: Candidates) -> Bools:
    """S_i: candidates that use the steering angle of i, i ∈ {k, l}; shape (n, m)."""
    wheels = _wheels(candidates)
    spoilt: Bools = (wheels == candidates.k) | (wheels == candidates.l)
    return spoilt


def as_text(signature: Iterable[bool]) -> str:
    """A signature as the paper prints it: ``000101``."""
    return "".join(["1" if bit else "0" for bit in signature])


def _wheels(candidates: Candidates) -> Ints:
    return np.arange(candidates.drive.n)[:, None]
