"""Fallback: modes of a band by shift-and-invert in pieces.

For bands with more modes below them than one Krylov space holds, and matrices whose friction is not
of low rank. The band is cut into pieces, each covered by the disc of one real shift. Borders lie in
gaps of the spectrum, so that no mode is on both sides or on neither, and clusters stay together.
Symmetric problems go to SLEPc; its two-sided solver for others breaks down now and then (LAPACK's
trevc, 2x2 blocks cut apart), so that these go to block Arnoldi, from either side.
"""

from __future__ import annotations

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.macro.condensation import petsc_matrix
from brake_fenicsx.macro.solver import Factor

from ..vectors import RIM, matched, with_conjugates
from .arnoldi import nearest_modes
from .completeness import opening

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Found = tuple[Complex, Complex, Complex, int]

# Eigenvalues that one shift is asked for: a factorisation costs about as much as 50 solves.
PER_SHIFT = 60

# Share of a piece's upper border within which the border may move to a gap.
PLAY = 0.01


def sliced_modes(
    K: sp.csr_matrix,
    M: sp.csr_matrix,
    low: float,
    high: float,
    count: int,
    tolerance: float,
    zeta_max: float,
    symmetric: bool,
) -> Found:
    """Eigenpairs of K x = kappa M x with low <= Re kappa <= high, conjugates included.

    Args:
        K: stiffness [N/m].
        M: mass [kg].
        low: lower end [1/s^2]; at zero or below, rigid and diverging modes belong to the band.
        high: upper end [1/s^2].
        count: about how many there are.
        tolerance: relative tolerance of the eigensolver.
        zeta_max: largest damping ratio looked for.
        symmetric: whether K is symmetric.

    Returns:
        kappa, right and left vectors, iterations.

    Raises:
        NotConverged: the eigensolver leaves a mode unconverged.
    """
    edges = _pieces(low, high, count)
    found, a, iterations = [], float(edges[0]), 0
    for b in edges[1:]:
        bottom, top = a if np.isfinite(a) else -0.02 * high, float(b) * (1 + PLAY)
        sigma = 0.5 * (bottom + top) * (1 + 1.234e-7)
        reach = 1.001 * np.hypot(0.5 * (top - bottom), opening(zeta_max) * top * (not symmetric))
        if symmetric:
            kappa, right, left, used = _covered(K, M, sigma, reach, tolerance)
        else:
            kappa, right, left, used = _two_sided(K, M, sigma, reach, count)
        border = high if b >= high else widest_gap(kappa.real, b * (1 - PLAY), b * (1 + PLAY))
        own = (kappa.real >= a) & (kappa.real <= border)
        found.append((kappa[own], right[:, own], left[:, own]))
        a, iterations = border, iterations + used
    return (
        np.concatenate([f[0] for f in found]),
        np.hstack([f[1] for f in found]),
        np.hstack([f[2] for f in found]),
        iterations,
    )


def widest_gap(values: Array, low: float, high: float) -> float:
    """Middle of the widest gap that some values leave between two bounds, bounds included."""
    inner = np.sort(values[(values > low) & (values < high)])
    marks = np.r_[low, inner, high]
    widest = int(np.argmax(np.diff(marks)))
    return float(0.5 * (marks[widest] + marks[widest + 1]))


def _pieces(low: float, high: float, count: int) -> Array:
    """Borders of pieces of the band, equal in frequency, of about PER_SHIFT modes at most."""
    n = max(1, int(np.ceil(count / PER_SHIFT)))
    edges = np.linspace(np.sqrt(max(low, 0.0)), np.sqrt(high), n + 1) ** 2
    edges[0] = -np.inf if low <= 0 else low
    return edges


def _covered(
    K: sp.csr_matrix, M: sp.csr_matrix, sigma: float, reach: float, tolerance: float
) -> Found:
    """All eigenpairs of a symmetric problem within reach of a shift."""
    pair, n, wanted = (petsc_matrix(K), petsc_matrix(M)), K.shape[0], PER_SHIFT + 10
    while True:
        kappa, X, used = nearest(*pair, sigma, min(wanted, n), tolerance)
        if kappa.size >= n or np.abs(kappa - sigma).max() > reach:
            return kappa, X, X, used
        wanted = int(1.5 * wanted)


def _two_sided(K: sp.csr_matrix, M: sp.csr_matrix, sigma: float, reach: float, count: int) -> Found:
    """All eigenpairs of a non-symmetric problem within reach of a shift."""
    sides, expected = [], min(count, 2 * PER_SHIFT)
    for A, B in ((K, M), (K.T, M.T)):
        B = B.tocsr()
        try:
            lu = _lu(A - sigma * B)
        except InaccurateResult:
            # The shift is an eigenvalue: any other near it serves.
            lu = _lu(A - (sigma := sigma * (1 + 1e-5)) * B)
        apply = lambda b, lu=lu, B=B: lu.solve(B @ b)  # noqa: E731
        sides.append(nearest_modes(apply, K.shape[0], sigma, RIM * reach, expected))
        lu.destroy()
    (kappa, right, steps), (other, left, more) = sides
    # Both of each pair: round-off splits a true doublet into a pair on one side alone.
    (kappa, right), (other, left) = with_conjugates(kappa, right), with_conjugates(other, left)
    i, j = matched(kappa, other, sigma, reach)
    return kappa[i], right[:, i], left[:, j].conj(), steps + more


def nearest(
    K: PETSc.Mat, M: PETSc.Mat, sigma: float, wanted: int, tolerance: float
) -> tuple[Complex, Complex, int]:
    """The eigenpairs of a symmetric problem nearest to a real shift (SLEPc)."""
    eps = SLEPc.EPS().create(K.comm)
    eps.setOptionsPrefix("brake_eigen_")
    eps.setOperators(K, M)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
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
        raise NotConverged(
            f"eigensolver: {got} of {wanted} modes converged near"
            f" {np.sqrt(abs(sigma)) / 2 / np.pi:.0f} Hz in {eps.getIterationNumber()} restarts"
        )
    x = K.createVecs()[0]
    kappa, X = np.empty(got, dtype=complex), np.empty((x.size, got), dtype=complex)
    for i in range(got):
        kappa[i] = eps.getEigenpair(i, x)
        X[:, i] = x.array_r
    used = eps.getIterationNumber()
    eps.destroy()
    return kappa, X, used


def _lu(A: sp.spmatrix) -> Factor:
    return Factor(petsc_matrix(A), "brake_lu_", symmetric=False)
