"""lambda^2 M + lambda C + K at a value, on vectors, and its slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..modes import Complex


@dataclass(frozen=True, slots=True)
class Pencil:
    """The matrices, SciPy sparse: M [kg], C [N s/m], K [N/m]."""

    M: sp.csc_matrix
    C: sp.csc_matrix
    K: sp.csc_matrix

    def at(self, s: complex) -> sp.csc_matrix:
        """lambda^2 M + lambda C + K at lambda = s."""
        return (s**2 * self.M + s * self.C + self.K).tocsc()

    def times(self, s: Complex, X: Complex) -> Complex:
        """(lambda^2 M + lambda C + K) x for each pair."""
        return np.asarray(self.M @ (X * s**2) + self.C @ (X * s) + self.K @ X)

    def slope(self, s: Complex, X: Complex) -> Complex:
        """(2 lambda M + C) x for each pair."""
        return np.asarray(self.M @ (X * (2 * s)) + self.C @ X)

    @property
    def transposed(self) -> Pencil:
        """The transposed matrices, whose right vectors are the conjugate left ones."""
        return Pencil(self.M.T.tocsc(), self.C.T.tocsc(), self.K.T.tocsc())
