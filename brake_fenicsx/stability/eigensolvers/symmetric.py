"""All lowest modes of the frictionless problem by block Lanczos, proven complete by inertia.

K_s phi = kappa M phi with K_s symmetric. S = K_s - sigma M with a small negative shift is positive
definite also where a part is held by nothing (rigid modes, open contacts). Blocks, because a factor
solves many right-hand sides for the price of a few; small ones, because a Krylov space of larger
ones is of lower degree and so needs more vectors.

Reference: R. G. Grimes, J. G. Lewis and H. D. Simon, SIAM J. Matrix Anal. Appl. 15 (1994) 228,
doi:10.1137/S0895479888151111.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.folder.processes import release_memory
from brake_fenicsx.macro.equilibrium import Solves
from brake_fenicsx.macro.solver import BlockProduct, Factor

from .eigenpairs import combined, shares

# -sigma as a share of the highest kappa of the band: rigid modes stay clear of round-off, and the
# spectrum is hardly compressed. A divergence needs a larger shift; with one that is a hundred times
# the band's end the band is one percent of the spectrum seen, and Lanczos hardly converges.
SHIFT, LARGEST_SHIFT = 1e-3, 1e2

# A matrix is symmetric up to this share of its largest entry.
SYMMETRIC = 1e-12

# A limit closer than this to an eigenvalue is moved beyond it; by no more than MOVED.
ON_EDGE, MOVED = 1e-11, 1e-3

# Vectors of a block: a Krylov space of blocks holds no more copies of an eigenvalue than these, and
# several bodies that nothing holds have many modes at zero.
BLOCK = 16

# Convergence is looked for each time the space has grown by this factor: the eigenvalues of its
# dense matrix cost more than several blocks.
GROWTH = 1.1


@dataclass(frozen=True, slots=True)
class RealModes:
    """Modes of K phi = kappa M phi.

    Attributes:
        Phi: M-orthonormal shapes, shape (dofs, modes).
        kappa: eigenvalues [1/s^2], the closest to the shift first.
    """

    Phi: Array
    kappa: Array


def is_symmetric(A: sp.spmatrix) -> bool:
    """Whether a matrix is its own transpose, to round-off."""
    limit = SYMMETRIC * np.abs(A.data).max(initial=0.0)
    x = np.random.default_rng(0).random(A.shape[1])
    # No sum of so many differences within the limit is as large, and it costs next to nothing.
    if np.abs(A @ x - A.T @ x).max(initial=0.0) > 2 * A.shape[1] * limit:
        return False
    return bool(abs(A - A.T).max() <= limit)


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


def factor_near(
    K: sp.csr_matrix, M: sp.csr_matrix, kappa: float, solves: bool = True
) -> tuple[Factor, float]:
    """Factor of K_s - kappa M, a little higher where that is singular.

    Args:
        K: K_s [N/m].
        M: mass [kg].
        kappa: the shift wanted [1/s^2].
        solves: whether the factor is kept for solves, or its inertia alone.

    Returns:
        The factor and its shift.

    Raises:
        InaccurateResult: the matrix cannot be factored there nor nearby.
    """
    for step in (0.0, 1e-6, 1e-4, MOVED):
        at = kappa * (1 + step) if kappa > 0 else kappa * (1 - step)
        try:
            return Factor((K - at * M).tocsr(), "brake_inertia_", solves=solves), at
        except InaccurateResult:
            continue
    raise InaccurateResult(f"""inertia: K - kappa M is singular at and near
        {np.sqrt(abs(kappa)) / 2 / np.pi:.6g} Hz""")


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
    factor, at = factor_near(K, M, kappa, solves=False)
    factor.destroy()
    return factor.negative_pivots, at


def symmetric_modes(
    K: sp.csr_matrix, M: sp.csr_matrix, factor: Factor, sigma: float, limit: float
) -> RealModes:
    """All modes below a limit, counted.

    Args:
        K: K_s [N/m].
        M: mass [kg].
        factor: factor of K_s - sigma M.
        sigma: the shift [1/s^2].
        limit: largest eigenvalue wanted [1/s^2]; the count may raise it a little.

    Returns:
        The modes.

    Raises:
        NotConverged: Lanczos does not converge.
        InaccurateResult: inertia counts another number.
    """
    counted = count_below(K, M, limit)
    modes = modes_not_counted(M, factor, sigma, limit, counted[0])
    inside, _ = complete(K, M, modes.kappa, counted)
    Phi, kappa = _polished(K, M, factor, modes.Phi[:, inside])
    return RealModes(Phi, kappa)


def modes_not_counted(
    M: sp.csr_matrix, factor: Factor, sigma: float, limit: float,
    expected: int = 0, tolerance: float = 1e-9, block: int = BLOCK,
) -> RealModes:  # fmt: skip
    """Modes up to a limit, and a little beyond as far as a count may move it.

    Args:
        M: mass [kg].
        factor: factor of K_s - sigma M.
        sigma: the shift [1/s^2].
        limit: largest eigenvalue wanted [1/s^2].
        expected: number of modes, if it is known.
        tolerance: relative residual of every mode.
        block: vectors of a block.

    Raises:
        NotConverged: Lanczos does not converge.
    """
    cutoff = limit * (1 + 2 * MOVED) - sigma
    found = lowest_modes(factor, M, cutoff, tolerance, expected, block)
    release_memory()
    return RealModes(found.Phi, found.kappa + sigma)


def complete(
    K: sp.csr_matrix, M: sp.csr_matrix, kappa: Array, counted: tuple[int, float]
) -> tuple[Mask, float]:
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
        raise InaccurateResult(f"""{inside.sum()} modes found below {np.sqrt(limit) / 2 / np.pi:.6g}
            Hz without friction, inertia counts {expected}""")
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


def lowest_modes(
    factor: Solves, M: sp.csr_matrix, cutoff: float, tolerance: float = 1e-9, expected: int = 0,
    block: int = BLOCK,
) -> RealModes:  # fmt: skip
    """All modes of the pencil whose stiffness is factored up to a distance from zero.

    Args:
        factor: factor of the stiffness [N/m]; where that has been shifted into the spectrum, it is
            not definite, and the modes closest to the shift are found on both sides of it.
        M: mass [kg].
        cutoff: largest |eigenvalue| wanted [1/s^2].
        tolerance: relative residual of every mode.
        expected: number of modes, if it is known: there is room for at least so many.
        block: vectors of a block.

    Returns:
        The modes, the closest to zero first. That none is missed is for the caller to prove, by an
        inertia count.

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
    size = due = 0
    Mbefore = np.empty((n, 0), order="F")
    for _ in range(room // block + 1):
        k, before = new.shape[1], size - Mbefore.shape[1]
        last = slice(size, size + k)
        V[:, last] = new
        size += k
        W = factor.solve(Mnew)
        h = np.zeros((size, k))
        # Only the last two blocks have a share in W; all others round-off, which grows unchecked.
        h[before:] = shares(np.hstack([Mbefore, Mnew]), W)
        W -= combined(V[:, before:size], h[before:])
        c = shares(V[:, :size], mass(W))
        W -= combined(V[:, :size], c)
        h += c
        Mbefore = Mnew
        H[:size, last] = h
        H[last, :size] = h.T
        new, Mnew, coupling = _orthonormalise(W, mass(W))
        if size < min(due, n, room):
            continue
        due = int(GROWTH * size) + block
        theta, S = la.eigh(0.5 * (H[:size, :size] + H[:size, :size].T))
        nearest = np.argsort(-np.abs(theta))
        theta, S = theta[nearest], S[:, nearest]
        # K^-1 M y - theta y = new coupling s, in the norm of M; over theta it is relative.
        residual = np.linalg.norm(coupling @ S[last], axis=0) / np.abs(theta)
        keep = int((np.abs(theta) > 1 / cutoff).sum())
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
