"""An inverse without its lowest modes."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import Solves

Array = NDArray[np.float64]


class Deflated:
    """R_0 in place of K0^-1: the kept modes are taken out of every solve, before round-off grows.

    Taken out of the moments at the end, they leave round-off (kappa / Lambda_1)^j times as large.
    """

    def __init__(self, factor: Solves, Phi: Array, Lambda: Array):
        """R_0 = K0^-1 - Phi Lambda^-1 Phi'.

        Args:
            factor: solves with K0.
            Phi: M-orthonormal modes, shape (dofs, modes).
            Lambda: their eigenvalues [1/s^2].
        """
        self.factor, self.Phi, self.Lambda = factor, Phi, Lambda

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """R_0 b for a block, shape (dofs, columns)."""
        return self.factor.solve(b) - self.Phi @ ((self.Phi.T @ b) / self.Lambda[:, None])
