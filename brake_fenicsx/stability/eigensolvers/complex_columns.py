"""Complex columns in real arithmetic: without complex copies of real matrices or Krylov bases."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


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


def times(A: Operator, x: NDArray[Any]) -> Complex:
    """A x for real A."""
    return on_parts(A.__matmul__, x)


def with_conjugates(values: Complex, X: Complex) -> tuple[Complex, Complex]:
    """Both of each conjugate pair of eigenvalues, and their vectors."""
    pairs = values.imag != 0
    return np.r_[values, values[pairs].conj()], np.hstack([X, X[:, pairs].conj()])
