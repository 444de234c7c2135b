"""Operators of the linearised problem at an equilibrium.

(lambda^2 M + K + N'W k N + mu T'W k N) phi = 0, k = -p' of every element at equilibrium.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import gathered, petsc_matrix
from brake_fenicsx.macro.solver import add_interface

Array = NDArray[np.float64]


def tangent(
    K: PETSc.Mat, N: sp.csr_matrix, T: sp.csr_matrix, w: Array, k: Array, mu: float | Array
) -> PETSc.Mat:
    """K + N'W k N + T'W mu k N; non-symmetric where mu is not zero.

    Args:
        K: elastic stiffness [N/m].
        N: gap operator, shape (elements, dofs).
        T: slip operator, shape (elements, dofs).
        w: areas [m^2].
        k: contact stiffness [Pa/m].
        mu: friction coefficient, one or one per element.

    Returns:
        A new matrix, distributed like ``K``.
    """
    # The pressures' work on N + mu T, the gaps' change through N.
    left = (N + sp.diags(np.broadcast_to(mu, w.shape)) @ T).tocsr() if np.any(mu) else N
    return add_interface(K, left, w * k, N)


def as_petsc(A: Any) -> PETSc.Mat:
    """A SciPy or PETSc matrix, whole on this process."""
    return petsc_matrix(A) if sp.issparse(A) else gathered(A)
