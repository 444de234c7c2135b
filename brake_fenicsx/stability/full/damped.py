"""Full order with damping: all modes of a band of (lambda^2 M + lambda C + K) phi = 0.

Small problems are solved densely, and counted by the winding number of their determinant. Large
ones with a few hundred modes up to the band's end go to ``quadratic``, and are counted by the
function that is given. Bands with more modes below them are covered by complex shifts: real PETSc
cannot factor there, so that SciPy does; for up to some ten thousand dofs.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult, NotConverged

from ..modes import Complex, Count, Modes
from ..vectors import ROUND_OFF, norm_bound, paired
from .completeness import count_zeros
from .damped_rows import NEAR_ZERO, damped_rows, rectangle
from .dense import MASSLESS
from .problem import Problem
from .quadratic import quadratic_modes
from .quadratic_pencil import Pencil
from .shifts import covered_modes
from .symmetric import SHIFT

Array = NDArray[np.float64]

EPS = float(np.finfo(float).eps)

# Up to this size the dense eigenvalues are as quick, and up to that one complex shifts affordable.
DENSE, COVERED = 300, 10_000


def damped_modes(
    problem: Problem,
    C: sp.csr_matrix,
    band: tuple[float, float],
    tolerance: float,
    zeta_max: float,
    counted: Callable[[Problem, sp.csr_matrix, Complex, float, float], str],
) -> Modes:
    """All modes of a band with alpha >= -zeta_max |lambda|, one of each conjugate pair; collective.

    Args:
        problem: the problem without damping.
        C: damping [N s/m].
        band: lowest and highest frequency [Hz].
        tolerance: relative residual of every mode.
        zeta_max: largest damping ratio looked for.
        counted: counts the modes of a large problem, see ``damped_count``.

    Returns:
        The modes; where their number could not be counted the record says why.

    Raises:
        NotConverged: a mode misses the tolerance by more than round-off explains.
        InaccurateResult: more or fewer modes than counted.
    """
    start = time.perf_counter()
    low, high = (2 * np.pi * f for f in band)
    pencil = Pencil(problem.M.tocsc(), C.tocsc(), problem.K.tocsc())
    n = pencil.K.shape[0]
    if n <= DENSE:
        s, right, left, used = *_dense(pencil, high), 1
        how = _counted(pencil, s, high, zeta_max)
    else:
        try:
            large = quadratic_modes(problem.M, C, problem.K, high, zeta_max)
        except NotConverged:
            # Strongly damped bodies: real eigenvalues gather within the band.
            if n > COVERED:
                raise
            large = None
        s, right, left, used = large or covered_modes(pencil, low, high, zeta_max)
        how = (
            counted(problem, C, s, high, zeta_max) if large
            else "not counted: complex shifts, one by one"
        )  # fmt: skip
    # Only decay is cut off: a mode that grows faster than that is news.
    slow = s.real >= -zeta_max * np.abs(s)
    chosen = np.flatnonzero(
        slow & (s.imag >= 0) & (s.imag <= high) | (np.abs(s) <= NEAR_ZERO * high)
    )
    chosen = chosen[np.lexsort((s[chosen].real, s[chosen].imag))]
    s, right, left = s[chosen], right[:, chosen], left[:, chosen]
    left = paired(s, left, pencil.slope(s, right))
    s = _quotient(pencil, s, right, left)
    residual, error, condition = _checked(pencil, s, right, left)
    rows, s = damped_rows(s, right, error, (low, high), zeta_max)
    right, left = right[:, rows], left[:, rows]
    residual, error, condition = residual[rows], error[rows], condition[rows]
    if np.any((residual > tolerance) & (_backward(pencil, s, right) > ROUND_OFF)):
        raise NotConverged(
            f"damped modes: relative residual {residual.max():.1e}, wanted {tolerance:.0e}"
        )
    return Modes(
        s, right, left, residual, error, condition,
        Count(s.size, how), used, time.perf_counter() - start,
        np.zeros(s.size, dtype=bool),
    )  # fmt: skip


def _dense(p: Pencil, omega: float) -> tuple[Complex, Complex, Complex]:
    """All finite eigenvalues, with right and left vectors.

    With v = lambda x / omega the pencil is A + lambda B, A = [0, -omega; K, 0], B = [1, 0; C,
    omega M]; of a left vector (y1, y2) y2 is that of the quadratic problem. Its inverse at a small
    positive shift gives dofs without mass a zero in place of an infinite eigenvalue.

    Raises:
        InaccurateResult: a dof has neither stiffness nor mass.
    """
    n = p.K.shape[0]
    M, C, K = (A.toarray() for A in (p.M, p.C, p.K))
    zero, one, shift = np.zeros((n, n)), np.eye(n), np.sqrt(SHIFT) * omega
    B = np.block([[one, zero], [C, omega * M]])
    with np.errstate(all="ignore"):
        lu = la.lu_factor(np.block([[zero, -omega * one], [K, zero]]) + shift * B)
    if not np.all(np.abs(np.diag(lu[0])) > 0):
        raise InaccurateResult("damped modes: a dof has neither stiffness nor mass")
    theta, w, z = la.eig(-la.lu_solve(lu, B), left=True, right=True)
    keep = np.abs(theta) > MASSLESS * np.abs(theta).max()
    theta, w, z = theta[keep], w[:, keep], z[:n, keep]
    y = la.lu_solve(lu, w.real, trans=1) + 1j * la.lu_solve(lu, w.imag, trans=1)
    return shift + 1 / theta.astype(complex), z.astype(complex), y[n:]


def _counted(p: Pencil, s: Complex, high: float, zeta_max: float) -> str:
    """Compare with the turns of det(lambda^2 M + lambda C + K) around |omega| <= high.

    Raises:
        InaccurateResult: the numbers differ.
    """
    region = rectangle(s, high, 2 * zeta_max, 1.1)
    M, C, K = (A.toarray() for A in (p.M, p.C, p.K))
    scale = np.abs(K).max()
    counted = count_zeros(
        lambda z: (z**2 * M + z * C + K) / scale, region, s[np.abs(s) < 4 * (high + region.high)]
    )
    found = int(region.holds(s).sum())
    if found != counted:
        raise InaccurateResult(f"damped modes: {found} found, the winding number counts {counted}")
    return "winding number of det(lambda^2 M + lambda C + K)"


def _backward(p: Pencil, s: Complex, X: Complex) -> Array:
    """Residual over the norms of the matrices: of round-off whatever they hold."""
    M, C, K = (norm_bound(A) for A in (p.M, p.C, p.K))
    size = (np.abs(s) ** 2 * M + np.abs(s) * C + K) * np.linalg.norm(X, axis=0)
    return np.asarray(np.linalg.norm(p.times(s, X), axis=0) / size)


def _quotient(p: Pencil, s: Complex, right: Complex, left: Complex) -> Complex:
    """One Newton step of psi^H (lambda^2 M + lambda C + K) phi = 0 where it is well-posed.

    It squares the error of the vectors; next to an exceptional point it is left undone.
    """
    overlap = np.einsum("im,im->m", left.conj(), p.slope(s, right))
    size = np.linalg.norm(left, axis=0) * np.linalg.norm(p.slope(s, right), axis=0)
    step = np.einsum("im,im->m", left.conj(), p.times(s, right)) / overlap
    sane = (np.abs(overlap) > 1e-4 * size) & (np.abs(step) < 1e-6 * np.abs(s))
    step = np.where(s.imag == 0, step.real, step)
    return np.where(sane, s - step, s)


def _checked(p: Pencil, s: Complex, right: Complex, left: Complex) -> tuple[Array, Array, Array]:
    """Relative residual, error [1/s] and condition number of each mode."""
    r = p.times(s, right)
    MX = p.M @ right
    size = np.maximum(np.abs(s) ** 2 * np.linalg.norm(MX, axis=0), np.finfo(float).tiny)
    residual = np.linalg.norm(r, axis=0) / size
    overlap = np.einsum("im,im->m", left.conj(), p.slope(s, right))
    norms = np.einsum("im,im->m", right.conj(), MX).real
    norms = norms * np.einsum("im,im->m", left.conj(), p.M @ left).real
    condition = 2 * np.abs(s) * np.sqrt(norms) / np.abs(overlap)
    first = np.abs(np.einsum("im,im->m", left.conj(), r) / overlap)
    # The round-off of K phi, which is all that there is of a rigid mode.
    lengths = np.linalg.norm(right, axis=0) * np.linalg.norm(left, axis=0)
    floor = EPS * norm_bound(p.K) * lengths / np.abs(overlap)
    error = first + floor + 1e-11 * condition * np.abs(s).max(initial=0.0)
    return residual, error, condition
