"""Undamped modes with friction, K of any kind: block Arnoldi from either side.

K phi = kappa M phi is solved by shift and invert about a small negative kappa, for right vectors
and, with K', for left ones.
"""

from __future__ import annotations

from mpi4py import MPI

from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.macro.solver import BlockProduct, Factor

from ..eigensolvers.argument_principle import RIM
from ..eigensolvers.arnoldi import nearest_modes
from ..eigensolvers.eigenpairs import both_sides
from ..eigensolvers.symmetric import SHIFT, count_below
from ..modes import Complex
from .eigenproblem import SplitProblem

# Relative residuals of block Arnoldi. Left vectors weigh residuals of right ones: few digits do.
RIGHT, LEFT = 1e-10, 1e-8


def unsymmetric_modes(
    p: SplitProblem, high: float, zeta_max: float, comm: MPI.Comm = MPI.COMM_SELF
) -> tuple[Complex, Complex, Complex]:
    """All modes up to the far corners of the region that is counted, and conjugates; collective.

    Args:
        p: the problem; its frictionless part serves to guess how many modes there are.
        high: upper end of the band [1/s^2].
        zeta_max: largest damping ratio looked for.
        comm: two processes that share the work, or one.

    Returns:
        kappa [1/s^2], right and left vectors.

    Raises:
        NotConverged: the Krylov space fills without convergence.
        InaccurateResult: a right vector has no left one.
    """
    sigma = -SHIFT * high
    # The edges of that region may lie beyond the band by RIM.
    end = RIM**2 * high / (1 - zeta_max**2)
    expected, mass = count_below(p.frictionless, p.M, end)[0] + 1, BlockProduct(p.M)

    def side(transposed: bool) -> tuple[Complex, Complex]:
        shifted = (p.K - sigma * p.M).tocsr()
        lu = Factor(shifted.T if transposed else shifted, "brake_lu_", symmetric=False)
        # A little further, so that each of the right ones has its left one.
        found = nearest_modes(
            lambda b: lu.solve(mass(b)),
            *(p.M.shape[0], sigma, RIM * (end - sigma), expected),
            tolerance=LEFT if transposed else RIGHT,
        )
        lu.destroy()
        release_memory()
        return found

    return both_sides(side, sigma, end - sigma, comm)
