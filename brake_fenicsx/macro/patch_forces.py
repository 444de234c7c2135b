"""Forces of the contact elements on the pad, and their tangent: one law of contact and friction.

An element of area w under the pressure p has the forces

    w p (1, t, r)

along its normal, along and across the sliding direction; t and r are the traction over the pressure
(``friction``), t = mu and r = 0 in the equilibrium. Their tangent is -w k (1, t, r) to the gap, k =
-dp/dg, and w p d(1, t, r)/dv to the slip rates v. Equilibrium, small vibrations and limit cycles
take them from here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PatchForces:
    """Forces of some contact elements along n, s and r, and their tangent.

    Attributes:
        value: [N], shape (3, elements, ...).
        gap: derivatives to the gaps [N/m], likewise.
        rate: derivatives to the slip rates along and across [N s/m], shape (3, 2, elements, ...).
    """

    value: Array
    gap: Array
    rate: Array


def patch_forces(
    w: Array, p: Array, k: Array, traction: Array, slopes: Array | None = None
) -> PatchForces:
    """Forces of contact elements.

    Args:
        w: areas [m^2], shape (elements,).
        p: pressures [Pa], shape (elements, ...).
        k: stiffnesses -dp/dg [Pa/m], likewise.
        traction: t and r, shape (2, elements, ...).
        slopes: their derivatives to the slip rates [s/m], shape (2, 2, elements, ...); none if
            None.
    """
    w = w.reshape(-1, *[1] * (p.ndim - 1))
    direction = np.stack([np.ones_like(p), *np.broadcast_to(traction, (2, *p.shape))])
    rate = np.zeros((3, 2, *p.shape))
    if slopes is not None:
        rate[1:] = w * p * slopes
    return PatchForces(w * p * direction, -w * k * direction, rate)


def sliding(mu: float | Array, p: Array) -> Array:
    """Traction over the pressure of elements that slide steadily, t = mu and r = 0."""
    return np.stack([np.broadcast_to(mu, p.shape), np.zeros_like(p)])
