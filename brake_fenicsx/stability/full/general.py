"""Full order without a split of friction: small problems, damped ones, undamped ones of any kind.

Small problems are solved densely, by the shifted inverse, so that the low modes are as exact as
they are for large matrices, also where a spring is 1e12 times stiffer than the rest, and a massless
dof gives no infinite eigenvalue. They are counted by inertia, or by the winding number of their
determinant.

Large damped ones go to block Arnoldi, in real arithmetic, and are counted by the function that is
given. lambda^2 M + lambda C + K is factored once at a small positive shift s, which is real: with
theta = 1 / (lambda - s) and the state (x, v), v = lambda x / omega, the linearised problem reads

    theta x = -P(s)^-1 ((C + s M) x + omega M v),     theta v = (x + s theta x) / omega,

P(s) = s^2 M + s C + K. Block Arnoldi finds its largest theta, that is the modes nearest to s: both
of each conjugate pair, so that the Krylov space is about twice that of the undamped problem. Left
vectors are the conjugate right ones of the transposed matrices; of symmetric ones they are at hand.

Large undamped ones, K phi = kappa M phi with K of any kind, go to SLEPc's Krylov-Schur method: for
friction that is not of low rank, and for matrices that nothing else is known of. Shift and invert
in the middle of the band, for right vectors and, with the transposed matrices, for left ones.
SLEPc's own two-sided solver breaks down now and then (LAPACK's trevc, 2x2 blocks cut apart).
Nothing counts these modes.

References: F. Tisseur and K. Meerbergen, SIAM Review 43 (2001) 235, doi:10.1137/S0036144500381988;
G. W. Stewart, SIAM J. Matrix Anal. Appl. 23 (2002) 601, doi:10.1137/S0895479800371529.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array, Complex, Mask
from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.macro.solver import Factor, petsc_matrix

from ..eigensolvers import argument_principle, eigenpairs
from ..eigensolvers.eigenpairs import QuadraticPencil, both_sides, on_parts
from ..eigensolvers.symmetric import SHIFT, count_below, is_symmetric
from ..modes import NEAR_ZERO, Count, Modes, damped_rows
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
    region = argument_principle.undamped_region(kappa, low, high, zeta_max)
    expected = argument_principle.count_zeros(lambda z: K - z * M, region, kappa)
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
    region = argument_principle.damped_region(s, high, 2 * zeta_max, 1.1)
    M, C, K = (sp.csr_matrix(A).toarray() for A in (p.M, p.C, p.K))
    scale = np.abs(K).max()
    counted = argument_principle.count_zeros(lambda z: (z**2 * M + z * C + K) / scale, region, s)
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
    count, _ = count_below((0.5 * (K + K.T)).tocsr(), M, (argument_principle.RIM * high) ** 2)
    s = np.sqrt(SHIFT) * high
    # The edges of that region may lie beyond the band by RIM.
    reach = argument_principle.RIM * high / np.sqrt(1 - zeta_max**2) + s
    leftmost = -argument_principle.RIM * high * zeta_max / np.sqrt(1 - zeta_max**2)

    def side(transposed: bool) -> tuple[Complex, Complex]:
        m, c, k = (A.T.tocsr() if transposed else A for A in (M, C, K))
        apply, lu = _operator(m, c, k, s, high)
        n = K.shape[0]
        # A little further, so that each of the right ones has its left one.
        rim = argument_principle.RIM
        search = eigenpairs.nearest_modes(2 * n, s, rim * reach, 2 * count + 2, rim * leftmost)
        found, X = eigenpairs.searched(
            {transposed: search}, lambda asked: {transposed: apply(asked[transposed])}
        )[transposed]
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
    count, seconds = replace(counting, expected=s.size), time.perf_counter() - start
    error, condition, real = error[rows], condition[rows], np.zeros(s.size, dtype=bool)
    return Modes(s, right, left, residual, error, condition, count, seconds, real)


def general_modes(p: SplitProblem, high: float, zeta_max: float, tolerance: float) -> Found:
    """Modes with -2 % of the band's end <= Re kappa <= the band's end, and some around them.

    Args:
        p: the problem; its frictionless part serves to guess how many modes there are.
        high: upper end of the band [1/s^2].
        zeta_max: largest damping ratio looked for.
        tolerance: relative tolerance of the eigensolver.

    Returns:
        The modes, not counted.

    Raises:
        NotConverged: the eigensolver leaves a mode unconverged.
        InaccurateResult: a right vector has no left one.
    """
    # Not a round number: a shift must not be an eigenvalue.
    sigma = 0.5 * high * (1 + 1.234e-7)
    reach = 1.001 * high * np.hypot(0.52, argument_principle.opening(zeta_max))
    wanted = count_below(p.frictionless, p.M, argument_principle.RIM * high)[0] + 10

    def side(transposed: bool) -> tuple[Complex, Complex]:
        K, M = (A.T.tocsr() if transposed else A for A in (p.K, p.M))
        return _within(K, M, sigma, argument_principle.RIM * reach, wanted, tolerance)

    counting = p.not_low_rank if p.friction is None else p.indefinite
    return Found(*both_sides(side, sigma, reach), counting)


def _within(
    K: sp.csr_matrix, M: sp.csr_matrix, sigma: float, reach: float, wanted: int, tolerance: float
) -> tuple[Complex, Complex]:
    """Eigenpairs within reach of a shift and some beyond, one of each conjugate pair."""
    pair, n = (petsc_matrix(K), petsc_matrix(M)), K.shape[0]
    while True:
        kappa, X = _nearest(*pair, sigma, min(wanted, n), tolerance)
        distance = np.abs(kappa - sigma)
        if kappa.size >= n or distance.max() > reach:
            one = np.flatnonzero(kappa.imag >= 0)
            return kappa[one], X[:, one]
        wanted = max(int(1.5 * wanted), wanted + 10)


def _nearest(
    K: Any, M: Any, sigma: float, wanted: int, tolerance: float
) -> tuple[Complex, Complex]:
    """The eigenpairs nearest to a real shift, both of each conjugate pair."""
    from slepc4py import SLEPc  # which all other modes do without

    eps = SLEPc.EPS().create(K.comm)
    eps.setOptionsPrefix("brake_eigen_")
    eps.setOperators(K, M)
    eps.setProblemType(SLEPc.EPS.ProblemType.GNHEP)
    eps.setDimensions(wanted, min(K.getSize()[0], 2 * wanted + 20))
    eps.setTolerances(tolerance, 200)
    eps.setTarget(sigma)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    st.setShift(sigma)
    pc = st.getKSP().getPC()
    st.getKSP().setType("preonly")
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    eps.setFromOptions()
    eps.solve()
    got = eps.getConverged()
    if got < wanted:
        raise NotConverged(f"""eigensolver: {got} of {wanted} modes converged near
            {np.sqrt(sigma) / 2 / np.pi:.0f} Hz in {eps.getIterationNumber()} restarts; take a
            narrower band, or a smaller zeta_max""")
    x, y = K.createVecs()
    kappa, X = np.empty(got, dtype=complex), np.empty((x.size, got), dtype=complex)
    for i in range(got):
        kappa[i] = eps.getEigenpair(i, x, y)
        X[:, i] = x.array_r + 1j * y.array_r
    eps.destroy()
    return kappa, X
