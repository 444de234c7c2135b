"""Close modes of a sample, that see together what the pencil leaves out.

Near a point where two modes merge a small change moves both by far more than its size, and not in
proportion. In the space of the close vectors, X and Y, the problem is small,

    [Y' T(c) X + Y' rest + (kappa - c) Y' T'(c) X] w = 0,   c in their midst,

and solved as it stands, in real arithmetic, so that pairs stay real or conjugate.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..complex_columns import unit
from ..modes import Complex

Array = NDArray[np.float64]

# A shift of more than this share of the distance from the next eigenvalue is not in proportion.
SAFE = 0.1

# Eigenvalues within this share of their size are close.
NEAR = 5e-3

# Largest number of eigenvalues taken together.
MOST = 12


def separation(kappa: Complex) -> Array:
    """Distance of each eigenvalue from its nearest neighbour, its own conjugate included.

    Args:
        kappa: eigenvalues without negative imaginary part, shape (modes,).
    """
    if not kappa.size:
        return np.zeros(0)
    distance = np.abs(kappa[:, None] - kappa[None, :])
    np.fill_diagonal(distance, np.inf)
    mate = np.where(kappa.imag > 0, 2 * kappa.imag, np.inf)
    nearest = np.minimum(distance.min(axis=0), mate)
    return np.asarray(np.maximum(nearest, 1e-12 * np.abs(kappa).max()))


def widened(error: Array, apart: Array) -> Array:
    """Errors of first order, as large as they become where two modes are about to merge.

    Two eigenvalues d apart, the roots of x (x + d) = 0, are those of x (x + d) = -e d where one of
    them is off by e to first order: x = -d/2 + (d^2/4 - e d)^(1/2), real or complex.

    Args:
        error: to first order, shape (modes,).
        apart: distance of each eigenvalue from its nearest neighbour.
    """
    x = error / apart
    near = error / (0.5 + np.sqrt(np.maximum(0.25 - x, 0.0)))
    met = np.sqrt(error) * np.sqrt(np.minimum(apart, 4 * error))
    return np.asarray(np.maximum(error, np.where(x < 0.25, near, met)))


def close_groups(kappa: Complex, reach: Array) -> list[NDArray[np.intp]]:
    """Modes whose shifts are not small against the distance from others.

    Args:
        kappa: eigenvalues without negative imaginary part, shape (modes,).
        reach: how far each may be shifted, shape (modes,).

    Returns:
        Numbers of the modes of each group; a complex mode may be one, with its conjugate.
    """
    near = SAFE * np.abs(kappa[:, None] - kappa) < np.maximum(reach[:, None], reach)
    _, label = connected_components(sp.csr_matrix(near))
    size = np.where(kappa.imag > 0, 2, 1)
    unsafe = reach > SAFE * separation(kappa)
    groups = [np.flatnonzero(label == g) for g in np.unique(label[unsafe])]
    return [g for g in groups if 1 < size[g].sum() <= MOST]


def near_groups(values: Complex) -> list[NDArray[np.intp]]:
    """Numbers of the eigenvalues that are close to one another, group by group.

    Args:
        values: eigenvalues, shape (modes,).
    """
    near = np.abs(values[:, None] - values) <= NEAR * np.abs(values)
    count, label = connected_components(sp.csr_matrix(near | near.T), directed=False)
    return [np.flatnonzero(label == g) for g in range(count)]


def with_neighbours(values: Complex, chosen: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Array]:
    """Some eigenvalues and those close to them, and how far the others are from each.

    Args:
        values: eigenvalues, shape (modes,).
        chosen: the ones that are looked at.
    """
    distance = np.abs(values[:, None] - values)
    close = chosen | (distance[chosen] <= NEAR * np.abs(values)).any(axis=0)
    return close, np.where(close, np.inf, distance).min(axis=1, initial=np.inf)


def seen_together(
    operators: tuple[Array, Array, Array], kappa: Complex, a: Complex, b: Complex, rest: Complex
) -> tuple[Complex, Complex, Complex]:
    """Eigenpairs of one group of close modes.

    Args:
        operators: K, M, Q of the pencil K - kappa M + kappa^2 Q.
        kappa: its eigenvalues in the group, without negative imaginary part [1/s^2], shape (m,).
        a: right vectors, shape (kept modes, m).
        b: left ones.
        rest: what the pencil leaves out of the right ones.

    Returns:
        The same with what was left out, of unit norm; two reals may have become one complex value,
        or the other way round.
    """
    K, M, Q = operators
    c = float(kappa.real.mean())
    turned = kappa.imag > 0
    X, Y, R = (np.hstack([x.real, x.imag[:, turned]]) for x in (a, b, rest))
    MX, QX = M @ X, Q @ X
    value, left, right = la.eig(
        Y.T @ (K @ X - c * MX + c**2 * QX + R), Y.T @ (MX - 2 * c * QX), left=True, right=True
    )
    keep = value.imag >= 0
    value = c + value[keep]
    new = np.where(value.imag == 0, value.real, value)
    return new, unit(X @ right[:, keep]), unit(Y @ left[:, keep])
