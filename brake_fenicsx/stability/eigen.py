"""Full order: all complex modes of a band by shift-and-invert (SLEPc, MUMPS).

Undamped, the problem is K phi = kappa M phi with kappa = -lambda^2, in real arithmetic. The band is
cut into pieces of about equal numbers of modes; each is covered by the disc of one real shift.
"""

from __future__ import annotations

import time
from itertools import pairwise
from typing import Any

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult, NotConverged, SceneError
from brake_fenicsx.macro.condensation import petsc_matrix
from brake_fenicsx.macro.solver import Factor, local_rows

from .damped import Pencil, damped_modes
from .modes import Complex, Count, Modes, undamped_rows
from .operators import as_petsc, relative_residual

Array = NDArray[np.float64]

# Eigenvalues that one shift is asked for: a factorisation costs about as much as 50 solves.
PER_SHIFT = 60


def complex_modes(
    M: Any,
    C: Any,
    K: Any,
    band: tuple[float, float],
    method: str = "full",
    tolerance: float = 1e-9,
    zeta_max: float = 0.1,
    frictionless: Any = None,
) -> Modes:
    """All complex modes of a frequency band of (lambda^2 M + lambda C + K) phi = 0.

    Args:
        M: mass [kg], symmetric positive definite, SciPy sparse or PETSc.
        C: damping [N s/m]; None where there is none.
        K: stiffness [N/m], not symmetric where there is friction.
        band: lowest and highest frequency [Hz].
        method: "full".
        tolerance: relative residual of every mode.
        zeta_max: largest damping ratio looked for; bounds the imaginary parts of kappa.
        frictionless: for non-symmetric K the same stiffness at mu = 0, whose inertia then says
            how many modes the band holds without friction; the pieces of the band follow it.

    Returns:
        The modes, sorted by frequency, one of each conjugate pair.

    Raises:
        SceneError: unknown method.
        NotConverged: the eigensolver leaves a mode unconverged.
        InaccurateResult: for symmetric K, the inertia count differs from the modes found.
    """
    if method != "full":
        raise SceneError(f"method {method!r}: complex_modes knows 'full'; see Reduced")
    if C is not None:
        matrices = (local_rows(as_petsc(A)).tocsc() for A in (M, C, K))
        return damped_modes(Pencil(*matrices), band, tolerance, zeta_max)
    start = time.perf_counter()
    K, M = as_petsc(K), as_petsc(M)
    symmetric = _is_symmetric(K)
    low, high = ((2 * np.pi * f) ** 2 for f in band)
    reference = K if symmetric else frictionless
    expected = None if reference is None else _count(as_petsc(reference), M, high)
    if expected is not None and low > 0:
        expected -= _count(as_petsc(reference), M, low)
    edges = _pieces(low, high, PER_SHIFT if expected is None else expected)
    found = []
    iterations = 0
    for a, b in pairwise(edges):
        piece, used = _piece(K, M, a, b, high, tolerance, zeta_max, symmetric)
        found.append(piece)
        iterations += used
    kappa = np.concatenate([f[0] for f in found])
    right = np.hstack([f[1] for f in found])
    left = np.hstack([f[2] for f in found])
    inside = kappa.real <= high
    if symmetric and int(inside.sum()) != expected:
        raise InaccurateResult(
            f"{int(inside.sum())} modes found from {band[0]:g} to {band[1]:g} Hz,"
            f" inertia counts {expected}"
        )
    how = "inertia of K - kappa M"
    if not symmetric:
        how += " at mu = 0: friction may move modes over the edge of the band"
    if expected is None:
        expected, how = int(inside.sum()), "not counted: no frictionless stiffness was given"
    residual = relative_residual(K, M, kappa, right)
    condition, error = _two_sided(K, M, kappa, right, left)
    order, lam, spread, real = undamped_rows(kappa, error, band)
    return Modes(
        lam, right[:, order], left[:, order], residual[order], spread, condition[order],
        Count(expected, how), iterations, time.perf_counter() - start, real,
    )  # fmt: skip


def _two_sided(
    K: PETSc.Mat, M: PETSc.Mat, kappa: Complex, right: Complex, left: Complex
) -> tuple[Array, Array]:
    """Condition numbers in the norm of M, and errors from the two-sided quotient [1/s^2]."""
    MX, KX = _times(M, right), _times(K, right)
    overlap = np.einsum("im,im->m", left.conj(), MX)
    norms = np.einsum("im,im->m", right.conj(), MX).real
    norms = norms * np.einsum("im,im->m", left.conj(), _times(M, left)).real
    condition = np.sqrt(norms) / np.abs(overlap)
    first = np.abs(np.einsum("im,im->m", left.conj(), KX - kappa * MX) / overlap)
    # What the quotient of two inexact vectors leaves open, and the round-off of the solves.
    return condition, first + 1e-11 * condition * np.abs(kappa).max(initial=0.0)


def _times(M: PETSc.Mat, X: Complex) -> Complex:
    rows = local_rows(M)
    return np.asarray(rows @ X)


def _is_symmetric(K: PETSc.Mat) -> bool:
    rows = local_rows(K)
    return bool(abs(rows - rows.T).max() <= 1e-12 * abs(rows).max())


def _count(K: PETSc.Mat, M: PETSc.Mat, kappa: float) -> int:
    """Eigenvalues below kappa of a symmetric pencil, by Sylvester's law of inertia."""
    shifted = petsc_matrix((local_rows(K) - kappa * local_rows(M)).tocsr())
    factor = Factor(shifted, "brake_inertia_")
    count = factor.negative_pivots
    factor.destroy()
    return count


def _pieces(low: float, high: float, count: int) -> Array:
    """Borders of pieces of the band, equal in frequency, of about PER_SHIFT modes at most."""
    n = max(1, int(np.ceil(count / PER_SHIFT)))
    edges = np.linspace(np.sqrt(low), np.sqrt(high), n + 1) ** 2
    # Rigid and diverging modes lie at kappa <= 0.
    edges[0] = -np.inf if low <= 0 else low
    return edges


def _piece(
    K: PETSc.Mat,
    M: PETSc.Mat,
    a: float,
    b: float,
    high: float,
    tolerance: float,
    zeta_max: float,
    symmetric: bool,
) -> tuple[tuple[Complex, Complex, Complex], int]:
    """Eigenpairs with a <= Re kappa < b."""
    bottom = a if np.isfinite(a) else -0.02 * high
    sigma = 0.5 * (bottom + b) * (1 + 1.234e-7)
    reach = 1.001 * np.hypot(0.5 * (b - bottom), 2 * zeta_max * b * (not symmetric))
    wanted = PER_SHIFT + 10
    n = K.getSize()[0]
    while True:
        kappa, right, left, used = _nearest(K, M, sigma, min(wanted, n), tolerance, symmetric)
        if kappa.size >= n or np.abs(kappa - sigma).max() > reach:
            break
        wanted = int(1.5 * wanted)
    keep = (kappa.real >= a) & (kappa.real < b)
    return (kappa[keep], right[:, keep], left[:, keep]), used


def _nearest(
    K: PETSc.Mat, M: PETSc.Mat, sigma: float, wanted: int, tolerance: float, symmetric: bool
) -> tuple[Complex, Complex, Complex, int]:
    """The eigenpairs nearest to a real shift, with left vectors."""
    eps = SLEPc.EPS().create(K.comm)
    eps.setOptionsPrefix("brake_eigen_")
    eps.setOperators(K, M)
    kind = SLEPc.EPS.ProblemType
    eps.setProblemType(kind.GHEP if symmetric else kind.GNHEP)
    eps.setTwoSided(not symmetric)
    eps.setDimensions(wanted, min(K.getSize()[0], 2 * wanted + 20))
    eps.setTolerances(tolerance * 1e-2, 200)
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
    rows = local_rows(M)
    kappa = np.empty(got, dtype=complex)
    right, left = (np.empty((xr.size, got), dtype=complex) for _ in range(2))
    for i in range(got):
        kappa[i] = eps.getEigenpair(i, xr, xi)
        right[:, i] = xr.array_r + 1j * xi.array_r
        if symmetric:
            left[:, i] = right[:, i]
        else:
            eps.getLeftEigenvector(i, yr, yi)
            left[:, i] = yr.array_r + 1j * yi.array_r
            # SLEPc gives y' K = kappa y' M for one sign of the imaginary part: take the partner
            # that is not orthogonal to the right vector.
            y, Mx = left[:, i], rows @ right[:, i]
            if abs(y @ Mx) > abs(y.conj() @ Mx):
                left[:, i] = y.conj()
    used = eps.getIterationNumber()
    eps.destroy()
    return kappa, right, left, used
