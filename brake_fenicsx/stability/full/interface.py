"""Friction as what it is: a term of low rank on the contact interface.

K = K_s + left' right with K_s symmetric. Contact elements i with springs D = W k give
left = mu sqrt(D) T, right = sqrt(D) N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Largest rank for which friction is treated on its interface: it is counted with some sixteen dense
# matrices of this size, 128 MB each. Nor is the rank more than one in SHARE of all dofs.
LARGEST, SHARE = 4000, 4


@dataclass(frozen=True, slots=True)
class Interface:
    """The friction term left' right.

    Attributes:
        left: shape (rank, dofs).
        right: shape (rank, dofs).
    """

    left: sp.csr_matrix
    right: sp.csr_matrix

    @property
    def rank(self) -> int:
        """Number of rows."""
        return int(self.left.shape[0])


def contact_interface(N: sp.csr_matrix, T: sp.csr_matrix, D: Array, mu: float | Array) -> Interface:
    """Friction mu T' D N of contact elements.

    Args:
        N: gap operator, shape (elements, dofs).
        T: slip operator, shape (elements, dofs).
        D: springs w k [N/m], not negative, shape (elements,).
        mu: friction coefficient, one or one per element.

    Returns:
        The interface of the elements that are closed and rub.
    """
    mu = np.broadcast_to(np.asarray(mu, float), D.shape)
    rubs = (D > 0) & (mu != 0)
    root = np.sqrt(D[rubs])
    left = sp.diags(mu[rubs] * root) @ T[rubs]
    return Interface(left.tocsr(), (sp.diags(root) @ N[rubs]).tocsr())


def difference_interface(F: sp.spmatrix, tolerance: float = 1e-13) -> Interface | None:
    """A factorisation of K - K_s where nothing but the matrix is known.

    The nonzero rows and columns of F make a small matrix; its singular values fall to round-off
    after the number of contact elements.

    Args:
        F: K - K_s, shape (dofs, dofs).
        tolerance: singular values below this share of the largest are round-off.

    Returns:
        The interface; None where F is not of low rank.
    """
    F = F.tocsr()
    F.eliminate_zeros()
    rows, columns = np.flatnonzero(np.diff(F.indptr)), np.unique(F.indices)
    most = min(LARGEST, F.shape[0] // SHARE)
    if min(rows.size, columns.size) > 12 * most:
        return None
    small = F[rows][:, columns]
    limit, width, rng = min(most, *small.shape), 256, np.random.default_rng(0)
    while True:
        # A random block that is wide enough has the range of the whole.
        width = min(2 * width, limit)
        Q = la.qr(small @ rng.standard_normal((columns.size, width)), mode="economic")[0]
        remainder = small - Q @ (Q.T @ small)
        if width == limit or np.linalg.norm(remainder) <= tolerance * np.linalg.norm(small.data):
            break
    V, s, W = la.svd(Q.T @ small, full_matrices=False)
    rank = int(np.sum(s > tolerance * s[:1].max(initial=0.0)))
    if rank >= most:
        return None
    root = np.sqrt(s[:rank])
    left = _placed((Q @ V[:, :rank] * root).T, rows, F.shape[0])
    return Interface(left, _placed(root[:, None] * W[:rank], columns, F.shape[0]))


def _placed(values: Array, columns: NDArray[np.intp], size: int) -> sp.csr_matrix:
    """A dense matrix as some columns of a wider sparse one."""
    n = values.shape[0]
    indptr = np.arange(n + 1) * columns.size
    return sp.csr_matrix((values.ravel(), np.tile(columns, n), indptr), shape=(n, size))
