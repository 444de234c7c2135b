"""Full order with damping: all modes of a band of (lambda^2 M + lambda C + K) phi = 0.

Small problems are solved densely, and counted by the winding number of their determinant. Large
ones go to block Arnoldi, and are counted by the function that is given.

For large matrices, in real arithmetic: lambda^2 M + lambda C + K is factored once at a small
positive shift s, which is real: with theta = 1 / (lambda - s) and the state (x, v), v = lambda x /
omega, the linearised problem reads

    theta x = -P(s)^-1 ((C + s M) x + omega M v),     theta v = (x + s theta x) / omega,

P(s) = s^2 M + s C + K. Block Arnoldi finds its largest theta, that is the modes nearest to s: both
of each conjugate pair, so that the Krylov space is about twice that of the undamped problem. Left
vectors are the conjugate right ones of the transposed matrices; of symmetric ones they are at hand.

Reference: F. Tisseur and K. Meerbergen, SIAM Review 43 (2001) 235, doi:10.1137/S0036144500381988.
"""

import time
from collections.abc import Callable
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.macro.solver import Factor

from ..eigensolvers import eigenpairs
from ..eigensolvers.argument_principle import RIM
from ..eigensolvers.symmetric import SHIFT, count_below, is_symmetric
from ..modes import NEAR_ZERO, Count, Modes, damped_rows
from .dense import DENSE, counted_quadratic, dense_quadratic_modes
from .interface import SplitProblem


def quadratic_modes(
    p: eigenpairs.QuadraticPencil, high: float, zeta_max: float, comm: MPI.Comm = MPI.COMM_SELF
) -> tuple[Complex, Complex, Complex]:
    """All modes with |lambda| up to the far corners of the region that is counted, and conjugates.

    Those that decay faster than the region reaches are left out.

    Args:
        p: the problem, with damping.
        high: highest omega [rad/s].
        zeta_max: largest damping ratio looked for.
        comm: two processes that share the work, or one.

    Returns:
        lambda [1/s], right and left vectors.

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

    def side(transposed: bool) -> tuple[Complex, Complex]:
        m, c, k = (A.T.tocsr() if transposed else A for A in (M, C, K))
        apply, lu = _operator(m, c, k, s, high)
        n = K.shape[0]
        # A little further, so that each of the right ones has its left one.
        found, X = eigenpairs.nearest_modes(
            apply, 2 * n, s, RIM * reach, 2 * count + 2, RIM * leftmost
        )
        lu.destroy()
        return found, X[:n]

    symmetric = is_symmetric(C) and is_symmetric(K)
    return eigenpairs.both_sides(side, s, reach, comm, leftmost, symmetric)


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


def damped_modes(
    problem: SplitProblem,
    C: sp.csr_matrix,
    band: tuple[float, float],
    tolerance: float,
    zeta_max: float,
    counted: Callable[[SplitProblem, sp.csr_matrix, Complex, float, float], Count],
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Modes:
    """All modes of a band with alpha >= -zeta_max |lambda|, one of each conjugate pair.

    Args:
        problem: the problem without damping.
        C: damping [N s/m].
        band: lowest and highest frequency [Hz].
        tolerance: relative residual of every mode.
        zeta_max: largest damping ratio looked for.
        counted: counts the modes of a large problem, see ``eigen.counted``.
        comm: two processes that share the work, or one; collective.

    Returns:
        The modes; where their number could not be counted the record says why.

    Raises:
        NotConverged: a mode misses the tolerance by more than round-off explains.
        InaccurateResult: more or fewer modes than counted.
    """
    start = time.perf_counter()
    low, high = (2 * np.pi * f for f in band)
    pencil = eigenpairs.QuadraticPencil(problem.M, C, problem.K)
    if problem.K.shape[0] <= DENSE:
        s, right, left = dense_quadratic_modes(pencil, high)
        counting = counted_quadratic(pencil, s, high, zeta_max)
    else:
        s, right, left = quadratic_modes(pencil, high, zeta_max, comm)
        counting = counted(problem, C, s, high, zeta_max)
    # Only decay is cut off: a mode that grows faster than that is news.
    slow = s.real >= -zeta_max * np.abs(s)
    chosen = np.flatnonzero(
        slow & (s.imag >= 0) & (s.imag <= high) | (np.abs(s) <= NEAR_ZERO * high)
    )
    chosen = chosen[np.lexsort((s[chosen].real, s[chosen].imag))]
    s, right, left = s[chosen], right[:, chosen], left[:, chosen]
    left = eigenpairs.paired(s, left, pencil.slope(s, right))
    s = eigenpairs.rayleigh_quotient(pencil, s, right, left)
    condition, error = eigenpairs.damped_errors(pencil, s, right, left)
    rows, s = damped_rows(s, right, error, (low, high), zeta_max)
    right, left = right[:, rows], left[:, rows]
    R, MX = pencil.times(s, right), eigenpairs.times(pencil.M, right)
    residual, backward = eigenpairs.residuals(pencil, s, right, R, MX)
    if np.any((residual > tolerance) & (backward > eigenpairs.ROUND_OFF)):
        raise NotConverged(f"""damped modes: relative residual {residual.max():.1e}, wanted
            {tolerance:.0e}""")
    return Modes(
        s, right, left, residual, error[rows], condition[rows],
        replace(counting, expected=s.size), time.perf_counter() - start,
        np.zeros(s.size, dtype=bool),
    )  # fmt: skip
