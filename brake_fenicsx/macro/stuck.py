"""Interfaces whose faces stick: tangential springs before slip, and how far that holds.

The law of the contact acts along the normal, as everywhere. Along the faces every contact element
of area w has the traction k_t times its slip, that of the first face less that of the second,

    K <- K + sum w k_t (T'T + R'R),

in the equilibrium and in the modes, whether the element is open or not and however large its slip:
the state at equilibrium says where that is wrong, |k_t slip| > mu p (Coulomb) or p = 0.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Mask

from .contact_elements import Contact


@dataclass(frozen=True, slots=True)
class Stuck:
    """Tangential springs of one interface.

    Attributes:
        T: slip along the first direction, CSR, shape (elements, free dofs).
        R: slip along the second one.
        contact: the elements; of their own T and R nothing is left.
        stiffness: k_t [Pa/m].
    """

    T: sp.csr_matrix
    R: sp.csr_matrix
    contact: Contact
    stiffness: float

    def matrix(self) -> sp.csr_matrix:
        """Stiffness of the springs on the free dofs [N/m]."""
        springs = sp.diags(self.contact.w * self.stiffness)
        return sum(A.T.tocsr() @ springs @ A for A in (self.T, self.R)).tocsr()

    def state(self, u: Array, p: Array, limit: float | None = None) -> "StuckState":
        """What the faces do at an equilibrium.

        Args:
            u: displacement [m], shape (free dofs,).
            p: pressures of these elements [Pa], shape (elements,).
            limit: friction coefficient up to which faces stick; None: none is known.
        """
        c, n = self.contact, self.contact.normal
        along, across = (-self.stiffness * (A @ u) for A in (self.T, self.R))
        traction = along[:, None] * c.s + across[:, None] * np.cross(n, c.s)
        is_open, beyond = p <= 0, np.zeros(p.shape, dtype=bool)
        if limit is not None:
            beyond = ~is_open & (np.hypot(along, across) > limit * p)
        return StuckState(is_open, beyond, c.w, (c.w * p) @ n, c.w @ traction)


@dataclass(frozen=True, slots=True)
class StuckState:
    """State of an interface whose faces stick.

    Attributes:
        is_open: whether an element carries no pressure, shape (elements,).
        beyond: whether a closed one has more than the friction coefficient times the pressure along
            the faces.
        w: areas [m^2].
        normal: normal force on the first face [N], shape (3,).
        tangential: force along the faces on it [N], shape (3,).
    """

    is_open: Mask
    beyond: Mask
    w: Array
    normal: Array
    tangential: Array

    def share(self, chosen: Mask) -> float:
        """Share of some elements in the area [-]."""
        return float(self.w[chosen].sum() / self.w.sum())


def stick(contact: Contact, stiffness: float) -> tuple[Contact, Stuck]:
    """An interface without slip operators, and the springs in their place.

    Args:
        contact: the interface, of faces without motion.
        stiffness: k_t [Pa/m].
    """
    none = sp.csr_matrix(contact.T.shape)
    bare = replace(contact, T=none, R=none)
    return bare, Stuck(contact.T, contact.R, bare, stiffness)
