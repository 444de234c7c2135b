"""Full order with damping for large matrices, in real arithmetic.

lambda^2 M + lambda C + K is factored once at a small positive shift s, which is real: with
theta = 1 / (lambda - s) and the state (x, v), v = lambda x / omega, the linearised problem reads

    theta x = -P(s)^-1 ((C + s M) x + omega M v),     theta v = (x + s theta x) / omega,

P(s) = s^2 M + s C + K. Block Arnoldi finds its largest theta, that is the modes nearest to s: both
of each conjugate pair, so that the Krylov space is about twice that of the undamped problem. Left
vectors are the conjugate right ones of the transposed matrices; of symmetric ones they are at hand.

Reference: F. Tisseur and K. Meerbergen, SIAM Review 43 (2001) 235, doi:10.1137/S0036144500381988.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.solver import Factor

from ..eigensolvers.arnoldi import nearest_modes
from ..eigensolvers.complex_columns import with_conjugates
from ..eigensolvers.eigenpairs import QuadraticPencil, matched
from ..eigensolvers.regions import RIM
from ..eigensolvers.symmetric import SHIFT, count_below

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def quadratic_modes(
    p: QuadraticPencil, high: float, zeta_max: float
) -> tuple[Complex, Complex, Complex, int]:
    """All modes with |lambda| up to the far corners of the region that is counted, and conjugates.

    Those that decay faster than the region reaches are left out.

    Args:
        p: the problem, with damping.
        high: highest omega [rad/s].
        zeta_max: largest damping ratio looked for.

    Returns:
        lambda [1/s], right and left vectors, block solves.

    Raises:
        NotConverged: the Krylov space fills without convergence.
        InaccurateResult: a right vector has no left one.
    """
    M, C, K = (sp.csr_matrix(A) for A in (p.M, p.C, p.K))
    count, _ = count_below((0.5 * (K + K.T)).tocsr(), M, (RIM * high) ** 2)
    s = np.sqrt(SHIFT) * high
    # The edges of that region may lie beyond the band by RIM.
    reach = RIM * high / np.sqrt(1 - zeta_max**2) + s
    leftmost = -RIM * high * zeta_max / np.sqrt(1 - zeta_max**2)
    sides = []
    for A in ((M, C, K), (M.T.tocsr(), C.T.tocsr(), K.T.tocsr())):
        apply, lu = _operator(*A, s, high)
        n = 2 * K.shape[0]
        # A little further, so that each of the right ones has its left one.
        found, X, steps = nearest_modes(apply, n, s, RIM * reach, 2 * count + 2, RIM * leftmost)
        lu.destroy()
        sides.append((*with_conjugates(found, X[: n // 2]), steps))
        if _symmetric(C) and _symmetric(K):
            sides.append(sides[0])
            break
    (found, right, steps), (other, left, more) = sides
    i, j = matched(found, other, s, reach, leftmost)
    return found[i], right[:, i], left[:, j].conj(), steps + more


def _symmetric(A: sp.spmatrix) -> bool:
    return bool(abs(A - A.T).max() <= 1e-12 * abs(A).max())


def _operator(
    M: sp.csr_matrix, C: sp.csr_matrix, K: sp.csr_matrix, s: float, omega: float
) -> tuple[Callable[[Array], Array], Factor]:
    """The operator of the largest theta on blocks of states, and the factor behind it."""
    shifted = (s**2 * M + s * C + K).tocsr()
    lu, n = Factor(shifted, "brake_lu_", symmetric=False), K.shape[0]
    first = (C + s * M).tocsr()

    def apply(b: Array) -> Array:
        x = -lu.solve(first @ b[:n] + omega * (M @ b[n:]))
        return np.vstack([x, (b[:n] + s * x) / omega])

    return apply, lu
