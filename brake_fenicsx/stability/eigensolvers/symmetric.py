"""All lowest modes of the frictionless problem, proven complete by inertia.

K_s phi = kappa M phi with K_s symmetric. S = K_s - sigma M with a small negative shift is positive
definite also where a part is held by nothing (rigid modes, open contacts): block Lanczos with S^-1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.macro.solver import Factor

from .lanczos import lowest_modes

Array = NDArray[np.float64]

# -sigma as a share of the highest kappa of the band: rigid modes stay clear of round-off, and the
# spectrum is hardly compressed. A divergence needs a larger shift; with one that is a hundred times
# the band's end the band is one percent of the spectrum seen, and Lanczos hardly converges.
SHIFT, LARGEST_SHIFT = 1e-3, 1e2

# A limit closer than this to an eigenvalue is moved beyond it; by no more than MOVED.
ON_EDGE, MOVED = 1e-11, 1e-3


@dataclass(frozen=True, slots=True)
class Symmetric:
    """Modes of K_s phi = kappa M phi below a limit.

    Attributes:
        sigma: shift, negative [1/s^2].
        Phi: M-orthonormal shapes, shape (dofs, modes).
        kappa: eigenvalues [1/s^2], ascending.
        limit: up to it all were looked for [1/s^2].
    """

    sigma: float
    Phi: Array
    kappa: Array
    limit: float


def shifted_factor(
    K: sp.csr_matrix, M: sp.csr_matrix, high: float, largest: float = SHIFT
) -> tuple[Factor, float] | None:
    """Factor of S = K_s - sigma M and the shift sigma < 0 closest to zero that makes it definite.

    Args:
        K: K_s [N/m].
        M: mass [kg].
        high: highest kappa of the band [1/s^2].
        largest: -sigma is at most this share of that.

    Returns:
        The factor and sigma; None where K_s has eigenvalues further below zero.
    """
    share = SHIFT
    while share < 2 * largest:
        factor = Factor((K + share * high * M).tocsr(), "brake_shifted_")
        if not factor.negative_pivots:
            return factor, -share * high
        factor.destroy()
        share *= 10
    return None


def count_below(K: sp.csr_matrix, M: sp.csr_matrix, kappa: float) -> tuple[int, float]:
    """Eigenvalues below kappa, by Sylvester's law of inertia.

    Args:
        K: K_s [N/m].
        M: mass [kg].
        kappa: where to count [1/s^2].

    Returns:
        The number, and where it was counted: a little higher if kappa itself is an eigenvalue.

    Raises:
        InaccurateResult: the matrix cannot be factored there nor nearby.
    """
    for step in (0.0, 1e-6, 1e-4, MOVED):
        at = kappa * (1 + step) if kappa > 0 else kappa * (1 - step)
        try:
            factor = Factor((K - at * M).tocsr(), "brake_inertia_")
        except InaccurateResult:
            continue
        count = factor.negative_pivots
        factor.destroy()
        return count, at
    raise InaccurateResult(
        f"inertia: K - kappa M is singular at and near {np.sqrt(abs(kappa)) / 2 / np.pi:.6g} Hz"
    )


def symmetric_modes(
    K: sp.csr_matrix, M: sp.csr_matrix, factor: Factor, sigma: float, limit: float
) -> Symmetric:
    """All modes below a limit, counted.

    Args:
        K: K_s [N/m].
        M: mass [kg].
        factor: factor of K_s - sigma M.
        sigma: the shift [1/s^2].
        limit: largest eigenvalue wanted [1/s^2]; may be raised a little by the count.

    Returns:
        The modes.

    Raises:
        NotConverged: Lanczos does not converge.
        InaccurateResult: inertia counts another number.
    """
    counted = count_below(K, M, limit)
    modes = modes_not_counted(M, factor, sigma, limit, counted[0])
    inside, limit = complete(K, M, modes.kappa, counted)
    Phi, kappa = _polished(K, M, factor, modes.Phi[:, inside])
    return replace(modes, Phi=Phi, kappa=kappa, limit=limit)


def modes_not_counted(
    M: sp.csr_matrix, factor: Factor, sigma: float, limit: float,
    expected: int = 0, tolerance: float = 1e-9,
) -> Symmetric:  # fmt: skip
    """Modes up to a limit, and a little beyond as far as a count may move it.

    Args:
        M: mass [kg].
        factor: factor of K_s - sigma M.
        sigma: the shift [1/s^2].
        limit: largest eigenvalue wanted [1/s^2].
        expected: number of modes, if it is known.
        tolerance: relative residual of every mode.

    Raises:
        NotConverged: Lanczos does not converge.
    """
    cutoff = limit * (1 + 2 * MOVED) - sigma
    found = lowest_modes(factor, M, cutoff, tolerance, expected)
    release_memory()
    return Symmetric(sigma, found.Phi, found.Lambda + sigma, limit)


def complete(
    K: sp.csr_matrix, M: sp.csr_matrix, kappa: Array, counted: tuple[int, float]
) -> tuple[NDArray[np.bool_], float]:
    """Which modes lie below the limit of a count, as many as it says.

    Args:
        K: K_s [N/m].
        M: mass [kg].
        kappa: eigenvalues of ``modes_not_counted`` [1/s^2].
        counted: number and limit of ``count_below``.

    Returns:
        Which of them, and the limit [1/s^2], which may have moved off an eigenvalue.

    Raises:
        InaccurateResult: inertia counts another number.
    """
    expected, limit = counted
    if np.any(np.abs(kappa - limit) <= ON_EDGE * limit):
        # On an eigenvalue round-off decides what either count takes for below.
        expected, limit = count_below(K, M, limit * (1 + 100 * ON_EDGE))
    inside = kappa < limit
    if inside.sum() != expected:
        raise InaccurateResult(
            f"{inside.sum()} modes found below {np.sqrt(limit) / 2 / np.pi:.6g} Hz without"
            f" friction, inertia counts {expected}"
        )
    return inside, limit


def _polished(
    K: sp.csr_matrix, M: sp.csr_matrix, factor: Factor, Phi: Array
) -> tuple[Array, Array]:
    """One inverse iteration and a Rayleigh-Ritz step: residuals as small as arithmetic allows."""
    if not Phi.shape[1]:
        return Phi, np.zeros(0)
    X = factor.solve(M @ Phi)
    X /= np.linalg.norm(X, axis=0)
    gram = X.T @ (M @ X)
    stiff = X.T @ (K @ X)
    kappa, turn = la.eigh(0.5 * (stiff + stiff.T), 0.5 * (gram + gram.T))
    return X @ turn, kappa
