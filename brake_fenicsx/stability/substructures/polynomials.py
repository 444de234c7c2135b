"""Matrix polynomials as arrays of their coefficients, shape (degree + 1, rows, columns).

Zeros come from the companion matrix of the reversed polynomial w^d T_0 + ... + T_d, w = 1/z: the
constant coefficient is regular, the leading one of a truncated series is not (Tisseur and
Meerbergen, SIAM Review 43, 2001, doi:10.1137/S0036144500381988; Gohberg, Lancaster and Rodman,
Matrix Polynomials, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..complex_columns import times
from ..modes import Complex

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Zeros:
    """Zeros of a matrix polynomial T(z), with unit vectors T(z) a = 0 and b' T(z) = 0.

    Attributes:
        z: shape (zeros,).
        right: a, shape (size, zeros).
        left: b, not conjugated, likewise.
    """

    z: Complex
    right: Complex
    left: Complex


def zeros(T: Array) -> Zeros:
    """All finite zeros of a real matrix polynomial whose constant coefficient is regular."""
    degree, n = len(T) - 1, T.shape[1]
    A = np.eye(n * degree, k=n)
    lu = la.lu_factor(T[0], check_finite=False)
    A[-n:] = -la.lu_solve(lu, np.hstack([*T[:0:-1]]), check_finite=False)
    w, left, right = la.eig(A, left=True, right=True, check_finite=False)
    kept = w != 0
    # Right vectors are (x, w x, w^2 x, ...): the last block is never small. Of a left vector u'
    # the last block is b' T_0.
    X, U = right[-n:, kept], left[-n:, kept].conj()
    b = la.lu_solve(lu, U.real, trans=1) + 1j * la.lu_solve(lu, U.imag, trans=1)
    return Zeros(1 / w[kept], X / la.norm(X, axis=0), b / la.norm(b, axis=0))


def applied(A: Array, z: Complex, X: Complex, transpose: bool = False) -> Complex:
    """A(z_j) x_j of each column, or A(z_j)' x_j.

    Args:
        A: coefficients, real.
        z: of each column, shape (columns,).
        X: shape (columns or rows of A, columns).
        transpose: whether A is transposed.
    """
    total = None
    for n, coefficient in enumerate(A):
        term = z**n * times(coefficient.T if transpose else coefficient, X)
        total = term if total is None else total + term
    return np.asarray(total)
