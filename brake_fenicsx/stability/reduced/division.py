"""A matrix polynomial with small high coefficients as a quadratic one, by division.

T(z) = T_0 + z T_1 + ... + z^d T_d, whose coefficients beyond T_2 are corrections, is L(z) Q(z) with

    Q(z) = Q_0 + z Q_1 + z^2 Q_2,     L(z) = 1 + z L_1 + ... + z^(d-2) L_(d-2):

the zeros of Q are the zeros of T that matter, with the same right vectors; those of L lie far out.
Equal powers of z give L and Q by a fixed-point iteration, which is exact once it stands still.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..complex_columns import on_parts, unit
from ..modes import Complex

Array = NDArray[np.float64]

STEPS, CONVERGED, TINY = 60, 1e-14, 1e-300

# Steps for b^H L = y^H; each is worth what the corrections are small.
LEFT_STEPS = 6


def quadratic_divisor(T: Sequence[Array]) -> tuple[list[Array], list[Array]]:
    """Q and L of T = L Q.

    Args:
        T: coefficients T_0, T_1, T_2, ..., real, shape (size, size).

    Returns:
        [Q_0, Q_1, Q_2] and [L_1, L_2, ...].

    Raises:
        InaccurateResult: the high coefficients are no corrections.
    """
    zero = np.zeros_like(T[0])
    Q, L = [*T[:3]], [zero for _ in T[3:]]
    for _ in range(STEPS):
        inverse = la.lu_factor(Q[2].T, check_finite=False)
        for j in range(len(L), 0, -1):
            # z^(j+2):  T = L_j Q_2 + L_(j+1) Q_1 + L_(j+2) Q_0.
            above = sum((A @ B for A, B in zip(L[j:], (Q[1], Q[0]), strict=False)), zero)
            L[j - 1] = la.lu_solve(inverse, (T[j + 2] - above).T, check_finite=False).T
        first, second = (L[j] if j < len(L) else zero for j in (0, 1))
        last, Q = Q, [Q[0], T[1] - first @ Q[0], T[2] - second @ Q[0] - first @ Q[1]]
        change = [
            np.abs(A - B).max() / max(np.abs(A).max(), TINY) for A, B in zip(Q, last, strict=True)
        ]
        if max(change) <= CONVERGED:
            return Q, L
        if not np.all(np.isfinite(change)):
            break
    raise InaccurateResult("reduced model: what it leaves out is no small correction")


def quadratic_pairs(
    Q: Sequence[Array], L: Sequence[Array], omega: float
) -> tuple[Complex, Complex, Complex]:
    """All eigenpairs of Q, as those of L Q.

    Args:
        Q: Q_0, Q_1, Q_2.
        L: L_1, L_2, ...
        omega: typical size of an eigenvalue.

    Returns:
        Eigenvalues z, right vectors, Q(z) a = 0, and left ones, b^H L(z) Q(z) = 0, of unit norm.
    """
    size = len(Q[0])
    lu = la.lu_factor(Q[2], check_finite=False)
    below = [-la.lu_solve(lu, Q[j], check_finite=False) * omega ** (j - 2) for j in (0, 1)]
    A = np.block([[np.zeros((size, size)), np.eye(size)], below])
    z, w, v = la.eig(A, left=True, right=True, check_finite=False)
    z = omega * z
    left = first = on_parts(lambda x: la.lu_solve(lu, x, trans=1), w[size:])
    for _ in range(LEFT_STEPS):
        left = first - sum(
            (z.conj() ** (j + 1) * (A.T @ left) for j, A in enumerate(L)), np.zeros_like(first)
        )
    return z, unit(v[:size]), unit(left)
