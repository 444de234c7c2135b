"""What the offline stage of the reduced model leaves behind."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .rough import Rough

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RoughBasis:
    """The orders from 1 on, which correct, and what bounds errors; for rough products.

    Attributes:
        NN: N R_j N', j = 1, 2, ...
        NT: N R_j T', likewise.
        TT: T R_0 T'.
        compliance: (N K0^-1 N', T K0^-1 T').
    """

    NN: dict[int, Rough]
    NT: dict[int, Rough]
    TT: Rough
    compliance: tuple[Rough, Rough]


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

    @cached_property
    def rough(self) -> RoughBasis:
        """What the errors of samples are measured with."""
        orders = range(1, len(self.NN))
        NN, NT = ({j: Rough(R[j]) for j in orders} for R in (self.NN, self.NT))
        A_NN, _, A_TT = self.compliance
        return RoughBasis(NN, NT, Rough(self.TT), (Rough(A_NN), Rough(A_TT)))
