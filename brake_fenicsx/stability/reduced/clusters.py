"""Clusters of eigenvalues of K - z M + z^2 Q that are followed together.

A cluster is one real invariant pair (X, Theta), K X - M X Theta + Q X Theta^2 = 0, whose space is
well conditioned whatever becomes of the single vectors; Theta is taken apart at the very end.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from brake_fenicsx.errors import InaccurateResult

from ..complex_columns import unit
from ..modes import Complex

Array = NDArray[np.float64]

# Fixed-point steps of small problems, and of a cluster.
STEPS, CLUSTER_STEPS = 40, 60

# How far the shift of a cluster is off its midst: a shift on an eigenvalue is no harm, an exact
# zero is; on a pair that is all but one, what is large along its vectors hides what is beside them.
OFF = (1e-11, 1e-4)

# Change of the vectors at which an iteration has converged.
CONVERGED = 1e-12


def coupled_groups(
    k: Complex, q: Complex, chosen: NDArray[np.intp], coupled: float
) -> list[NDArray[np.intp]]:
    """Groups of eigenvalues that are coupled, closed under conjugation.

    Args:
        k: eigenvalues of the linear pencil [1/s^2], shape (size,).
        q: Q in the coordinates of its vectors [s^2], shape (size, size).
        chosen: numbers of the eigenvalues that are looked at.
        coupled: coupling relative to the distance from which on two are in one group.

    Returns:
        Numbers of the eigenvalues of each group; a complex one without coupling is a group alone.
    """
    if not chosen.size:
        return []
    k, q = k[chosen], q[np.ix_(chosen, chosen)]
    size = np.maximum(np.abs(k), np.abs(k)[:, None]) ** 2
    diagonal = np.diag(q)
    # An uneven shift of two values counts like their coupling.
    uneven = 0.5 * np.abs(diagonal[:, None] - diagonal)
    shift = size * np.maximum(np.sqrt(np.abs(q) * np.abs(q.T)), uneven)
    linked = shift > coupled * np.abs(k[:, None] - k)
    np.fill_diagonal(linked, False)
    label = connected_components(sp.csr_matrix(linked), directed=False)[1]
    turned = np.flatnonzero((np.bincount(label)[label] > 1) & (k.imag != 0))
    mate = np.abs(k[turned, None].conj() - k).argmin(axis=1)
    linked[turned, mate] = True
    count, label = connected_components(sp.csr_matrix(linked), directed=False)
    return [chosen[label == group] for group in range(count)]


def cluster_pairs(
    matrices: tuple[Array, Array, Array], k: Complex, right: Complex, left: Complex
) -> tuple[Complex, Complex, Complex]:
    """Eigenpairs of a cluster, conjugates left out.

    Args:
        matrices: K, M, Q, real, of shape (size, size).
        k: the cluster's eigenvalues of the linear pencil [1/s^2], shape (m,).
        right: right vectors of these, shape (size, m).
        left: left ones.

    Returns:
        Eigenvalues without negative imaginary part, right and left vectors of unit norm.

    Raises:
        InaccurateResult: the iteration does not converge.
    """
    K, M, Q = matrices
    start = _real_basis(right), _real_basis(left)
    for i, off in enumerate(OFF):
        centre = float(k.real.mean()) * (1 + off)
        lu = la.lu_factor(K - centre * M + centre**2 * Q, check_finite=False)
        try:
            X, Theta = _invariant(K, M, Q, *start, lu, 0)
            Y, _ = _invariant(K.T, M.T, Q.T, start[1], X, lu, 1)
            break
        except InaccurateResult:
            if i + 1 == len(OFF):
                raise
    z, v, u = la.eig(Theta, left=True, right=True)
    MX, QX = Y.T @ M @ X, Y.T @ Q @ X
    keep = np.flatnonzero(z.imag >= 0)
    # v^H (MX - QX (z + Theta)) is a left vector of Theta.
    inner = [MX - QX @ (z[i] * np.eye(z.size) + Theta) for i in keep]
    y = [la.solve(A.conj().T, v[:, i]) for A, i in zip(inner, keep, strict=True)]
    return z[keep], unit(X @ u[:, keep]), unit(Y @ np.stack(y, axis=1))


def _invariant(
    K: Array, M: Array, Q: Array, X: Array, Y: Array, lu: tuple[Array, Array], trans: int
) -> tuple[Array, Array]:
    """Real invariant pair K X - M X Theta + Q X Theta^2 = 0 near a space X, tested with Y.

    Raises:
        InaccurateResult: the iteration does not converge.
    """
    size = np.inf
    for _ in range(CLUSTER_STEPS):
        KX, MX, QX = K @ X, M @ X, Q @ X
        inner = la.lu_factor(Y.T @ MX)
        Theta = la.lu_solve(inner, Y.T @ KX)
        start = np.abs(Theta).max()
        for _ in range(STEPS):
            last, Theta = Theta, la.lu_solve(inner, Y.T @ KX + (Y.T @ QX) @ Theta @ Theta)
            change, most = np.abs(Theta - last).max(), np.abs(Theta).max()
            if not (change > 1e-15 * most and most < 10 * start):
                break
        if not (change < 1e-6 * most and most < 10 * start):
            break
        step = la.lu_solve(lu, KX - MX @ Theta + QX @ Theta @ Theta, trans=trans)
        # What of the step lies in X itself changes nothing.
        step -= X @ (X.T @ step)
        last_size, size = size, float(np.linalg.norm(step))
        if not size < 1e3:
            break
        # Round-off of an ill-conditioned shift may leave a little more.
        if size <= CONVERGED or (size <= 1e4 * CONVERGED and size > 0.5 * last_size):
            return X, Theta
        X = la.qr(X - step, mode="economic")[0]
    raise InaccurateResult(
        f"reduced model: a cluster of {X.shape[1]} modes near"
        f" {np.sqrt(abs(np.trace(Theta)) / X.shape[1]) / 2 / np.pi:.0f} Hz does not settle"
    )


def _real_basis(vectors: Complex) -> Array:
    """Orthonormal real basis of vectors that are closed under conjugation."""
    # Imaginary parts keep their size: those of real vectors are round-off.
    vectors = unit(vectors)
    both = np.hstack([vectors.real, vectors.imag])
    return np.asarray(la.qr(both, mode="economic", pivoting=True)[0][:, : vectors.shape[1]])
