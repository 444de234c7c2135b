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
