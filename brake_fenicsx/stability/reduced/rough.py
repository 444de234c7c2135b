"""Products and solves of six digits, at half the price, for what only measures a model's rest."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..complex_columns import times
from ..modes import Complex

Array = NDArray[np.float64]

# Error of a product, over that of the absolute values; of a sum of several products as well.
ROUNDING = 5e-7


class RoughFactor:
    """LU factors in single precision."""

    def __init__(self, lu: tuple[Array, NDArray[np.int32]]):
        """Round the factors that ``scipy.linalg.lu_factor`` gives."""
        with np.errstate(over="ignore"):
            self._lu = lu[0].astype(np.float32), lu[1]

    def solve(self, x: Array, trans: int) -> Array:
        """Solution for columns, each scaled for itself, or that of the transposed matrix."""
        rounded, size = _scaled(x)
        out = la.lu_solve(self._lu, rounded, trans=trans, overwrite_b=True, check_finite=False)
        return np.asarray(out * size)


class Rough:
    """A real matrix in single precision, scaled: moments of high order are below its range."""

    def __init__(self, A: Array):
        """Round the matrix, shape (rows, columns)."""
        self._scale = float(la.norm(A, check_finite=False)) or 1.0
        self._A = np.empty(A.shape, np.float32)
        np.multiply(A, 1.0 / self._scale, out=self._A, casting="same_kind")

    @classmethod
    def _of(cls, A: NDArray[np.float32], scale: float) -> Rough:
        """A matrix that is rounded already, over its scale."""
        out = object.__new__(cls)
        out._A, out._scale = A, scale
        return out

    @property
    def T(self) -> Rough:
        """The transpose."""
        return self._of(self._A.T, self._scale)

    def columns(self, weights: Array, other: Rough, of_other: Array) -> Rough:
        """This matrix with weighted columns, and another one with others; both of one shape."""
        parts = [(self, weights), (other, of_other)]
        scale = sum(A._scale * float(np.abs(w).max(initial=0.0)) for A, w in parts) or 1.0
        first, second = (A._A * (A._scale / scale * w).astype(np.float32) for A, w in parts)
        return self._of(np.add(first, second, out=first), scale)

    def __matmul__(self, x: Array) -> Array:
        """Product with columns, each scaled for itself."""
        rounded, size = _scaled(x)
        return np.asarray((self._A @ rounded) * (self._scale * size))

    def norm(self, x: Complex, Ax: Complex | None = None) -> Array:
        """Root of x^H A x of each column for a positive semi-definite matrix, never too small.

        Args:
            x: shape (columns of the matrix, n).
            Ax: the product, where it is known.
        """
        product = times(self, x) if Ax is None else Ax
        square = np.einsum("im,im->m", x.conj(), product).real
        # |A_ij| <= sqrt(A_ii A_jj).
        most = np.sqrt(self._scale * np.maximum(np.diag(self._A).astype(float), 0.0)) @ np.abs(x)
        return np.asarray(np.sqrt(np.maximum(square, 0.0) + ROUNDING * most**2))


def _scaled(x: Array) -> tuple[NDArray[np.float32], Array]:
    """Columns of largest entry 1 in single precision, and what they were divided by."""
    size = np.maximum(x.max(axis=0, initial=0.0), -x.min(axis=0, initial=0.0))
    size[size == 0] = 1.0
    return np.divide(x, size, out=np.empty(x.shape, np.float32), casting="same_kind"), size
