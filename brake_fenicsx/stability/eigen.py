"""Full order: all complex modes of a band, and the proof that none is missing.

Undamped, the problem is K phi = kappa M phi with kappa = -lambda^2, in real arithmetic:

- symmetric K: block Lanczos, complete by inertia;
- K_s plus friction of low rank: block Arnoldi from either side; inertia of K_s and the winding
  number of a determinant on the contact interface count the modes of a region around the band;
- small matrices: dense; the winding number of det(K - kappa M) itself counts;
- anything else: shift-and-invert in slices, and the record says that nothing was counted.
"""

from __future__ import annotations

import time
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.macro.solver import local_rows

from .damped_count import counted
from .full.completeness import count_zeros
from .full.damped import damped_modes
from .full.dense import dense_modes
from .full.friction import friction_modes
from .full.problem import Found, Problem, agree, search_region
from .full.slices import sliced_modes
from .full.symmetric import count_below, shifted_factor, symmetric_modes
from .interface import Interface, difference_interface
from .modes import Modes, counted_rows, undamped_rows
from .operators import as_petsc
from .vectors import ROUND_OFF, paired, residuals, two_sided

# Up to this size all eigenvalues are computed, and counted by dense determinants.
DENSE = 300


def complex_modes(
    M: Any,
    C: Any,
    K: Any,
    band: tuple[float, float],
    method: str = "full",
    tolerance: float = 1e-9,
    zeta_max: float = 0.1,
    frictionless: Any = None,
    friction: Interface | None = None,
    comm: MPI.Comm | None = None,
) -> Modes:
    """All complex modes of a frequency band of (lambda^2 M + lambda C + K) phi = 0.

    Args:
        M: mass [kg], symmetric positive definite, SciPy sparse or PETSc.
        C: damping [N s/m]; None where there is none.
        K: stiffness [N/m], not symmetric where there is friction. The processes of a distributed
            matrix must call together; each holds the whole of it and of the result.
        band: lowest and highest frequency [Hz].
        method: "full".
        tolerance: relative residual of every mode.
        zeta_max: largest damping ratio looked for; bounds the imaginary parts of kappa.
        frictionless: for non-symmetric K the same stiffness at mu = 0; the symmetric half of K if
            None.
        friction: K - frictionless by contact elements, see ``contact_interface``; found from the
            matrices if None, which takes longer.
        comm: processes that share the work, each with the whole matrices; those of K if None. Only
            undamped problems with friction are shared, the others solved by each process.

    Returns:
        The modes, sorted by frequency, one of each conjugate pair.

    Raises:
        SceneError: unknown method, or a band that is none.
        NotConverged: the eigensolver leaves a mode unconverged.
        InaccurateResult: the modes found are not as many as were counted.
    """
    if method != "full":
        raise SceneError(f"method {method!r}: complex_modes knows 'full'; see ReducedModel")
    if not 0 <= band[0] < band[1]:
        raise SceneError(f"band {band[0]:g} to {band[1]:g} Hz: from at least 0 up to a higher one")
    if comm is None:
        comm = K.comm.tompi4py() if isinstance(K, PETSc.Mat) else MPI.COMM_SELF
    start = time.perf_counter()
    problem = _problem(K, M, frictionless, friction, comm)
    if C is not None:
        return damped_modes(problem, local_rows(as_petsc(C)), band, tolerance, zeta_max, counted)
    low, high = ((2 * np.pi * f) ** 2 for f in band)
    n = problem.K.shape[0]
    found = None
    if n <= DENSE:
        found = _small(problem, low, high, zeta_max)
    elif problem.symmetric:
        found = _symmetric(problem, low, high)
    elif problem.face is not None:
        found = friction_modes(problem, low, high, zeta_max)
    if found is None:
        found = _sliced(problem, low, high, tolerance, zeta_max)
    return _record(problem, found, band, tolerance, zeta_max, start)


def _problem(
    K: Any, M: Any, frictionless: Any, friction: Interface | None, comm: MPI.Comm
) -> Problem:
    """Take the matrices apart."""
    K, M = (local_rows(as_petsc(A)) for A in (K, M))
    # The three components of a displacement share no mass: two thirds of the pattern.
    M.eliminate_zeros()
    if abs(K - K.T).max() <= 1e-12 * abs(K).max():
        return Problem(K, M, K, None, comm)
    if frictionless is not None:
        smooth = local_rows(as_petsc(frictionless))
    elif friction is not None:
        smooth = (K - friction.left.T @ friction.right).tocsr()
    else:
        smooth = (0.5 * (K + K.T)).tocsr()
    if K.shape[0] > DENSE and friction is None:
        rest = (K - smooth).tocsr()
        rest.data[np.abs(rest.data) < 1e-15 * abs(K).max()] = 0.0
        friction = difference_interface(rest)
    return Problem(K, M, smooth, friction, comm)


def _small(p: Problem, low: float, high: float, zeta_max: float) -> Found:
    """Dense; counted by inertia if symmetric, else by the winding number of the determinant."""
    kappa, right, left = dense_modes(p.K, p.M, high, p.symmetric)
    if p.symmetric:
        expected, at = count_below(p.K, p.M, high)
        agree(int(np.sum(kappa.real < at)), expected, high, "inertia")
        return Found(kappa, right, left, "inertia of K - kappa M", 1)
    K, M = p.K.toarray(), p.M.toarray()
    region = search_region(kappa, low, high, zeta_max)
    expected = count_zeros(lambda z: K - z * M, region, kappa[np.abs(kappa) < 4 * high])
    agree(int(region.holds(kappa).sum()), expected, high, "the winding number")
    return Found(kappa, right, left, "winding number of det(K - kappa M)", 1)


def _symmetric(p: Problem, low: float, high: float) -> Found | None:
    """Block Lanczos; None where it does not apply."""
    shifted = shifted_factor(p.K, p.M, high)
    if shifted is None:
        return None
    modes = symmetric_modes(p.K, p.M, *shifted, high)
    shifted[0].destroy()
    if modes is None:
        return None
    shapes = modes.Phi.astype(complex)
    return Found(
        modes.kappa.astype(complex), shapes, shapes, "inertia of K - kappa M", modes.blocks
    )


def _sliced(p: Problem, low: float, high: float, tolerance: float, zeta_max: float) -> Found:
    """SLEPc, one vector at a time; symmetric problems are counted by inertia."""
    count, at = count_below(p.smooth, p.M, high)
    # Below the band, a little, so that what lies on its edge is found.
    bottom = low * (1 - 1e-9) if low > 0 else low
    below, bottom = count_below(p.smooth, p.M, bottom) if low > 0 else (0, bottom)
    kappa, right, left, used = sliced_modes(
        p.K, p.M, bottom, at, count - below, 1e-2 * tolerance, zeta_max, p.symmetric
    )
    if p.symmetric:
        agree(kappa.size, count - below, high, "inertia")
        return Found(kappa, right, left, "inertia of K - kappa M", used)
    return Found(kappa, right, left, "not counted: friction is not of low rank here", used)


def _record(
    p: Problem, f: Found, band: tuple[float, float], tolerance: float, zeta_max: float, start: float
) -> Modes:
    """Errors, condition numbers and rows of the band.

    Raises:
        NotConverged: a mode misses the tolerance by more than round-off explains.
    """
    left = paired(f.kappa, f.left, p.M @ f.right)
    condition, error = two_sided(p.K, p.M, f.kappa, f.right, left)
    residual, backward = residuals(p.K, p.M, f.kappa, f.right)
    order, lam, spread, real = undamped_rows(f.kappa, error, band)
    missed = (residual > tolerance) & (backward > ROUND_OFF)
    if np.any(missed[order]):
        raise NotConverged(
            f"full order: relative residual {residual[order].max():.1e}, wanted {tolerance:.0e}"
        )
    return Modes(
        lam, f.right[:, order], left[:, order], residual[order], spread, condition[order],
        counted_rows(lam, f.how, zeta_max), f.iterations, time.perf_counter() - start, real,
    )  # fmt: skip
