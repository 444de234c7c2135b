"""Error estimates of the reduced model, and the simple zeros and close pairs that they hold for.

To first order a change dD of the moments moves a zero by [eta; b]' dD [J y; a] / (b'T'a). Close to
another zero that is not the size of the move: two zeros that merge move by its root (Kato,
Perturbation Theory for Linear Operators, 1980, chapter II).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..modes import Complex

Array = NDArray[np.float64]

# First-order moves larger than this share of the distance to the next zero are not of first order.
CLOSE = 0.125

# An estimate is a few sizes of terms added up; it is stated with this factor.
SAFETY = 2.0

# Round-off of the projected matrices, in units of the band's end.
ROUND_OFF = 1e-10


def stated_error(first: Array, step: Array, gap: Array) -> Array:
    """Error that is stated of each zero.

    Args:
        first: first-order move under what is truncated, interpolated and rounded.
        step: the step of the quotient that was taken.
        gap: distance to the next zero.
    """
    gap = np.maximum(gap, 1e-300)
    simple = first + step**2 / gap
    close = first + step + np.sqrt(first * gap)
    return np.asarray(SAFETY * np.where(first + step < CLOSE * gap, simple, close))


def corrected(z: Complex, step: Complex, gap: Array) -> Complex:
    """Zeros after their step; none is taken beyond the next zero, where its slope means nothing."""
    return np.asarray(np.where(np.abs(step) < gap, z + step, z))


def distances(z: Complex, chosen: NDArray[np.intp]) -> Array:
    """Distance of some zeros to the next of all zeros."""
    apart = np.abs(z[chosen][:, None] - z[None, :])
    apart[np.arange(chosen.size), chosen] = np.inf
    return np.asarray(apart.min(axis=1, initial=np.inf))
