"""Checks of eigenpairs: residual, backward error, condition and error; pairs of left and right.

The problem is P(lambda) phi = 0 and psi^H P(lambda) = 0, P(lambda) = lambda^2 M + lambda C + K;
without damping kappa = -lambda^2 and K phi = kappa M phi.

Reference: F. Tisseur, Linear Algebra Appl. 309 (2000) 339, doi:10.1016/S0024-3795(99)00063-4.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from brake_fenicsx.arguments import Array, Complex, Index
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.folder.processes import in_turns

from .arnoldi import times, with_conjugates

# Eigenvalues closer than this, relatively, share their vectors: each of them has these to about
# round-off over the distance, 1e-9.
CLUSTER = 1e-7

# Backward error that is all round-off: residuals cannot be smaller than that of a stiff matrix. On
# cells of an aspect of ten vectors of block Lanczos were left with less than 1e-14 by the kernels
# of Prescott, and with 4e-14 by those of Haswell. Errors are stated from the residual.
ROUND_OFF = 1e-13

# Relative error of an eigenvalue from the round-off of the solves, times its condition and relative
# to the largest one: the tolerance of the block Arnoldi process.
SOLVES = 1e-11

# Left and right eigenvalues agree to this share of the region searched; near an exceptional point
# both lose half of their digits.
MATCH = 1e-5


@dataclass(frozen=True, slots=True)
class QuadraticPencil:
    """P(lambda) = lambda^2 M + lambda C + K.

    Attributes:
        M: mass [kg].
        C: damping [N s/m]; None without damping.
        K: stiffness [N/m].
    """

    M: sp.spmatrix
    C: sp.spmatrix | None
    K: sp.spmatrix

    def times(self, s: Complex, X: Complex) -> Complex:
        """P(lambda) x for each pair."""
        out = times(self.M, X) * s**2 + times(self.K, X)
        return out if self.C is None else out + times(self.C, X) * s

    def slope(self, s: Complex, X: Complex) -> Complex:
        """P'(lambda) x = (2 lambda M + C) x for each pair."""
        out = times(self.M, X) * (2 * s)
        return out if self.C is None else out + times(self.C, X)


def residuals(
    p: QuadraticPencil, s: Complex, X: Complex, R: Complex, MX: Complex
) -> tuple[Array, Array]:
    """Relative residual and normwise backward error of each mode, Euclidean norms.

    The first is |P(lambda) phi| / |lambda^2 M phi|; of rigid modes, whose lambda^2 is round-off,
    relative to a millionth of the largest. The second (Tisseur 2000) divides by
    (|lambda|^2 |M| + |lambda| |C| + |K|) |phi|: with a spring 1e12 times stiffer than the rest it
    is small whatever phi is.

    Args:
        p: the problem.
        s: eigenvalues lambda [1/s], shape (modes,).
        X: their right vectors, shape (dofs, modes).
        R: residual vectors P(lambda) X.
        MX: M X.
    """
    r, squared, tiny = np.linalg.norm(R, axis=0), np.abs(s) ** 2, np.finfo(float).tiny
    inertia = np.maximum(squared, 1e-6 * squared.max(initial=0.0))
    inertia = np.maximum(inertia * np.linalg.norm(MX, axis=0), tiny)
    norm = squared * norm_bound(p.M) + norm_bound(p.K)
    if p.C is not None:
        norm = norm + np.abs(s) * norm_bound(p.C)
    return r / inertia, r / np.maximum(norm * np.linalg.norm(X, axis=0), tiny)


def norm_bound(A: sp.spmatrix) -> float:
    """Bound of the 2-norm: root of the largest row sum times the largest column sum."""
    size = abs(A)
    return float(np.sqrt(size.sum(axis=0).max() * size.sum(axis=1).max()))


def inner(left: Complex, right: Complex) -> Complex:
    """Products psi^H x of the columns of two matrices, one by one."""
    return np.asarray(np.einsum("im,im->m", left.conj(), right))


def undamped_errors(
    M: sp.spmatrix, kappa: Complex, right: Complex, left: Complex, R: Complex, MX: Complex
) -> tuple[Array, Array]:
    """Condition numbers in the norm of M, and errors from the two-sided quotient [1/s^2].

    Args:
        M: mass [kg].
        kappa: eigenvalues [1/s^2], shape (modes,).
        right: right vectors, shape (dofs, modes).
        left: left vectors, likewise.
        R: residual vectors K phi - kappa M phi.
        MX: M phi.
    """
    overlap = inner(left, MX)
    norms = np.sqrt(inner(right, MX).real * inner(left, times(M, left)).real)
    with np.errstate(divide="ignore"):
        condition = norms / np.abs(overlap)
    first = np.abs(inner(left, R) / overlap)
    # What the quotient of two inexact vectors leaves open, and the round-off of the solves.
    return condition, first + SOLVES * condition * np.abs(kappa).max(initial=0.0)


def damped_errors(
    p: QuadraticPencil, s: Complex, right: Complex, left: Complex
) -> tuple[Array, Array]:
    """Condition numbers in the norm of M, and errors from the two-sided quotient [1/s]."""
    overlap = np.abs(inner(left, p.slope(s, right)))
    first, second = (inner(X, times(p.M, X)).real for X in (right, left))
    condition = 2 * np.abs(s) * np.sqrt(first * second) / overlap
    first = np.abs(inner(left, p.times(s, right))) / overlap
    # The round-off of K phi, which is all that there is of a rigid mode.
    lengths = np.linalg.norm(right, axis=0) * np.linalg.norm(left, axis=0)
    floor = np.finfo(float).eps * norm_bound(p.K) * lengths / overlap
    return condition, first + floor + SOLVES * condition * np.abs(s).max(initial=0.0)


def rayleigh_quotient(p: QuadraticPencil, s: Complex, right: Complex, left: Complex) -> Complex:
    """One Newton step of psi^H P(lambda) phi = 0 where it is well-posed.

    It squares the error of the vectors; next to an exceptional point it is left undone.
    """
    slope = p.slope(s, right)
    overlap = inner(left, slope)
    size = np.linalg.norm(left, axis=0) * np.linalg.norm(slope, axis=0)
    step = inner(left, p.times(s, right)) / overlap
    sane = (np.abs(overlap) > 1e-4 * size) & (np.abs(step) < 1e-6 * np.abs(s))
    step = np.where(s.imag == 0, step.real, step)
    return np.where(sane, s - step, s)


def paired(s: Complex, left: Complex, weighted: Complex) -> Complex:
    """Left vectors biorthogonal to the right ones within clusters of equal eigenvalues.

    Args:
        s: eigenvalues.
        left: left vectors, shape (dofs, modes).
        weighted: derivative of the pencil times the right vectors: M phi, or (2 lambda M + C) phi.

    Returns:
        New left vectors of unit norm.
    """
    left = left / np.linalg.norm(left, axis=0)
    order = np.lexsort((s.real, s.imag))
    gaps = np.abs(np.diff(s[order])) > CLUSTER * np.abs(s[order][1:])
    for group in np.split(order, np.flatnonzero(gaps) + 1):
        if group.size > 1:
            overlap = left[:, group].conj().T @ weighted[:, group]
            turned = left[:, group] @ la.pinv(overlap).conj().T
            left[:, group] = turned / np.linalg.norm(turned, axis=0)
    return left


def matched(
    right: Complex, left: Complex, sigma: float, reach: float, leftmost: float = -np.inf
) -> tuple[Index, Index]:
    """Right eigenvalues within reach of a shift, and for each of them its own left one.

    Args:
        right: eigenvalues of the right vectors, some beyond the reach among them.
        left: those of the left vectors.
        sigma: the shift.
        reach: radius.
        leftmost: right eigenvalues of smaller real part are none of it.

    Raises:
        InaccurateResult: a right eigenvalue has no left one.
    """
    inside = np.flatnonzero((np.abs(right - sigma) <= reach) & (right.real >= leftmost))
    distance = np.abs(right[inside, None] - left[None, :])
    rows, columns = linear_sum_assignment(distance)
    far = distance[rows, columns] > MATCH * reach
    if rows.size < inside.size or np.any(far):
        raise InaccurateResult(
            f"{inside.size} right eigenvectors, {rows.size - far.sum()} of them with a left one"
        )
    return inside, columns


def both_sides(
    side: Callable[[bool], tuple[Complex, Complex]],
    sigma: float,
    reach: float,
    comm: MPI.Comm = MPI.COMM_SELF,
    leftmost: float = -np.inf,
    symmetric: bool = False,
) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues within reach of a shift with right and left vectors; collective.

    Args:
        side: finds eigenvalues, one of each conjugate pair, and vectors of the problem (False) or
            of the transposed one.
        sigma: the shift.
        reach: radius.
        comm: two processes that take a side each, or one.
        leftmost: smallest real part wanted.
        symmetric: whether the transposed problem is the same one.

    Returns:
        Eigenvalues, conjugates included, right and left vectors.

    Raises:
        InaccurateResult: a right vector has no left one.
    """
    found = list(in_turns(1 if symmetric else 2, lambda i: side(i > 0), comm))
    # Both of each pair: round-off splits a true doublet into a pair on one side alone.
    (right, X), (left, Y) = (with_conjugates(*found[i]) for i in (0, -1))
    i, j = matched(right, left, sigma, reach, leftmost)
    return right[i], X[:, i], Y[:, j].conj()
