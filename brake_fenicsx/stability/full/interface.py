"""Friction as what it is: a term of low rank on the contact interface.

K = K_s + left' right with K_s symmetric. Contact elements i with springs D = W k give
left = mu sqrt(D) T, right = sqrt(D) N: then right K_s^-1 right' <= 1, because K_s holds the springs
right' right themselves. What is behind the interface is reached by solves with S = K_s - sigma M,

    K - sigma M = S + left' right,    E = I + right S^-1 left',
    (S + left' right)^-1 = S^-1 - S^-1 left' E^-1 right S^-1.

``SplitProblem`` is the undamped problem so taken apart.
"""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex, Index
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.folder.processes import in_turns
from brake_fenicsx.macro.solver import BlockProduct, Factor, blocks

from ..eigensolvers.eigenpairs import combined, plus, shares
from ..modes import Count

# Most moments of the interface, right S^-1 (M S^-1)^j left', j = 0, 1, ..., and the highest power m
# of S^-1 in left S^-1 (M S^-1)^(m - 1) left'.
MOST_ORDERS, POWER_LL = 12, 3

# Largest array that one process sends another [GB]: a message of MPI has less than 2 GB. It limits
# one process alone as well, so that results do not depend on the number of processes.
MESSAGE = 1.8

# Largest rank for which friction is treated on its interface: a proof holds some sixteen dense
# matrices of this size, 128 MB each. Nor is the rank more than one in SHARE of all dofs.
LARGEST, SHARE = 4000, 4


@dataclass(frozen=True, slots=True)
class Interface:
    """The friction term left' right.

    Attributes:
        left: shape (rank, dofs).
        right: shape (rank, dofs).
        bounded: whether right K_s^-1 right' <= 1 is known.
    """

    left: sp.csr_matrix
    right: sp.csr_matrix
    bounded: bool

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
    return Interface(left.tocsr(), (sp.diags(root) @ N[rubs]).tocsr(), True)


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
    return Interface(left, _placed(root[:, None] * W[:rank], columns, F.shape[0]), False)


def _placed(values: Array, columns: Index, size: int) -> sp.csr_matrix:
    """A dense matrix as some columns of a wider sparse one."""
    n = values.shape[0]
    indptr = np.arange(n + 1) * columns.size
    return sp.csr_matrix((values.ravel(), np.tile(columns, n), indptr), shape=(n, size))


@dataclass(frozen=True, slots=True)
class Moments:
    """Moments of S^-1 at the interface.

    Attributes:
        RL: right S^-1 (M S^-1)^j left', j = 0, 1, ..., each of shape (rank, rank).
        LL: left S^-1 (M S^-1)^(m - 1) left', m the number of RL but 3 at most, shape (rank, rank).
        RR: right S^-1 right', shape (rank, rank); None where the interface is bounded.
        SL: S^-1 left', shape (dofs, rank), where it is kept.
        low: number of the modes closest to the shift whose part is left out of RL from the second
            on, and of LL with m > 1: the round-off of that part would hide the part of the modes
            beyond the limit.
    """

    RL: tuple[Array, ...]
    LL: Array
    RR: Array | None = None
    SL: Array | None = None
    low: int = 0


def moments(
    factor: Factor,
    M: sp.csr_matrix,
    friction: Interface,
    orders: int = 1,
    keep: bool = False,
    lowest: Array | None = None,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Moments:
    """Solve for every column of the interface; collective.

    Args:
        factor: factor of S.
        M: mass [kg].
        friction: the interface.
        orders: number of moments.
        keep: whether to keep S^-1 left' where it is no larger than MESSAGE and than twice the
            factor, which the second solve of a block in its place would read twice.
        lowest: modes whose part is left out, see ``Moments.low``, shape (dofs, low); none if None.
        comm: two processes, each of which solves for half of the columns, or one (with ``keep``).

    Returns:
        The moments.
    """
    rank, half, RR = friction.rank, friction.rank // 2, None
    Phi = np.zeros((M.shape[0], 0)) if lowest is None else lowest
    keep = keep and 8e-9 * rank * M.shape[0] <= min(2 * factor.gigabytes, MESSAGE)
    SL = np.empty((M.shape[0], rank), order="F") if keep else None
    columns = slice(0, half), slice(half, rank)
    solved = in_turns(
        2, lambda i: _of_columns(factor, M, friction, orders, columns[i], Phi, SL), comm
    )
    RL, LL = (np.concatenate(parts, axis=-1) for parts in zip(*solved, strict=True))
    if not friction.bounded:
        right = friction.right.T.tocsc()
        RR = np.hstack([friction.right @ factor.solve(right[:, b]) for b in blocks(rank)])
        RR = 0.5 * (RR + RR.T)
    return Moments(tuple(RL), 0.5 * (LL + LL.T), RR, SL, Phi.shape[1])


def _of_columns(
    factor: Factor,
    M: sp.csr_matrix,
    friction: Interface,
    orders: int,
    columns: slice,
    Phi: Array,
    SL: Array | None,
) -> tuple[Array, Array]:
    """Columns of RL and of LL, not made symmetric; S^-1 left' goes to SL."""
    left = friction.left.T.tocsc()[:, columns]
    mass, seen, met = (BlockProduct(A) for A in (M, friction.right, friction.left))
    kept = None if SL is None else SL[:, columns]
    MPhi = mass(Phi)
    shape = friction.rank, left.shape[1]
    RL, LL = np.empty((orders, *shape)), np.empty(shape)
    for b in blocks(left.shape[1]):
        X = factor.solve(left[:, b])
        if kept is not None:
            kept[:, b] = X
        for j in range(orders):
            if j > 0 and Phi.size:
                X -= combined(Phi, shares(MPhi, X))
            X = X if j == 0 else factor.solve(mass(X))
            RL[j][:, b] = seen(X)
            if j == min(orders, POWER_LL) - 1:
                LL[:, b] = met(X)
    return RL, LL


class Inverse:
    """(S + left' right)^-1 and its transpose by block solves with S (Woodbury)."""

    def __init__(self, factor: Factor, friction: Interface, known: Moments):
        """Factor the interface matrix.

        Args:
            factor: factor of S.
            friction: the interface.
            known: its moments; with S^-1 left' a block takes one solve, without it two.
        """
        self.factor, self.friction, self.SL = factor, friction, known.SL
        self._lu = la.lu_factor(np.eye(friction.rank) + known.RL[0])

    def __call__(self, b: Array, turned: int = 0) -> Array:
        """Apply to a block, shape (dofs, columns); the transpose to the last ``turned`` columns."""
        f, SL, n = self.friction, self.SL, b.shape[1] - turned
        if SL is not None:
            b = b.copy(order="F")
            b[:, n:] -= f.right.T @ la.lu_solve(self._lu, shares(SL, b[:, n:]), trans=1)
            x = self.factor.solve(b)
            plus(x[:, :n], SL, la.lu_solve(self._lu, f.right @ x[:, :n]), -1.0)
            return x
        x = self.factor.solve(b)
        c = la.lu_solve(self._lu, f.right @ x[:, :n]), la.lu_solve(self._lu, f.left @ x[:, n:], 1)
        # Only the rows of contact nodes are not zero.
        return x - self.factor.solve(sp.csc_matrix(np.hstack([f.left.T @ c[0], f.right.T @ c[1]])))


@dataclass(frozen=True, slots=True)
class SplitProblem:
    """K x = kappa M x, taken apart.

    Attributes:
        K: stiffness [N/m].
        M: mass [kg].
        frictionless: symmetric part without friction, K itself if that is symmetric.
        friction: K - frictionless as an interface; None if K is symmetric or that has no low rank.
        halved: whether the symmetric half of K stands for the frictionless part.
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    frictionless: sp.csr_matrix
    friction: Interface | None
    halved: bool

    @property
    def symmetric(self) -> bool:
        """Whether there is no friction."""
        return self.frictionless is self.K

    @property
    def remedy(self) -> str:
        """What helps where nothing can be counted or proven."""
        return "; give frictionless=, the stiffness at mu = 0" if self.halved else ""

    @property
    def not_low_rank(self) -> Count:
        """Record of modes that are not counted because of the rank of friction."""
        reason = "K less its frictionless part is not of low rank"
        return Count("not counted", reason + self.remedy)

    @property
    def indefinite(self) -> Count:
        """Record of modes that are not counted because of the frictionless part."""
        part = "symmetric half of K" if self.halved else "frictionless stiffness"
        reason = f"the {part} is not positive semi-definite{self.remedy}"
        return Count("not counted", reason)


@dataclass(frozen=True, slots=True)
class Found:
    """What a method found.

    Attributes:
        kappa: eigenvalues [1/s^2], conjugates included.
        right: right vectors, shape (dofs, modes).
        left: left vectors, psi^H K = kappa psi^H M.
        counting: how their number was counted.
    """

    kappa: Complex
    right: Complex
    left: Complex
    counting: Count


def agree(found: int, expected: int, high: float, by: str) -> None:
    """Compare the modes found with those counted.

    Raises:
        InaccurateResult: they differ.
    """
    if found != expected:
        raise InaccurateResult(f"""{found} modes found up to {np.sqrt(high) / 2 / np.pi:g} Hz, {by}
            counts {expected}""")
