"""All eigenpairs of small matrices.

Of the shifted inverse, so that the low modes are as exact as they are for large matrices, also
where a spring is 1e12 times stiffer than the rest, and a massless dof gives no infinite eigenvalue.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from .symmetric import SHIFT

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Eigenvalues of the inverse below this share of the largest are those of massless dofs.
MASSLESS = 1e-14


def dense_modes(
    K: sp.spmatrix, M: sp.spmatrix, high: float, symmetric: bool
) -> tuple[Complex, Complex, Complex]:
    """All finite eigenpairs of K x = kappa M x.

    Args:
        K: stiffness [N/m].
        M: mass [kg].
        high: kappa of the band's end [1/s^2], for the scale of the shift.
        symmetric: whether K is symmetric.

    Returns:
        kappa, right and left vectors.

    Raises:
        InaccurateResult: K - sigma M is singular.
    """
    A, B = K.toarray(), M.toarray()
    sigma = -SHIFT * high
    S = A - sigma * B
    if symmetric and (found := _symmetric(0.5 * (S + S.T), 0.5 * (B + B.T))) is not None:
        theta, right = found
        left = right
    else:
        with np.errstate(all="ignore"):
            lu = la.lu_factor(S)
        if not np.all(np.abs(np.diag(lu[0])) > 0):
            raise InaccurateResult("K - sigma M is singular: a dof has neither stiffness nor mass")
        theta, left, right = la.eig(la.lu_solve(lu, B), left=True, right=True)
        left = la.lu_solve(lu, left.real, trans=1) + 1j * la.lu_solve(lu, left.imag, trans=1)
        # Symmetric but indefinite: real eigenvalues all the same.
        theta = theta.real if symmetric and np.all(np.linalg.eigvalsh(B) > 0) else theta
    keep = np.abs(theta) > MASSLESS * np.abs(theta).max(initial=0.0)
    kappa = sigma + 1 / theta[keep].astype(complex)
    return kappa, right[:, keep].astype(complex), left[:, keep].astype(complex)


def _symmetric(S: Array, M: Array) -> tuple[Array, Array] | None:
    """Eigenpairs of M x = theta S x for positive definite S; None if it is not."""
    try:
        theta, X = la.eigh(M, S)
    except la.LinAlgError:
        return None
    return theta, X / np.linalg.norm(X, axis=0)
