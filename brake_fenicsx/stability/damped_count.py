"""How many modes a large damped problem has in its band, counted without its eigensolver.

The whole brake without friction, its contact springs included, is one substructure whose modes an
inertia count proves complete; damping couples them with what they leave out, and friction, of low
rank, enters as the forces of a contact. The zeros of its T(z) are the eigenvalues.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult

from .eigensolvers.argument_principle import damped_region
from .eigensolvers.symmetric import SHIFT, count_below
from .full.eigenproblem import SplitProblem
from .modes import Complex, Count
from .substructures.contact_rows import ContactLinearisation
from .substructures.offline import reduce_bodies
from .substructures.substructure import Substructure

# The count needs the number of zeros, not their digits.
TOLERANCE = 1e-3


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
    body = Substructure(
        dofs, elements, p.frictionless, p.M, C, {"N": right, "T": left}, np.zeros((dofs.size, 0))
    )
    one = np.ones(elements.size)
    # Friction left' right with springs of 1 N/m, and nothing along the gaps.
    contact = ContactLinearisation(0 * one, one, 0 * one, 0 * one)
    try:
        model = reduce_bodies([body], one, (0.0, high / 2 / np.pi), tolerance=TOLERANCE)
    except InaccurateResult as error:
        if count_below(p.frictionless, p.M, -SHIFT * high**2)[0] > 0:
            return p.indefinite
        return Count("not counted", f"{error}; lower the end of the band")
    zeros = model.zeros([], contact)
    wide = zeta_max / np.sqrt(1 - zeta_max**2)
    region = damped_region(np.r_[s, zeros], high, wide)
    found, expected = int(region.holds(s).sum()), int(region.holds(zeros).sum())
    if found != expected:
        raise InaccurateResult(f"damped modes: {found} found, the reduced problem has {expected}")
    return Count("proven", "zeros of T(z) of the frictionless modes, complete by inertia")
