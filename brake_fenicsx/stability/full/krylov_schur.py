"""The general undamped problem K phi = kappa M phi, K of any kind: SLEPc's Krylov-Schur method.

For friction that is not of low rank, and for matrices that nothing else is known of: shift and
invert in the middle of the band, for right vectors and, with the transposed matrices, for left
ones. SLEPc's own two-sided solver breaks down now and then (LAPACK's trevc, 2x2 blocks cut apart).
Nothing counts these modes.

Reference: G. W. Stewart, SIAM J. Matrix Anal. Appl. 23 (2002) 601, doi:10.1137/S0895479800371529.
"""

import brake_fenicsx.petsc_started  # noqa: F401
from brake_fenicsx.arguments import Complex

# isort: split

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.macro.solver import petsc_matrix

from ..eigensolvers.argument_principle import RIM, opening
from ..eigensolvers.eigenpairs import both_sides
from ..eigensolvers.symmetric import count_below
from .interface import Found, SplitProblem


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
    reach = 1.001 * high * np.hypot(0.52, opening(zeta_max))
    wanted = count_below(p.frictionless, p.M, RIM * high)[0] + 10

    def side(transposed: bool) -> tuple[Complex, Complex]:
        K, M = (A.T.tocsr() if transposed else A for A in (p.K, p.M))
        return _within(K, M, sigma, RIM * reach, wanted, tolerance)

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
    K: PETSc.Mat, M: PETSc.Mat, sigma: float, wanted: int, tolerance: float
) -> tuple[Complex, Complex]:
    """The eigenpairs nearest to a real shift, both of each conjugate pair."""
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
