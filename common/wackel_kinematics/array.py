"""Array types and the two vector operations on the last axis that everything here uses."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
Ints: TypeAlias = NDArray[np.intp]


def cross(a: Floats, b: Floats) -> Floats:
    """Cross product over the last axis (length 3); several times faster than ``numpy.cross``."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    first = a1 * b2 - a2 * b1
    out = np.empty((*first.shape, 3))
    out[..., 0] = first
    np.subtract(a2 * b0, a0 * b2, out=out[..., 1])
    np.subtract(a0 * b1, a1 * b0, out=out[..., 2])
    return out


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar product over the last axis."""
    return np.asarray(np.vecdot(a, b), dtype=np.float64)


def require_finite(values: Floats, name: str) -> None:
    """Rejects what an eigenvalue decomposition would choke on.

    Raises:
        ValueError: A number is not finite.
    """
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite")


def last_axis(values: Floats, length: int, name: str) -> Floats:
    """The values as floats, whose last axis must be as long as stated.

    Raises:
        ValueError: It is not.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] != length:
        raise ValueError(f"{name} has shape {values.shape}, expected (..., {length})")
    return values
