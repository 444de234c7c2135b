"""How an equilibrium moves with its loads and its friction, to first order.

At fixed laws p = P(g), dp = -k dg; the condensed equilibrium (``equilibrium``) then gives dg from
one solution with the matrix of its last Newton step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .condensation import Compliance
from .equilibrium import Condensed, Equilibrium
from .gap import EnrichedGap

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EquilibriumChange:
    """Derivatives of an equilibrium to a parameter, shape (elements,).

    Attributes:
        p: of the pressures [Pa].
        k: of the stiffnesses of small vibrations [Pa/m].
    """

    p: Array
    k: Array


def equilibrium_change(
    compliance: Compliance,
    w: Array,
    laws: EnrichedGap,
    eq: Equilibrium,
    Nf: Array | None = None,
    mu: Array | None = None,
) -> EquilibriumChange:
    """Derivatives of an equilibrium to a load and to friction.

    Args:
        compliance: the bodies seen from the contact elements.
        w: areas [m^2], shape (elements,).
        laws: law and critical gap of every element.
        eq: the equilibrium.
        Nf: change of the loads, as ``Compliance.Nf`` [m]; none if None.
        mu: change of the friction coefficients, shape (elements,); none if None.

    Raises:
        NotConverged: the equilibrium is at a limit of its stability.
    """
    rhs = np.zeros(len(compliance.NT)) if Nf is None else Nf
    if mu is not None:
        rhs = rhs + compliance.NT @ (w * mu * eq.p)
    moved = Condensed(replace(compliance, Nf=rhs), w, np.zeros_like(w), eq.mu)
    g = moved.linear(1.0, np.zeros_like(w), eq.k)
    return EquilibriumChange(-eq.k * g, laws.vibration(eq.g)[1] * g)
