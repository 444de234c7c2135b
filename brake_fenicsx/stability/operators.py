"""Operators of the linearised problem at an equilibrium.

(lambda^2 M + K + N'W k N + mu T'W k N) phi = 0, k = -p' of every element at equilibrium.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.solver import whole, with_interface

Array = NDArray[np.float64]


def tangent(
    K: Any, N: sp.csr_matrix, T: sp.csr_matrix, w: Array, k: Array, mu: float | Array
) -> Any:
    """K + N'W k N + T'W mu k N; non-symmetric where mu is not zero.

    Args:
        K: elastic stiffness [N/m], SciPy sparse or PETSc.
        N: gap operator, shape (elements, dofs).
        T: slip operator, shape (elements, dofs).
        w: areas [m^2].
        k: contact stiffness [Pa/m].
        mu: friction coefficient, one or one per element.

    Returns:
        A new matrix, CSR.
    """
    # The pressures' work on N + mu T, the gaps' change through N.
    left = (N + sp.diags(np.broadcast_to(mu, w.shape)) @ T).tocsr() if np.any(mu) else N
    return with_interface(whole(K), left, w * k, N)
