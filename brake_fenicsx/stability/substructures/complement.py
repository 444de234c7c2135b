"""Inverse of a body on what its kept modes leave out, at the shift of the reduced model."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.solver import Factor

from ..eigensolvers.arnoldi import plus

Array = NDArray[np.float64]

# A matrix is symmetric up to this share of its largest entry.
SYMMETRIC = 1e-12

INDEFINITE = (
    "the stiffness of a body is not positive definite somewhere in the box of the random"
    " materials: narrow their distributions"
)


def is_symmetric(A: sp.csr_matrix) -> bool:
    """Whether a matrix is its own transpose, to round-off."""
    return bool(abs(A - A.T).max() <= SYMMETRIC * abs(A).max())


class Complement:
    """Inverse of P_0 on the displacements that are M-orthogonal to the kept modes."""

    def __init__(self, P0: sp.csr_matrix, M: sp.csr_matrix, W: Array):
        """Factor P_0.

        Args:
            P0: P_0 or its transpose, shape (n, n).
            M: mass [kg].
            W: M-orthonormal kept modes, shape (n, m).

        Raises:
            InaccurateResult: a symmetric P_0 is not positive definite.
        """
        symmetric = is_symmetric(P0)
        self.factor = Factor(P0, "brake_residual_", symmetric=symmetric)
        if symmetric and self.factor.negative_pivots:
            self.factor.destroy()
            raise InaccurateResult(INDEFINITE)
        self._W, self._MW = W, np.asfortranarray(M @ W)
        self._Y = self.factor.solve(self._MW)
        self._small = np.linalg.inv(self._MW.T @ self._Y) if W.shape[1] else np.zeros((0, 0))

    def solve(self, b: Array) -> Array:
        """S_0 b of a block of right-hand sides, shape (n, columns)."""
        x = self.factor.solve(plus(np.array(b, order="F"), self._MW, self._W.T @ b, -1.0))
        return plus(x, self._Y, self._small @ (self._MW.T @ x), -1.0)
