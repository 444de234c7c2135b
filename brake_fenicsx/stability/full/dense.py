"""All eigenpairs of small matrices, and their number.

Of the shifted inverse, so that the low modes are as exact as they are for large matrices, also
where a spring is 1e12 times stiffer than the rest, and a massless dof gives no infinite eigenvalue.
"""

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array, Complex, Mask
from brake_fenicsx.errors import InaccurateResult

from ..eigensolvers.argument_principle import count_zeros, damped_region, undamped_region
from ..eigensolvers.eigenpairs import QuadraticPencil, on_parts
from ..eigensolvers.symmetric import SHIFT, count_below
from ..modes import Count
from .interface import Found, SplitProblem, agree

# Up to this size the dense eigenvalues are as quick as any other.
DENSE = 300

# Eigenvalues of the inverse below this share of the largest are those of massless dofs.
MASSLESS = 1e-14


def small_modes(p: SplitProblem, low: float, high: float, zeta_max: float) -> Found:
    """Modes without damping, counted by inertia if K is symmetric, else by the argument principle.

    Args:
        p: the problem.
        low: lower end of the band [1/s^2].
        high: upper end [1/s^2].
        zeta_max: largest damping ratio looked for.

    Raises:
        InaccurateResult: K - sigma M is singular, or the numbers differ.
    """
    kappa, right, left = dense_modes(p, high)
    if p.symmetric:
        expected, at = count_below(p.K, p.M, high)
        agree(int(np.sum(kappa.real < at)), expected, high, "inertia")
        return Found(kappa, right, left, Count("proven", "inertia of K - kappa M"))
    K, M = p.K.toarray(), p.M.toarray()
    region = undamped_region(kappa, low, high, zeta_max)
    expected = count_zeros(lambda z: K - z * M, region, kappa)
    agree(int(region.holds(kappa).sum()), expected, high, "the winding number")
    counting = Count("proven", "winding number of det(K - kappa M)")
    return Found(kappa, right, left, counting)


def dense_modes(p: SplitProblem, high: float) -> tuple[Complex, Complex, Complex]:
    """All finite eigenpairs of K x = kappa M x.

    Args:
        p: the problem.
        high: kappa of the band's end [1/s^2], for the scale of the shift.

    Returns:
        kappa, right and left vectors.

    Raises:
        InaccurateResult: K - sigma M is singular.
    """
    A, B = p.K.toarray(), p.M.toarray()
    sigma = -SHIFT * high
    S = A - sigma * B
    if p.symmetric and (found := _symmetric(0.5 * (S + S.T), 0.5 * (B + B.T))) is not None:
        theta, right = found
        left = right
    else:
        theta, right, left = _inverse_pairs(S, B)
        # Symmetric but indefinite: real eigenvalues all the same.
        theta = theta.real if p.symmetric and np.all(np.linalg.eigvalsh(B) > 0) else theta
    keep = _with_mass(theta)
    kappa: Complex = np.asarray(sigma + 1 / theta[keep], dtype=complex)
    return kappa, right[:, keep].astype(complex), left[:, keep].astype(complex)


def dense_quadratic_modes(p: QuadraticPencil, high: float) -> tuple[Complex, Complex, Complex]:
    """All finite eigenpairs of lambda^2 M + lambda C + K.

    With v = lambda x / omega the pencil is A + lambda B, A = [0, -omega; K, 0], B = [1, 0; C,
    omega M]; of a left vector (y1, y2) y2 is that of the quadratic problem. Its inverse at a small
    positive shift gives dofs without mass a zero in place of an infinite eigenvalue.

    Args:
        p: the problem, with damping.
        high: omega of the band's end [rad/s], the scale of v.

    Returns:
        lambda [1/s], right and left vectors.

    Raises:
        InaccurateResult: a dof has neither stiffness nor mass.
    """
    n = p.K.shape[0]
    M, C, K = (sp.csr_matrix(A).toarray() for A in (p.M, p.C, p.K))
    zero, one, shift = np.zeros((n, n)), np.eye(n), np.sqrt(SHIFT) * high
    B = np.block([[one, zero], [C, high * M]])
    theta, z, y = _inverse_pairs(np.block([[zero, -high * one], [K, zero]]) + shift * B, B)
    keep = _with_mass(theta)
    return shift - 1 / theta[keep].astype(complex), z[:n, keep].astype(complex), y[n:, keep]


def counted_quadratic(p: QuadraticPencil, s: Complex, high: float, zeta_max: float) -> Count:
    """Compare with the turns of det(lambda^2 M + lambda C + K) around |omega| <= high.

    Args:
        p: the problem, with damping.
        s: all its eigenvalues [1/s].
        high: omega of the band's end [rad/s].
        zeta_max: largest damping ratio looked for.

    Returns:
        How they were counted.

    Raises:
        InaccurateResult: the numbers differ.
    """
    region = damped_region(s, high, 2 * zeta_max, 1.1)
    M, C, K = (sp.csr_matrix(A).toarray() for A in (p.M, p.C, p.K))
    scale = np.abs(K).max()
    counted = count_zeros(lambda z: (z**2 * M + z * C + K) / scale, region, s)
    agree(int(region.holds(s).sum()), counted, high**2, "the winding number")
    return Count("proven", "winding number of det(lambda^2 M + lambda C + K)")


def _inverse_pairs(S: Array, B: Array) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Eigenvalues theta of B x = theta S x, right and left vectors.

    Raises:
        InaccurateResult: S is singular.
    """
    with np.errstate(all="ignore"):
        lu = la.lu_factor(S)
    if not np.all(np.abs(np.diag(lu[0])) > 0):
        raise InaccurateResult("K - sigma M is singular: a dof has neither stiffness nor mass")
    theta, left, right = la.eig(la.lu_solve(lu, B), left=True, right=True)
    return theta, right, on_parts(lambda x: la.lu_solve(lu, x, trans=1), left.astype(complex))


def _with_mass(theta: AnyArray) -> Mask:
    """Which eigenvalues of the inverse are not those of massless dofs."""
    return np.asarray(np.abs(theta) > MASSLESS * np.abs(theta).max(initial=0.0))


def _symmetric(S: Array, M: Array) -> tuple[AnyArray, AnyArray] | None:
    """Eigenpairs of M x = theta S x for positive definite S; None if it is not."""
    try:
        theta, X = la.eigh(M, S)
    except la.LinAlgError:
        return None
    return theta, X / np.linalg.norm(X, axis=0)
