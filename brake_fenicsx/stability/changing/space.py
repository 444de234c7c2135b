"""One space for the modes of a body at several stiffnesses, and matrices in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.solver import Factor

from ..full.lanczos import RealModes, lowest_modes
from ..full.symmetric import count_below

Array = NDArray[np.float64]

# Smallest mass of a direction beyond the modes of the first set; those of others have one, times
# (limit / Lambda)^4.
NEW = 1e-7


def complete_modes(
    factor: Factor,
    K: sp.csr_matrix,
    M: sp.csr_matrix,
    sigma: float,
    limit: float,
    tolerance: float = 1e-9,
) -> RealModes:
    """All modes of K + sigma M below a limit, proven by inertia.

    Raises:
        InaccurateResult: inertia counts another number.
    """
    found = lowest_modes(factor, M, limit, tolerance)
    expected, _ = count_below(K, M, limit - sigma)
    if expected != found.Lambda.size:
        raise InaccurateResult(
            f"a body has {expected} modes by inertia, {found.Lambda.size} were found"
        )
    return found


def joined(found: Sequence[RealModes], M: sp.csr_matrix, comm: MPI.Comm) -> Array:
    """M-orthonormal space of all modes; those of the first set come first, as they are.

    Args:
        found: sets of modes, the same on every process.
        M: mass [kg].
        comm: processes that share the work.

    Returns:
        Shape (dofs, directions), the same on every process.
    """
    first = found[0].Phi
    # A low mode that the space misses by a little is a pole of the rest close to zero: R_2 sees it
    # with (limit / Lambda)^3.
    limit = found[0].Lambda[-1]
    rest = np.hstack([first[:, :0], *(m.Phi * (limit / m.Lambda) ** 2 for m in found[1:])])
    for _ in range(2):
        rest -= first @ (first.T @ (M @ rest))
    values, vectors = la.eigh(_gram(rest, M, comm), driver="evd")
    good = values > NEW
    more = rest @ (vectors[:, good] / np.sqrt(values[good]))
    # Directions of little mass have lost digits: once more.
    more -= first @ (first.T @ (M @ more))
    values, vectors = la.eigh(_gram(more, M, comm), driver="evd")
    return np.hstack([first, more @ (vectors / np.sqrt(values))])


def projected(matrices: Sequence[sp.csr_matrix], W: Array, comm: MPI.Comm) -> Array:
    """W'A W of symmetric matrices, shape (matrices, directions, directions).

    Args:
        matrices: the same on every process; zero rows cost nothing.
        W: the space, shape (dofs, directions).
        comm: processes that share the work.
    """

    def one(A: sp.csr_matrix) -> Array:
        rows = np.flatnonzero(np.diff(A.indptr))
        own = W[rows]
        P = own.T @ (A[rows][:, rows] @ own)
        return np.asarray(0.5 * (P + P.T))

    return np.array(shared(matrices, one, comm))


def ritz_errors(
    factor: Factor, A: sp.csr_matrix, M: sp.csr_matrix, modes: tuple[Array, Array], limit: float
) -> Array:
    """How much too large the eigenvalues of a stiffness are in a space [1/s^2].

    E' (A - Lambda M)^-1 E for the residuals E, to second order.

    Args:
        factor: factor of A.
        A: the stiffness.
        M: mass [kg].
        modes: eigenvectors in the space, shape (dofs, modes), and their eigenvalues [1/s^2].
        limit: what the space does not hold has larger eigenvalues.
    """
    Phi, Lambda = modes
    E = A @ Phi - M @ (Phi * Lambda)
    static = np.einsum("im,im->m", E, factor.solve(E))
    return np.asarray(static / np.maximum(1 - Lambda / limit, 0.1))


def shared(
    tasks: Sequence[Any],
    work: Callable[[Any], Any],
    comm: MPI.Comm,
    progress: Callable[[int], None] = lambda n: None,
) -> list[Any]:
    """Results of all tasks on every process; each task is done by one of them.

    Args:
        tasks: the tasks, the same on every process.
        work: what is done with each.
        comm: the processes.
        progress: called with the number done.
    """
    own = {}
    for i in range(comm.rank, len(tasks), comm.size):
        own[i] = work(tasks[i])
        progress(1)
    return [comm.bcast(own.get(i), root=i % comm.size) for i in range(len(tasks))]


def _gram(X: Array, M: sp.csr_matrix, comm: MPI.Comm) -> Array:
    """X'M X, its rows shared by the processes."""
    ends = np.linspace(0, len(X), comm.size + 1).astype(int)
    rows = slice(ends[comm.rank], ends[comm.rank + 1])
    G: Array = sum(comm.allgather(X[rows].T @ (M[rows] @ X)))
    return 0.5 * (G + G.T)
