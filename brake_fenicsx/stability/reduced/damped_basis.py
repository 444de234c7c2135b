"""Offline stage of the reduced model with damping: what the kept modes leave out, seen at contact.

Beside ``reduction``: Phi, Lambda are the kept real modes of the reference (K0, M), R_0 is K0^-1
without them. With the damping C of the bodies the rest of the brake answers forces by

    S(lambda) = (1 + lambda R_0 C + lambda^2 R_0 M)^-1 R_0 = S_0 + lambda S_1 + lambda^2 S_2 + ...,
    S_0 = R_0,   S_n = -R_0 (C S_(n-1) + M S_(n-2)).

Forces act on the rest through the columns of [I', C Phi], and it is seen through the rows of
[O; Phi' C]: I and O are the rows of N, T, R that the scene's terms act along, so that nothing but
G_n = [O; Phi' C] S_n [I', C Phi] is kept. Their columns of O' are solved for with C'.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import Solves, shared_columns
from brake_fenicsx.macro.solver import blocks

from .deflation import Deflated

Array = NDArray[np.float64]

# Smallest size that is divided by: bodies damped in proportion have no rest to speak of.
TINY = 1e-300

# Largest power of lambda; moments of inertia to R_5.
DAMPED_ORDER = 11


@dataclass(frozen=True, slots=True)
class DampedBasis:
    """What the offline stage leaves behind; all of it dense.

    Attributes:
        Lambda: eigenvalues of the reference [1/s^2], shape (modes,).
        C: Phi' C Phi [1/s].
        seen: Phi's rows of O, shape (rows of O, modes).
        forced: Phi's rows of I, shape (rows of I, modes).
        G: G_n, shape (rows of O + modes, rows of I + modes), n = 0, 1, ...
        names: of the blocks of rows of O: "N", and "T" and "R" where forces follow their rates.
        answers: name -> those rows of K0^-1 on the same rows, modes included [m/N].
        w: areas [m^2].
        k0: reference stiffness [Pa/m].
        limit: no mode of the reference below it is missing [1/s^2].
        radius: the series in lambda converges up to about this |lambda| [1/s].
        sigma: shift of a reference that would not be positive definite without [1/s^2]: Lambda and
            ``answers`` are those of K0 + sigma M.
    """

    Lambda: Array
    C: Array
    seen: Array
    forced: Array
    G: tuple[Array, ...]
    names: str
    answers: dict[str, Array]
    w: Array
    k0: Array
    limit: float
    radius: float
    sigma: float = 0.0


def damped_moments(
    factor: Solves,
    modes: tuple[Array, Array],
    M: sp.csr_matrix,
    C: sp.csr_matrix | None,
    O: sp.csr_matrix,
    I: sp.csr_matrix,
    comm: MPI.Comm,
    progress: Callable[[int], None] = lambda n: None,
    order: int = DAMPED_ORDER,
) -> list[Array]:
    """G_n = [O; Phi' C] S_n [I', C Phi].

    Args:
        factor: solves with K0.
        modes: Phi, shape (dofs, modes), and Lambda.
        M: mass [kg].
        C: damping of the bodies [N s/m]; None where they have none.
        O: rows that are looked at, shape (rows, dofs).
        I: rows that forces act along.
        comm: processes that share the columns.
        progress: called with the number of columns done.
        order: largest n.

    Returns:
        G_0, G_1, ... on every process.
    """
    rest, Phi = Deflated(factor, *modes), modes[0]
    C = sp.csr_matrix(M.shape) if C is None else C.tocsr()
    turned, right = C.T.tocsr(), C @ Phi
    # The columns are those of the transposed problem.
    columns = sp.hstack([O.T.tocsc(), sp.csc_matrix(turned @ Phi)]).tocsc()
    damped = bool(C.nnz)
    own = shared_columns(columns.shape[1] if damped else O.shape[0], comm)
    out = np.zeros((order + 1, I.shape[0] + Phi.shape[1], own.size))
    for b in blocks(own.size):
        before: Array = np.zeros((0, 0))
        X: Array = rest.solve(columns[:, own[b]].toarray())
        for n in range(order + 1):
            if n:
                load = turned @ X
                if n > 1:
                    load += M @ before
                # Without damping every second term is zero.
                before, X = X, -rest.solve(load) if damped or n % 2 == 0 else 0.0 * X
            out[n, : I.shape[0], b] = I @ X
            out[n, I.shape[0] :, b] = right.T @ X
        progress(b.stop - b.start)
    missing = 0 if damped else Phi.shape[1]
    return [np.pad(np.hstack(comm.allgather(part)).T, ((0, missing), (0, 0))) for part in out]


def convergence_radius(G: Sequence[Array], rows: int, columns: int, limit: float) -> float:
    """About the |lambda| up to which the series in G_n converges [1/s], by its last four terms.

    Args:
        G: its terms.
        rows: number of rows of O.
        columns: number of rows of I.
        limit: no mode of the reference below it is missing [1/s^2]: the radius without damping.
    """
    # Without an interface the kept modes are all that the rest acts on.
    parts = [g[:rows, :columns] if rows else g for g in G[-4:]]
    sizes = [np.linalg.norm(part) * limit ** (n / 2) for n, part in enumerate(parts)]
    growth = (sizes[2] + sizes[3]) / max(sizes[0] + sizes[1], TINY)
    return float(np.sqrt(limit / max(growth, 1.0)))
