"""Displacements of modes of the reduced model, with all that the kept modes leave out.

The left vector is the mode of the transposed problem: bodies transposed, and forces along the rows
whose motions are followed.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.errors import NotConverged

from ..eigensolvers.complex_columns import on_parts, times
from ..modes import Complex
from .moments import Complement, Rows
from .sample import Sample
from .vectors import left_motions, right_motions

# Steps at most, and the relative change at which they end; each gains the ratio of the band's end
# to the nearest pole of what is left out, or more.
STEPS, SETTLED = 60, 1e-8


def mode_displacements(
    sample: Sample, x: np.ndarray, rows: Rows, z: Complex, a: Complex, left: bool = False
) -> Complex:
    """Displacements W a + v of the bodies, v from their matrices at full order.

    Args:
        sample: the reduced problem of the sample.
        x: its point of the box, shape (d,).
        rows: blocks of contact rows.
        z: eigenvalues, in units of the model, shape (chosen,).
        a: coordinates of the kept modes, shape (kept modes, chosen).
        left: whether these are left vectors, not conjugated.

    Returns:
        Shape (dofs, chosen).

    Raises:
        NotConverged: v does not settle.
    """
    if left:
        force, along = left_motions(sample, z, a), rows.followed
    else:
        force, along = sample.forces(z, right_motions(sample, z, a)), rows.acting
    out = np.zeros((sum(b.dofs.size for b in sample.bodies), z.size), complex)
    # One factor at a time: that of a body and its mirror images.
    for component in dict.fromkeys(body.component for body in sample.bodies):
        P = component.polynomial(x)
        P = [A.T.tocsr() for A in P] if left else P
        complement = Complement(P[0], component.body.M, component.W)
        I = sp.vstack([component.body.interface[name] for name in along]).tocsr()
        try:
            for body, at in zip(sample.bodies, sample.closed, strict=True):
                if body.component is not component:
                    continue
                acting, there = at.rows(len(along), body.elements.size, sample.count)
                kept = times(component.W, a[body.modes])
                load = times(I[acting].T.tocsr(), force[there])
                v = _left_out(complement, P, z, kept, load)
                out[body.dofs] = body.signs[:, None] * (kept + v)
        finally:
            complement.factor.destroy()
    return out


def _left_out(
    complement: Complement, P: list[sp.csr_matrix], z: Complex, kept: Complex, load: Complex
) -> Complex:
    """V of S(z)^-1 v = -load - P(z) kept, by the inverse at the shift."""
    v = np.zeros_like(kept)
    for _ in range(STEPS):
        rhs = -load - np.sum([z**n * times(A, kept) for n, A in enumerate(P)], axis=0)
        rhs -= np.sum([z**n * times(A, v) for n, A in enumerate(P) if n], axis=0)
        new = on_parts(complement.solve, rhs)
        change, v = np.linalg.norm(new - v), new
        if change <= SETTLED * np.linalg.norm(kept + v):
            return v
    raise NotConverged("displacements of a mode: what the kept modes leave out does not settle")
