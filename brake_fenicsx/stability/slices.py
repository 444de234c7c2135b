"""Fallback: modes of a band by shift-and-invert one vector at a time (SLEPc, MUMPS).

For bands with more modes below them than one Krylov space holds, and matrices whose friction is not
of low rank. The band is cut into pieces, each covered by the disc of one real shift. Borders lie in
gaps of the spectrum, so that no mode is on both sides or on neither, and clusters stay together.
"""

from __future__ import annotations

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.macro.condensation import petsc_matrix

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
    pair = petsc_matrix(K), petsc_matrix(M)
    edges = _pieces(low, high, count)
    found, a, iterations = [], float(edges[0]), 0
    for b in edges[1:]:
        (kappa, right, left), used = _piece(
            *pair, M, a, float(b), high, tolerance, zeta_max, symmetric
        )
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


def _piece(
    K: PETSc.Mat,
    M: PETSc.Mat,
    mass: sp.csr_matrix,
    a: float,
    b: float,
    high: float,
    tolerance: float,
    zeta_max: float,
    symmetric: bool,
) -> tuple[tuple[Complex, Complex, Complex], int]:
    """Eigenpairs with a <= Re kappa <= b and some beyond, as far as the border may move."""
    bottom, top = a if np.isfinite(a) else -0.02 * high, b * (1 + PLAY)
    sigma = 0.5 * (bottom + top) * (1 + 1.234e-7)
    reach = 1.001 * np.hypot(0.5 * (top - bottom), 2 * zeta_max * top * (not symmetric))
    wanted = PER_SHIFT + 10
    n = K.getSize()[0]
    while True:
        kappa, right, left, used = nearest(K, M, mass, sigma, min(wanted, n), tolerance, symmetric)
        if kappa.size >= n or np.abs(kappa - sigma).max() > reach:
            return (kappa, right, left), used
        wanted = int(1.5 * wanted)


def nearest(
    K: PETSc.Mat,
    M: PETSc.Mat,
    mass: sp.csr_matrix,
    sigma: float,
    wanted: int,
    tolerance: float,
    symmetric: bool,
) -> Found:
    """The eigenpairs nearest to a real shift, with left vectors."""
    eps = SLEPc.EPS().create(K.comm)
    eps.setOptionsPrefix("brake_eigen_")
    eps.setOperators(K, M)
    kind = SLEPc.EPS.ProblemType
    eps.setProblemType(kind.GHEP if symmetric else kind.GNHEP)
    eps.setTwoSided(not symmetric)
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
    xr, xi = K.createVecs()[0], K.createVecs()[0]
    yr, yi = xr.duplicate(), xr.duplicate()
    kappa = np.empty(got, dtype=complex)
    right, left = (np.empty((xr.size, got), dtype=complex) for _ in range(2))
    for i in range(got):
        kappa[i] = eps.getEigenpair(i, xr, xi)
        right[:, i] = xr.array_r + 1j * xi.array_r
        if symmetric:
            left[:, i] = right[:, i]
            continue
        eps.getLeftEigenvector(i, yr, yi)
        left[:, i] = yr.array_r + 1j * yi.array_r
        # SLEPc gives y' K = kappa y' M for one sign of the imaginary part: take the partner
        # that is not orthogonal to the right vector.
        y, Mx = left[:, i], mass @ right[:, i]
        if abs(y @ Mx) > abs(y.conj() @ Mx):
            left[:, i] = y.conj()
    used = eps.getIterationNumber()
    eps.destroy()
    return kappa, right, left, used
