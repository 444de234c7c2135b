"""What left and right vectors tell of an eigenvalue: residual, condition, error."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from brake_fenicsx.errors import InaccurateResult

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Eigenvalues closer than this, relatively, share their vectors.
CLUSTER = 1e-7

# Backward error that is all round-off: residuals cannot be smaller than that of a stiff matrix.
ROUND_OFF = 1e-14

# Left and right eigenvalues agree to this share of the region searched; near an exceptional point
# both lose half of their digits.
MATCH = 1e-5

# What is searched reaches a little beyond what is wanted: its rim may cut a cluster.
RIM = 1.05


def paired(s: Complex, left: Complex, weighted: Complex) -> Complex:
    """Left vectors biorthogonal to the right ones within clusters of equal eigenvalues.

    Args:
        s: eigenvalues.
        left: left vectors, shape (dofs, modes).
        weighted: derivative of the pencil times the right vectors: M phi, or (2 lambda M + C) phi.

    Returns:
        New left vectors of unit norm.
    """
    left = left / np.linalg.norm(left, axis=0)
    order = np.lexsort((s.real, s.imag))
    gaps = np.abs(np.diff(s[order])) > CLUSTER * np.abs(s[order][1:])
    for group in np.split(order, np.flatnonzero(gaps) + 1):
        if group.size > 1:
            overlap = left[:, group].conj().T @ weighted[:, group]
            turned = left[:, group] @ la.pinv(overlap).conj().T
            left[:, group] = turned / np.linalg.norm(turned, axis=0)
    return left


def two_sided(
    K: sp.spmatrix, M: sp.spmatrix, kappa: Complex, right: Complex, left: Complex
) -> tuple[Array, Array]:
    """Condition numbers in the norm of M, and errors from the two-sided quotient [1/s^2]."""
    MX, KX = M @ right, K @ right
    overlap = np.einsum("im,im->m", left.conj(), MX)
    norms = np.einsum("im,im->m", right.conj(), MX).real
    norms = norms * np.einsum("im,im->m", left.conj(), M @ left).real
    with np.errstate(divide="ignore"):
        condition = np.sqrt(norms) / np.abs(overlap)
    first = np.abs(np.einsum("im,im->m", left.conj(), KX - kappa * MX) / overlap)
    # What the quotient of two inexact vectors leaves open, and the round-off of the solves.
    return condition, first + 1e-11 * condition * np.abs(kappa).max(initial=0.0)


def residuals(K: sp.spmatrix, M: sp.spmatrix, kappa: Complex, X: Complex) -> tuple[Array, Array]:
    """Relative residual and backward error of each mode, Euclidean norms.

    The first is |K phi - kappa M phi| / |kappa M phi|; of rigid modes, whose kappa is round-off,
    relative to a millionth of the largest kappa. The second divides by (|K| + |kappa| |M|) |phi|:
    with a spring 1e12 times stiffer than the rest it is small whatever phi is.
    """
    KX, MX = K @ X, M @ X
    r = np.linalg.norm(KX - kappa * MX, axis=0)
    size = np.maximum(np.abs(kappa), 1e-6 * np.abs(kappa).max(initial=0.0))
    size = np.maximum(size * np.linalg.norm(MX, axis=0), np.finfo(float).tiny)
    norm = norm_bound(K) + np.abs(kappa) * norm_bound(M)
    return r / size, r / (norm * np.linalg.norm(X, axis=0))


def norm_bound(A: sp.spmatrix) -> float:
    """Bound of the 2-norm: root of the largest row sum times the largest column sum."""
    size = abs(A)
    return float(np.sqrt(size.sum(axis=0).max() * size.sum(axis=1).max()))


def matched(
    kappa: Complex, other: Complex, sigma: float, reach: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Right eigenvalues within reach of a shift, and for each of them its own left one.

    Args:
        kappa: eigenvalues of the right vectors, some beyond the reach among them.
        other: those of the left vectors.
        sigma: the shift.
        reach: radius.

    Raises:
        InaccurateResult: a right eigenvalue has no left one.
    """
    inner = np.flatnonzero(np.abs(kappa - sigma) <= reach)
    distance = np.abs(kappa[inner, None] - other[None, :])
    rows, columns = linear_sum_assignment(distance)
    far = distance[rows, columns] > MATCH * reach
    if rows.size < inner.size or np.any(far):
        raise InaccurateResult(
            f"{inner.size} right eigenvectors, {rows.size - far.sum()} of them with a left one"
        )
    return inner, columns


def with_conjugates(kappa: Complex, X: Complex) -> tuple[Complex, Complex]:
    """Both of each conjugate pair, their vectors too."""
    turned = kappa.imag != 0
    return np.r_[kappa, kappa[turned].conj()], np.hstack([X, X[:, turned].conj()])
