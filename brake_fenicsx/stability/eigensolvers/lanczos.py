"""Lowest real modes of a symmetric pencil by block Lanczos with full orthogonalisation.

Blocks, because a factor solves many right-hand sides for the price of a few; small ones, because a
Krylov space of larger ones is of lower degree and so needs more vectors.

Reference: R. G. Grimes, J. G. Lewis and H. D. Simon, SIAM J. Matrix Anal. Appl. 15 (1994) 228,
doi:10.1137/S0895479888151111.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.macro.condensation import Solves
from brake_fenicsx.macro.solver import BlockProduct

from .arnoldi import combined, shares

Array = NDArray[np.float64]

# Convergence is looked for each time the space has grown by this factor: the eigenvalues of its
# dense matrix cost more than several blocks.
GROWTH = 1.1


@dataclass(frozen=True, slots=True)
class RealModes:
    """Modes of K phi = Lambda M phi, M-orthonormal.

    Attributes:
        Phi: mode shapes, shape (dofs, modes).
        Lambda: eigenvalues omega^2 [1/s^2], ascending, shape (modes,).
    """

    Phi: Array
    Lambda: Array


def lowest_modes(
    factor: Solves,
    M: sp.csr_matrix,
    cutoff: float,
    tolerance: float = 1e-9,
    expected: int = 0,
    block: int = 16,
) -> RealModes:
    """All modes below a cutoff of the pencil whose stiffness is factored.

    Args:
        factor: factor of the positive definite stiffness [N/m].
        M: mass [kg].
        cutoff: largest eigenvalue wanted [1/s^2].
        tolerance: relative residual of every mode.
        expected: number of modes, if it is known: there is room for at least so many.
        block: number of vectors in a block.

    Returns:
        The modes. That none is missed is for the caller to prove, by an inertia count.

    Raises:
        NotConverged: the Krylov space fills without convergence.
    """
    n = M.shape[0]
    block = min(block, n)
    room = min(n, max(128 * block, 4 * expected))
    V = np.empty((n, room + block), order="F")
    H = np.zeros((room + block, room + block))
    mass = BlockProduct(M)
    W = factor.solve(mass(np.random.default_rng(0).standard_normal((n, block))))
    new, Mnew, _ = _orthonormalise(W, mass(W))
    size = before = due = 0
    for _ in range(room // block + 1):
        k = new.shape[1]
        last = slice(size, size + k)
        V[:, last] = new
        size += k
        W = factor.solve(Mnew)
        h = np.zeros((size, k))
        # Only the last two blocks have a share in W; all others round-off, which grows unchecked.
        for first in (before, 0):
            c = shares(V[:, first:size], mass(W))
            W -= combined(V[:, first:size], c)
            h[first:] += c
        before = last.start
        H[:size, last] = h
        H[last, :size] = h.T
        new, Mnew, coupling = _orthonormalise(W, mass(W))
        if size < min(due, n, room):
            continue
        due = int(GROWTH * size) + block
        theta, S = la.eigh(0.5 * (H[:size, :size] + H[:size, :size].T))
        # A copy: BLAS takes no negative strides, and NumPy's own loop is ten times slower.
        theta, S = theta[::-1], S[:, ::-1].copy()
        # K^-1 M y - theta y = new coupling s, in the norm of M; over theta it is relative.
        residual = np.linalg.norm(coupling @ S[last], axis=0) / np.abs(theta)
        keep = int((theta > 1 / cutoff).sum())
        if size >= n or (keep < size and np.all(residual[: keep + 1] < tolerance)):
            return RealModes(combined(V[:, :size], S[:, :keep]), 1 / theta[:keep])
    raise NotConverged(f"block Lanczos: {size} vectors do not give all modes below the cutoff")


def _orthonormalise(W: Array, MW: Array) -> tuple[Array, Array, Array]:
    """M-orthonormal basis of a block, and the coefficients that give the block back.

    Directions of no length are dropped.
    """
    back = np.eye(W.shape[1])
    for _ in range(2):
        gram = W.T @ MW
        values, vectors = la.eigh(0.5 * (gram + gram.T))
        good = values > 1e-14 * values[-1]
        turn = vectors[:, good] / np.sqrt(values[good])
        back = (vectors[:, good] * np.sqrt(values[good])).T @ back
        W, MW = W @ turn, MW @ turn
        if not W.shape[1]:
            break
    return W, MW, back
