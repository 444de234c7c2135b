"""One sample in the reduced model: its operators.

With the basis of ``reduction`` and F = N' dD + mu T' D the problem in modal coordinates a is

    T(kappa) a = [Lambda - kappa + B (I + C(kappa))^-1 Phi_N] a = 0,
    B = Phi' F,   C(kappa) = N R(kappa) F = C0 + kappa C1 + kappa^2 C2 + ...

To second order in kappa this is the pencil K - kappa M + kappa^2 Q that ``pencil`` solves; what it
leaves out is in ``sample_errors``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..complex_columns import on_parts, series_answer, times
from ..modes import Complex
from .basis import Basis

Array = NDArray[np.float64]

# Terms of the answer of the gaps.
ANSWERS = 2

# Round-off of a product or a solve, relative to the absolute values that enter it.
ROUNDING = 1e-13

# Rows of a product that stay in the cache.
ROWS = 64


class Sample:
    """Reduced operators of one contact stiffness and one friction coefficient.

    Attributes:
        basis: offline result.
        sigma: shift of the basis, whose eigenvalues are kappa + sigma [1/s^2].
        doubt: sets of typical errors of the basis, (N R_j N', N R_j T') for j = 0, 1, ...
        pole_doubt: typical errors of its eigenvalues [1/s^2]; none of a basis of its own modes.
        mu: friction coefficient, one or one per element.
        dD, mD: change of normal stiffness, tangential stiffness of each element [N/m].
        C: C1 and C2.
        S: gaps of the modes, S - kappa S1 + kappa^2 S2, shape (elements, modes).
        sources: (I + C0) S1 and (I + C0) S2, whose rounding is an error of the pencil.
        rounding: relative error of products and solves.
        B: Phi' F.
    """

    def __init__(
        self,
        basis: Basis,
        k: Array,
        mu: float | Array,
        sigma: float = 0.0,
        doubt: Sequence[Sequence[tuple[Array, Array]]] = (),
        pole_doubt: Array | float = 0.0,
    ):
        """Factor the interface problem and expand it in kappa.

        Args:
            basis: offline result.
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            sigma: shift of the basis.
            doubt: typical errors of the basis.
            pole_doubt: typical errors of its eigenvalues [1/s^2], one or one per mode.
        """
        b = self.basis = basis
        self.sigma, self.mu, self.doubt, self.pole_doubt = sigma, mu, doubt, pole_doubt
        self.dD, self.mD = b.w * (k - b.k0), mu * b.w * k
        E = self._static_gap()
        # By rows, as LAPACK wants the transpose: it need not be copied.
        self._lu = la.lu_factor(E.T, overwrite_a=True, check_finite=False)
        self.B = b.Phi_N.T * self.dD + b.Phi_T.T * self.mD
        self.S = self.solve(b.Phi_N)
        self.rounding = ROUNDING
        C1, C2 = self.C = tuple(b.NN[j] * self.dD + b.NT[j] * self.mD for j in (1, 2))
        C1S = C1 @ self.S
        self.S1 = self.solve(C1S)
        self.sources = C1S, C1 @ self.S1 - C2 @ self.S
        self.S2 = self.solve(self.sources[1])

    def _static_gap(self) -> Array:
        """I + C_0 = I + R_0,NN dD + mu R_0,NT D."""
        NN, NT, slips = self.basis.NN[0], self.basis.NT[0], self.mD.any()
        E = np.empty_like(NN)
        for i in range(0, len(E), ROWS):
            rows = slice(i, i + ROWS)
            np.multiply(NN[rows], self.dD, out=E[rows])
            if slips:
                E[rows] += NT[rows] * self.mD
        E[np.diag_indices_from(E)] += 1.0
        return E

    def solve(self, x: Array, trans: int = 0) -> Array:
        """(I + C_0)^-1 x, or its transpose."""
        return np.asarray(la.lu_solve(self._lu, x, trans=1 - trans, check_finite=False))

    def solves(self, x: Complex, trans: int = 0) -> Complex:
        """The same for complex columns."""
        return on_parts(lambda v: self.solve(v, trans), x)

    @cached_property
    def operators(self) -> tuple[Array, Array, Array]:
        """K_r, M_r, Q_r of T = K_r - kappa M_r + kappa^2 Q_r."""
        K, M, Q = self.B @ self.S, self.B @ self.S1, self.B @ self.S2
        K[np.diag_indices_from(K)] += self.basis.Lambda
        M[np.diag_indices_from(M)] += 1.0
        return K, M, Q

    def gaps(self, a: Complex, kappa: Complex) -> Complex:
        """Gaps g = (I + C)^-1 Phi_N a, to second order in kappa, shape (elements, modes)."""
        S, S1, S2 = (times(A, a) for A in (self.S, self.S1, self.S2))
        return S - kappa * S1 + kappa**2 * S2

    def answer(self, kappa: Complex, x: Complex, trans: int = 0, terms: int = ANSWERS) -> Complex:
        """(I + C0 + kappa C1 + kappa^2 C2)^-1 x by a series in kappa, or its transpose.

        Args:
            kappa: of each column [1/s^2], shape (modes,).
            x: shape (elements, modes).
            trans: whether the operator is transposed.
            terms: of the series, beyond the first.
        """
        C1, C2 = (C.T if trans else C for C in self.C)
        return series_answer(lambda v: self.solves(v, trans), C1, C2, kappa, x, terms)
