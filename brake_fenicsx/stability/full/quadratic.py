"""Full order with damping for large matrices, in real arithmetic.

lambda^2 M + lambda C + K is factored once at a small positive shift s, which is real: with
theta = 1 / (lambda - s) and the state (x, v), v = lambda x / omega, the linearised problem reads

    theta x = -P(s)^-1 ((C + s M) x + omega M v),     theta v = (x + s theta x) / omega,

P(s) = s^2 M + s C + K. Block Arnoldi finds its largest theta, that is the modes nearest to s: both
of each conjugate pair, so that the Krylov space is about twice that of the undamped problem. Left
vectors are the conjugate right ones of the transposed matrices; of symmetric ones they are at hand.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import petsc_matrix
from brake_fenicsx.macro.solver import Factor

from ..vectors import RIM, matched, with_conjugates
from .arnoldi import nearest_modes
from .symmetric import MOST, SHIFT, count_below

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def quadratic_modes(
    M: sp.csr_matrix, C: sp.csr_matrix, K: sp.csr_matrix, high: float, zeta_max: float
) -> tuple[Complex, Complex, Complex, int] | None:
    """All modes with |lambda| up to the far corners of the region that is counted, and conjugates.

    Args:
        M: mass [kg].
        C: damping [N s/m].
        K: stiffness [N/m].
        high: highest omega [rad/s].
        zeta_max: largest damping ratio looked for.

    Returns:
        lambda [1/s], right and left vectors, block solves; None where there are too many modes for
        one Krylov space.

    Raises:
        NotConverged: the Krylov space fills without convergence.
        InaccurateResult: a right vector has no left one.
    """
    smooth = (0.5 * (K + K.T)).tocsr()
    count, _ = count_below(smooth, M, (RIM * high) ** 2)
    if count > MOST // 2:
        return None
    s = np.sqrt(SHIFT) * high
    # The edges of that region may lie beyond the band by RIM.
    reach = RIM * high / np.sqrt(1 - zeta_max**2) + s
    sides = []
    for A in ((M, C, K), (M.T.tocsr(), C.T.tocsr(), K.T.tocsr())):
        apply, lu = _operator(*A, s, high)
        n = 2 * K.shape[0]
        found, X, steps = nearest_modes(apply, n, s, RIM * reach, 2 * count + 2)
        lu.destroy()
        sides.append((*with_conjugates(found, X[: n // 2]), steps))
        if _symmetric(C) and _symmetric(K):
            sides.append(sides[0])
            break
    (found, right, steps), (other, left, more) = sides
    i, j = matched(found, other, s, reach)
    return found[i], right[:, i], left[:, j].conj(), steps + more


def _symmetric(A: sp.spmatrix) -> bool:
    return bool(abs(A - A.T).max() <= 1e-12 * abs(A).max())


def _operator(
    M: sp.csr_matrix, C: sp.csr_matrix, K: sp.csr_matrix, s: float, omega: float
) -> tuple[Callable[[Array], Array], Factor]:
    """The operator of the largest theta on blocks of states, and the factor behind it."""
    shifted = petsc_matrix((s**2 * M + s * C + K).tocsr())
    lu, n = Factor(shifted, "brake_lu_", symmetric=False), K.shape[0]
    first = (C + s * M).tocsr()

    def apply(b: Array) -> Array:
        x = -lu.solve(first @ b[:n] + omega * (M @ b[n:]))
        return np.vstack([x, (b[:n] + s * x) / omega])

    return apply, lu
