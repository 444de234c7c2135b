"""What the offline stage of the reduced model leaves behind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Basis:
    """What the offline stage leaves behind; all of it dense and small.

    Attributes:
        Lambda: eigenvalues of the reference [1/s^2], shape (modes,).
        Phi_N: gaps of its modes, shape (elements, modes).
        Phi_T: slips of its modes, shape (elements, modes).
        NN: N R_j N', j = 0, 1, 2 at least, each of shape (elements, elements).
        NT: N R_j T'.
        TT: T R_0 T'.
        compliance: (N K0^-1 N', N K0^-1 T', T K0^-1 T') with the modes.
        w: areas [m^2].
        k0: reference stiffness [Pa/m].
        limit: no mode of the reference below it is missing [1/s^2].
    """

    Lambda: Array
    Phi_N: Array
    Phi_T: Array
    NN: tuple[Array, ...]
    NT: tuple[Array, ...]
    TT: Array
    compliance: tuple[Array, Array, Array]
    w: Array
    k0: Array
    limit: float
