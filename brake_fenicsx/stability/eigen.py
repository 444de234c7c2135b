"""Full order: all complex modes of a band, and the proof that none is missing.

Undamped, the problem is K phi = kappa M phi with kappa = -lambda^2, in real arithmetic:

- up to 300 dofs: dense; counted by inertia, or by the winding number of det(K - kappa M);
- symmetric K: block Lanczos, complete by inertia;
- K_s plus friction of low rank: block Arnoldi from either side; inertia of K_s and the winding
  number of a determinant on the contact interface count the modes of a region around the band;
- anything else: SLEPc, and the record says that nothing was counted.

Damped problems are those of ``full.general``; large ones are counted by a reduced model: the whole
brake without friction, its contact springs included, is one substructure whose modes an inertia
count proves complete; damping couples them with what they leave out, and friction, of low rank,
enters as the forces of a contact. The zeros of its T(z) are the eigenvalues.

Two processes may share the work: right and left vectors, the modes without friction and the moments
of the interface, two halves of the proof.
"""

import time
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex, frequency_band
from brake_fenicsx.errors import InaccurateResult, NotConverged, SceneError
from brake_fenicsx.macro.solver import whole, with_interface

from .eigensolvers import eigenpairs, symmetric
from .eigensolvers.argument_principle import damped_region
from .full.friction_modes import friction_modes
from .full.general import DENSE, damped_modes, general_modes, small_modes
from .full.interface import Found, Interface, SplitProblem, difference_interface
from .modes import Count, Modes, counted_rows, undamped_rows
from .substructures import contact_rows, offline, substructure

# The count needs the number of zeros, not their digits.
TOLERANCE = 1e-3


def tangent(
    K: Any, N: sp.csr_matrix, T: sp.csr_matrix, w: Array, k: Array, mu: float | Array
) -> Any:
    """K + N'W k N + T'W mu k N; non-symmetric where mu is not zero.

    Args:
        K: elastic stiffness [N/m], SciPy sparse or PETSc.
        N: gap operator, shape (elements, dofs).
        T: slip operator, shape (elements, dofs).
        w: areas [m^2].
        k: contact stiffness [Pa/m].
        mu: friction coefficient, one or one per element.

    Returns:
        A new matrix, CSR.
    """
    # The pressures' work on N + mu T, the gaps' change through N.
    left = (N + sp.diags(np.broadcast_to(mu, w.shape)) @ T).tocsr() if np.any(mu) else N
    return with_interface(whole(K), left, w * k, N)


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
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Modes:
    """All complex modes of a frequency band of (lambda^2 M + lambda C + K) phi = 0.

    Args:
        M: mass [kg], symmetric positive definite, SciPy sparse, PETSc or an array.
        C: damping [N s/m]; None where there is none.
        K: stiffness [N/m], not symmetric where there is friction. The processes of a distributed
            matrix must call together; each gathers the whole of it and solves for itself.
        band: lowest and highest frequency [Hz].
        method: "full".
        tolerance: relative residual of every mode.
        zeta_max: largest damping ratio looked for; bounds the imaginary parts of kappa.
        frictionless: for non-symmetric K the same stiffness at mu = 0; the symmetric half of K if
            None.
        friction: K - frictionless by contact elements, see ``contact_interface``; found from the
            matrices if None, which takes longer.
        comm: processes that call together with the same problem, of which two share the work; each
            solves it for itself if not given.

    Returns:
        The modes, sorted by frequency, one of each conjugate pair.

    Raises:
        SceneError: unknown method, or a band that is none.
        NotConverged: the eigensolver leaves a mode unconverged.
        InaccurateResult: the modes found are not as many as were counted.
    """
    if method != "full":
        raise SceneError(f"method {method!r}: complex_modes knows 'full'; see ReducedModel")
    band = frequency_band(band)
    start = time.perf_counter()
    problem = _problem(K, M, frictionless, friction)
    if C is not None:
        return damped_modes(problem, whole(C), band, tolerance, zeta_max, counted, comm)
    low, high = ((2 * np.pi * f) ** 2 for f in band)
    found = None
    if problem.K.shape[0] <= DENSE:
        found = small_modes(problem, low, high, zeta_max)
    elif problem.symmetric:
        found = _symmetric(problem, high)
    elif problem.friction is not None:
        found = friction_modes(problem, problem.friction, low, high, zeta_max, comm)
    if found is None:
        found = general_modes(problem, high, zeta_max, 1e-2 * tolerance)
    return _record(problem, found, band, tolerance, zeta_max, start)


def _problem(K: Any, M: Any, frictionless: Any, friction: Interface | None) -> SplitProblem:
    """Take the matrices apart."""
    K, M = whole(K), whole(M)
    given = None if frictionless is None else whole(frictionless)
    # The three components of a displacement share no mass: two thirds of the pattern.
    if not np.all(M.data):
        M = M.copy()
        M.eliminate_zeros()
    if symmetric.is_symmetric(K):
        return SplitProblem(K, M, K, None, False)
    halved = given is None and friction is None
    if given is None and friction is not None:
        given = (K - friction.left.T @ friction.right).tocsr()
    elif given is None:
        given = (0.5 * (K + K.T)).tocsr()
    if K.shape[0] > DENSE and friction is None:
        difference = (K - given).tocsr()
        difference.data[np.abs(difference.data) < 1e-15 * abs(K).max()] = 0.0
        friction = difference_interface(difference)
    return SplitProblem(K, M, given, friction, halved)


def _symmetric(p: SplitProblem, high: float) -> Found:
    """Block Lanczos.

    Raises:
        InaccurateResult: K has eigenvalues far below zero, or inertia counts other modes.
    """
    shifted = symmetric.shifted_factor(p.K, p.M, high, symmetric.LARGEST_SHIFT)
    if shifted is None:
        raise InaccurateResult(f"""the stiffness is not positive semi-definite: eigenvalues kappa =
            -lambda^2 below {-symmetric.LARGEST_SHIFT * high:.2g} 1/s^2; look for a negative
            spring""")
    modes = symmetric.symmetric_modes(p.K, p.M, *shifted, high)
    shifted[0].destroy()
    shapes = modes.Phi.astype(complex)
    counting = Count("proven", "inertia of K - kappa M")
    return Found(modes.kappa.astype(complex), shapes, shapes, counting)


def _record(
    p: SplitProblem,
    f: Found,
    band: tuple[float, float],
    tolerance: float,
    zeta_max: float,
    start: float,
) -> Modes:
    """Errors, condition numbers and rows of the band.

    Raises:
        NotConverged: a mode misses the tolerance by more than round-off explains.
    """
    MX = eigenpairs.times(p.M, f.right)
    R = eigenpairs.times(p.K, f.right) - f.kappa * MX
    left = eigenpairs.paired(f.kappa, f.left, MX)
    condition, error = eigenpairs.undamped_errors(p.M, f.kappa, f.right, left, R, MX)
    pencil = eigenpairs.QuadraticPencil(p.M, None, p.K)
    residual, backward = eigenpairs.residuals(pencil, np.sqrt(-f.kappa), f.right, R, MX)
    order, lam, spread, real = undamped_rows(f.kappa, error, band)
    missed = (residual > tolerance) & (backward > eigenpairs.ROUND_OFF)
    if np.any(missed[order]):
        raise NotConverged(f"""full order: relative residual {residual[order].max():.1e}, wanted
            {tolerance:.0e}""")
    right, left, residual = f.right[:, order], left[:, order], residual[order]
    count, seconds = counted_rows(lam, f.counting, zeta_max), time.perf_counter() - start
    return Modes(lam, right, left, residual, spread, condition[order], count, seconds, real)


def counted(p: SplitProblem, C: sp.csr_matrix, s: Complex, high: float, zeta_max: float) -> Count:
    """Compare the modes found with the zeros of T around the band.

    Args:
        p: the problem without damping.
        C: damping [N s/m].
        s: eigenvalues found, with conjugates, up to a little beyond the region [1/s].
        high: upper end of the band [rad/s].
        zeta_max: the region holds the modes of the band up to this damping ratio.

    Returns:
        How they were counted, or why not.

    Raises:
        InaccurateResult: the numbers differ.
    """
    if not (p.symmetric or p.friction is not None):
        return p.not_low_rank
    dofs = np.arange(C.shape[0])
    none = sp.csr_matrix((0, dofs.size))
    left, right = (none, none) if p.friction is None else (p.friction.left, p.friction.right)
    elements = np.arange(right.shape[0])
    body = substructure.Substructure(
        dofs, elements, p.frictionless, p.M, C, {"N": right, "T": left}, np.zeros((dofs.size, 0))
    )
    one = np.ones(elements.size)
    # Friction left' right with springs of 1 N/m, and nothing along the gaps.
    contact = contact_rows.ContactLinearisation(0 * one, one, 0 * one, 0 * one)
    try:
        model = offline.reduce_bodies([body], one, (0.0, high / 2 / np.pi), tolerance=TOLERANCE)
    except InaccurateResult as error:
        if symmetric.count_below(p.frictionless, p.M, -symmetric.SHIFT * high**2)[0] > 0:
            return p.indefinite
        return Count("not counted", f"{error}; lower the end of the band")
    zeros = model.zeros([], contact)
    wide = zeta_max / np.sqrt(1 - zeta_max**2)
    region = damped_region(np.r_[s, zeros], high, wide)
    found, expected = int(region.holds(s).sum()), int(region.holds(zeros).sum())
    if found != expected:
        raise InaccurateResult(f"damped modes: {found} found, the reduced problem has {expected}")
    return Count("proven", "zeros of T(z) of the frictionless modes, complete by inertia")
