"""How many modes a large damped problem has in its band, counted without its eigensolver.

The problem is the one of the kept real modes without friction, ``Symmetric``, whose rest answers
through damping and the friction interface alone: det T(lambda) of ``damped_sample`` has its
eigenvalues for zeros, and turns once around each of them. The rest is taken at the small shift of
the factor, which moves the zeros of T by much less than they lie from the contour.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..interface import Interface
from ..modes import Complex
from ..reduced.damped_basis import DampedBasis, convergence_radius, damped_moments
from ..reduced.damped_sample import TOP, DampedSample
from ..vectors import RIM
from .completeness import count_zeros
from .damped_rows import rectangle
from .problem import Problem
from .symmetric import Symmetric, shifted_factor, symmetric_modes

Array = NDArray[np.float64]

# Real modes are kept up to this multiple of the band's end.
CUTOFF = 1.7


def counted(p: Problem, C: sp.csr_matrix, s: Complex, high: float, zeta_max: float) -> str:
    """Compare the modes found with the turns of det T around the band; collective.

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
    if not (p.symmetric or p.face is not None):
        return "not counted: friction is not of low rank here"
    shifted = shifted_factor(p.smooth, p.M, high**2)
    if shifted is None:
        return "not counted: the frictionless problem is not stable"
    modes = symmetric_modes(p.smooth, p.M, *shifted, (CUTOFF * high) ** 2)
    if modes is None:
        return "not counted: too many real modes"
    basis = _basis(modes, p.face, C, p.comm)
    modes.factor.destroy()
    wide = zeta_max / np.sqrt(1 - zeta_max**2)
    region = rectangle(s, high, wide, RIM)
    if not basis.radius > 1.02 * RIM * np.hypot(1, wide) * high:
        return "not counted: damping too strong for the determinant"
    one = np.ones_like(basis.w)
    sample = DampedSample(basis, one, one, one, one)
    count = count_zeros(sample.at, region, s)
    found = int(region.holds(s).sum())
    if found != count:
        raise InaccurateResult(f"damped modes: {found} found, the winding number counts {count}")
    return "winding number of det T(lambda), on real modes complete by inertia"


def _basis(
    modes: Symmetric, face: Interface | None, C: sp.csr_matrix, comm: MPI.Comm
) -> DampedBasis:
    """The rest of the real modes, seen through damping and friction.

    Friction left' right takes the places of N and T with springs of one: dD = 0 and mu D = 1.
    """
    Phi, n = modes.Phi, C.shape[0]
    none = sp.csr_matrix((0, n))
    left, right = (none, none) if face is None else (face.left, face.right)
    I = sp.vstack([right, left]).tocsr()
    kept = Phi, modes.kappa - modes.sigma
    G = damped_moments(modes.factor, kept, modes.M, C, right, I, comm, order=TOP + 3)
    radius = convergence_radius(G, right.shape[0], I.shape[0], modes.limit)
    one = np.ones(right.shape[0])
    return DampedBasis(
        modes.kappa, Phi.T @ (C @ Phi), right @ Phi, I @ Phi, tuple(G), "N", {}, one, one,
        modes.limit, radius,
    )  # fmt: skip
