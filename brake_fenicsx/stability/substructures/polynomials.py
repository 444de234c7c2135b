"""Matrix polynomials as arrays of their coefficients, shape (degree + 1, rows, columns).

The zeros of T(z) that matter are those of a right divisor Q of low degree, T = L Q with
L = 1 + z L_1 + ..., found by a fixed point iteration (Dennis, Traub and Weber, SIAM J. Numer. Anal.
15, 1978, doi:10.1137/0715034; Gohberg, Lancaster and Rodman, Matrix Polynomials, 1982): where L has
no zero within reach, none of T is missing. If there is no such divisor, T itself is taken. Zeros
come from the companion matrix of the reversed polynomial w^d Q_0 + ... + Q_d, w = 1/z: the constant
coefficient is regular, the leading one of a truncated series is not (Tisseur and Meerbergen, SIAM
Review 43, 2001, doi:10.1137/S0036144500381988).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import Array, Complex, Index
from brake_fenicsx.iteration import Steps, sizes

from ..eigensolvers.arnoldi import times

Coefficients = Array | Sequence[Array]

# Steps of the division, and the relative change at which it stands still: the zeros of a truncated
# series are corrected afterwards.
STEPS, STILL = 40, 1e-6

# Steps at most for left vectors, b' L = c': each gains a factor of the size of L - 1.
LEFT_STEPS = 16


@dataclass(frozen=True, slots=True)
class Zeros:
    """Zeros of a matrix polynomial, and unit vectors T(z) a = 0 and b' T(z) = 0 of some of them.

    Attributes:
        every: all zeros that were found.
        chosen: places of those whose vectors were computed.
        right: a, shape (size, chosen).
        left: b, not conjugated, likewise.
    """

    every: Complex
    chosen: Index
    right: Complex
    left: Complex

    @property
    def z(self) -> Complex:
        """The chosen zeros."""
        return np.asarray(self.every[self.chosen])

    def taken(self, some: Index) -> Zeros:
        """Some of those that were chosen."""
        return Zeros(self.every, self.chosen[some], self.right[:, some], self.left[:, some])


def zeros(T: Array, degree: int, reach: float, near: Callable[[Complex], Index]) -> Zeros:
    """Zeros of a real matrix polynomial whose constant coefficient is regular.

    Args:
        T: coefficients.
        degree: of the divisor.
        reach: no zero up to this modulus may be missing.
        near: chooses the zeros whose vectors are wanted, all of them within reach.
    """
    if not T.shape[1]:
        none = np.zeros((0, 0), complex)
        return Zeros(none.ravel(), np.zeros(0, dtype=np.intp), none, none)
    divisor = _divided(T, degree, reach) if len(T) - 1 > degree else None
    if divisor is None:
        return _companion(T, near)
    Q, L = divisor
    found = _companion(Q, near)
    left, steps = found.left, Steps(found.left.shape[1], STILL, LEFT_STEPS)
    while steps.moving.any():
        series = [found.z ** (j + 1) * times(A.T, left) for j, A in enumerate(L)]
        new = found.left - np.sum(series, axis=0)
        left = np.where(steps.take(*sizes(new - left, left)), new, left)
    # What is left of them moves the quotient to second order: its products show it.
    return Zeros(found.every, found.chosen, found.right, left / la.norm(left, axis=0))


def _divided(T: Array, degree: int, reach: float) -> tuple[Array, Array] | None:
    """Q and [L_1, L_2, ...] of T = L Q; None where the iteration fails or L has zeros in reach."""
    Q, L = T[: degree + 1].copy(), np.zeros_like(T[degree + 1 :])
    last = np.inf
    for _ in range(STEPS):
        lu = la.lu_factor(Q[degree].T, check_finite=False)
        for j in range(len(L), 0, -1):
            rest = T[j + degree].copy()
            for i in range(j + 1, min(len(L), j + degree) + 1):
                rest -= L[i - 1] @ Q[j + degree - i]
            L[j - 1] = la.lu_solve(lu, rest.T, check_finite=False).T
        new = T[: degree + 1].copy()
        for n in range(degree + 1):
            for i in range(1, min(len(L), n) + 1):
                new[n] -= L[i - 1] @ Q[n - i]
        change = float(np.abs(new - Q).max() / np.abs(new).max())
        Q = new
        if not np.isfinite(change) or change > 10 * last:
            return None
        if change <= STILL:
            size = sum(reach ** (j + 1) * _bound(A) for j, A in enumerate(L))
            return (Q, L) if size < 1 else None
        last = change
    return None


def _bound(A: Array) -> float:
    """Bound of the 2-norm, sharp to the square root of a size."""
    return float(min(la.norm(A), np.sqrt(la.norm(A, 1) * la.norm(A, np.inf))))


def _companion(T: Array, near: Callable[[Complex], Index]) -> Zeros:
    """All finite zeros."""
    degree, n = len(T) - 1, T.shape[1]
    A = np.eye(n * degree, k=n)
    lu = la.lu_factor(T[0], check_finite=False)
    A[-n:] = -la.lu_solve(lu, np.hstack([*T[:0:-1]]), check_finite=False)
    w, left, right = la.eig(A, left=True, right=True, check_finite=False)
    kept = np.flatnonzero(w != 0)
    every = 1 / w[kept]
    chosen = near(every)
    # Right vectors are (x, w x, w^2 x, ...): the last block is never small. Of a left vector u'
    # the last block is b' T_0.
    X, U = right[-n:, kept[chosen]], left[-n:, kept[chosen]].conj()
    b = la.lu_solve(lu, U.real, trans=1) + 1j * la.lu_solve(lu, U.imag, trans=1)
    return Zeros(every, chosen, X / la.norm(X, axis=0), b / la.norm(b, axis=0))


def applied(
    A: Coefficients, z: Complex, X: Complex, transpose: bool = False, kind: type | None = None
) -> Complex:
    """A(z_j) x_j of each column, or A(z_j)' x_j.

    Args:
        A: coefficients, real.
        z: of each column, shape (columns,).
        X: shape (columns or rows of A, columns).
        transpose: whether A is transposed.
        kind: precision of the products; that of each coefficient if None.
    """
    total = None
    for n, coefficient in enumerate(A):
        term = z**n * times(coefficient.T if transpose else coefficient, X, kind)
        total = term if total is None else total + term
    return np.asarray(total)
