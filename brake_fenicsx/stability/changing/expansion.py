"""A body at one stiffness, before anything is added up: what a damped sample starts from.

With kappa' = kappa + sigma, kappa = -lambda^2, and the difference of its damping from one in
proportion, delta DeltaC (see ``proportion``), a body answers forces on its interface by

    B W (W'A W - kappa' + delta W'DeltaC W)^-1 W'B' + sum kappa'^j t^n R_jn,     t = delta / reach.

The first term is exact in the eigenvectors of W'A W; R_jn is a weighted sum over some matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Moment:
    """R_jn, n = 0, 1, ..., of one j.

    Attributes:
        j: power of kappa'.
        weights: of the matrices, shape (powers of t, matrices).
        matrices: rows that are looked at on all columns, shape (matrices, rows, columns).
    """

    j: int
    weights: Array
    matrices: Array


@dataclass(frozen=True, slots=True)
class Expansion:
    """A body at one stiffness.

    Attributes:
        elements: number of its contact elements.
        Lambda: kappa' of all directions of W [1/s^2], ascending.
        Phi: all rows of its interface on them, shape (directions, columns).
        Q: the directions in the coordinates of W.
        kept: number of the first ones that are modes of a sample.
        difference: Q'W' DeltaC W Q for t = 1 [1/s^2]; None where nothing differs.
        moments: the rest.
        TT: T R_0 T' with the loads, of the centre.
        series: damping of the modes and G_n of ``DampedBasis`` over all elements, of a body whose
            ``moments`` do not tell; None of all others.
    """

    elements: int
    Lambda: Array
    Phi: Array
    Q: Array
    kept: int
    difference: Array | None
    moments: Sequence[Moment]
    TT: Array
    series: tuple[Array, Array] | None = None
