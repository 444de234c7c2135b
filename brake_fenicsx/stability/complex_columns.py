"""Real operators on complex columns, in real arithmetic and without complex copies of matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .modes import Complex

Array = NDArray[np.float64]


class Operator(Protocol):
    """What multiplies real columns: a dense or sparse matrix."""

    def __matmul__(self, x: Array, /) -> Array:
        """Product with columns, shape (columns of the matrix, n)."""


def on_parts(real: Callable[[Array], Array], x: Complex) -> Complex:
    """A real operator on complex columns: of imaginary parts only those that are there."""
    n, turned = x.shape[1], np.flatnonzero(np.any(x.imag != 0, axis=0))
    product = real(np.hstack([x.real, x.imag[:, turned]]))
    out = product[:, :n].astype(complex)
    out[:, turned] += 1j * product[:, n:]
    return out


def times(A: Operator, x: Complex) -> Complex:
    """A x for real A."""
    return on_parts(A.__matmul__, x)


def series_answer(
    solve: Callable[[Complex], Complex],
    C1: Operator,
    C2: Operator,
    z: Complex,
    x: Complex,
    terms: int,
) -> Complex:
    """(C0 + z C1 + z^2 C2)^-1 x by a series in z.

    Args:
        solve: C0^-1.
        C1: first coefficient.
        C2: second one.
        z: of each column, shape (columns,).
        x: shape (rows, columns).
        terms: of the series, beyond the first.
    """
    out = first = solve(x)
    for _ in range(terms):
        out = first - solve(z * times(C1, out) + z**2 * times(C2, out))
    return out


def unit(x: Complex) -> Complex:
    """Columns of unit norm."""
    return np.asarray(x / np.linalg.norm(x, axis=0))
