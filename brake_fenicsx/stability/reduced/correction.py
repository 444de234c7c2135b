"""Correction of single modes on the full problem, with the factor of the reference at hand.

What the moments of the basis leave out of the error of a mode, see ``sample``, is

    - y' (kappa^j C_j + ...) g,     C_j = N R_j F,     R_j = R_0 (M R_0)^j,

from some order on. With u_i = R_i F g and v_i = R_i N' y, a few block solves for all such modes
together, y' C_(i+j+1) g = v_i' M u_j: n solves on either side give 2 n orders. What is left then is
bounded by v_n' M v_n and u_n' M u_n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import Solves

from ..complex_columns import on_parts
from ..modes import Complex

Array = NDArray[np.float64]

# Largest i of u_i and v_i: moments to order 2 DEPTH + 1.
DEPTH = 3


@dataclass(frozen=True, slots=True)
class Deeper:
    """The full problem as the correction needs it.

    Attributes:
        rest: solves with the reference, kept modes taken out.
        M: mass [kg].
        N: gap operator, shape (elements, dofs).
        T: slip operator.
        limit: no mode of the reference below it is missing [1/s^2].
    """

    rest: Solves
    M: sp.csr_matrix
    N: sp.csr_matrix
    T: sp.csr_matrix
    limit: float

    def __call__(
        self, kappa: Complex, y: Complex, v_N: Complex, v_T: Complex, top: int
    ) -> tuple[Complex, Array]:
        """Part of the error of each mode beyond some order, and the bound of what is left.

        Args:
            kappa: eigenvalues [1/s^2], shape (modes,).
            y: left interface vectors, shape (elements, modes).
            v_N: normal forces of the right vectors on the elements, shape (elements, modes).
            v_T: tangential forces.
            top: order up to which all is known.

        Returns:
            Both as in psi' P phi, of shape (modes,).
        """
        n = kappa.size
        x = np.hstack([self.N.T @ v_N + self.T.T @ v_T, self.N.T @ y])
        levels, inertia = [], []
        for _ in range(DEPTH + 1):
            x = on_parts(self.rest.solve, x)
            levels.append(x)
            x = self.M @ x
            inertia.append(x)
        part = np.zeros(n, complex)
        for j in range(top + 1, 2 * DEPTH + 2):
            left, right = levels[(j - 1) // 2][:, n:], inertia[j - 1 - (j - 1) // 2][:, :n]
            part -= kappa**j * np.einsum("im,im->m", left.conj(), right)
        norms = np.einsum("im,im->m", levels[-1].conj(), inertia[-1]).real
        size = np.abs(kappa)
        away = np.maximum(self.limit - size, 1e-3 * self.limit)
        bound = size ** (2 * DEPTH + 2) / away * np.sqrt(np.abs(norms[:n] * norms[n:]))
        return part, bound
