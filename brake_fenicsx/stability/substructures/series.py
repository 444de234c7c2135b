"""The series X(w) = S(w)' L(w)' of a body, and its moments D(w) = X(w)' R(w).

With the letters of ``moments``: L(w)' = [O', P(w)'W] has a column for each contact row that forces
follow and each coupled kept mode, R(w) = [I', P(w)W, F'] one for each contact row that forces act
along, coupled kept mode and load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import shared_columns
from brake_fenicsx.macro.solver import BlockProduct, blocks

from ..eigensolvers.arnoldi import plus
from .low_rank import MomentPlan, combinations, completed
from .substructure import Substructure

if TYPE_CHECKING:
    from .moments import Complement, Rows

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Series:
    """X(w) column by column, and D(w)."""

    def __init__(
        self, body: Substructure, P: Sequence[sp.csr_matrix], complement: Complement, W: Array,
        rows: Rows, cleared: bool,
    ):  # fmt: skip
        """Prepare both sides L(w) and R(w).

        Args:
            body: the body.
            P: its matrix polynomial.
            complement: S_0 of its transpose.
            W: kept modes that are columns too, shape (n, m).
            rows: blocks of its contact rows.
            cleared: whether P_n v has no share of the kept modes for any v that has none.
        """
        followed, acting = (
            sp.vstack([body.interface[name] for name in names]).tocsr()
            for names in (rows.followed, rows.acting)
        )
        self._O, self._I, self._loads = followed.T.tocsc(), BlockProduct(acting), body.loads
        self._complement, self._cleared, self._m = complement, cleared, W.shape[1]
        # Clearing leaves nothing of P_1 W where P_1 = M or -M.
        coupling = [A @ W for A in P[: 1 if cleared else len(P)]]
        turned = [A.T @ W for A in P[: len(coupling)]]
        self._right = [complement.clear(A) for A in coupling]
        self._left = [complement.clear(A) for A in turned[1:]]
        self._kept = complement.kept(turned[0]) if self._m else W
        self._minus = [BlockProduct(-A.T) for A in P[1:]]
        self._columns = self._O.shape[1] + self._m
        self._width = acting.shape[0] + self._m + body.loads.shape[1]
        # Places of the columns of L' among those of R.
        of = body.elements.size
        places = [np.arange(of) + of * rows.acting.index(name) for name in rows.followed]
        self._places = np.concatenate([*places, acting.shape[0] + np.arange(self._m)])

    def moments(
        self,
        plan: MomentPlan,
        comm: MPI.Comm,
        progress: Callable[[int], None] = lambda solves: None,
    ) -> tuple[Array, float]:
        """D_0 ... of all columns, shared by the processes of a communicator; collective.

        Args:
            plan: how many of every column, and how many of combinations.
            comm: processes that share the work.
            progress: called with the number of solves that were done.

        Returns:
            Shape (moments, columns of L', columns of R), and the error of what combinations give,
            over the size of the last moment.
        """
        own, omega = shared_columns(self._columns, comm), combinations(self._columns, plan.rank)
        out = np.empty((plan.exact, own.size, self._width))
        combined = np.zeros((self._O.shape[0], plan.rank), order="F")
        for b in blocks(own.size):
            X: list[Array] = []
            for n in range(plan.exact):
                X = [*X[-2:], self._next(X, n, own[b])]
                self._read(X, out[n, b])
            if plan.further:
                combined = plus(combined, X[-1], omega[own[b]])
            progress(own[b].size * plan.exact)
        D = np.concatenate(comm.allgather(out), axis=1)
        if not plan.further:
            return D, 0.0
        comm.Allreduce(MPI.IN_PLACE, combined)
        own = shared_columns(plan.rank, comm)
        out = np.empty((plan.further, own.size, self._width))
        for b in blocks(own.size):
            X = [combined[:, own[b]]]
            for n in range(plan.further):
                X = [X[-1], self._next(X, plan.exact + n, own[:0])]
                self._read(X, out[n, b])
            progress(own[b].size * plan.further)
        seen = np.concatenate(comm.allgather(out), axis=1)
        more, error = completed(seen, omega, self._places)
        return np.concatenate([D, more]), error

    def _next(self, X: list[Array], n: int, columns: Index) -> Array:
        """X_n of some columns from the last of their X_0 ... X_n-1; no columns: combinations."""
        contact = columns[columns < self._O.shape[1]]
        modal = columns[contact.size :] - self._O.shape[1]
        if n == 0 and not modal.size:
            return self._complement.solve(self._O[:, contact])
        if n == 0:
            out = np.empty((self._O.shape[0], columns.size), order="F")
            if contact.size:
                out[:, : contact.size] = self._complement.solve(self._O[:, contact])
            out[:, contact.size :] = self._kept[:, modal]
            return out
        parts = [A(x) for A, x in zip(self._minus, X[::-1], strict=False)]
        rhs = sum(parts[1:], parts[0])
        if n <= len(self._left) and modal.size:
            rhs[:, contact.size :] += self._left[n - 1][:, modal]
        return self._complement.solve(rhs, self._cleared)

    def _read(self, X: list[Array], out: Array) -> None:
        """D_n of some columns from the last of their X_0 ... X_n."""
        contact, m = self._I.shape[0], self._m
        out[:, :contact] = self._I(X[-1]).T
        out[:, contact + m :] = X[-1].T @ self._loads
        if m:
            pairs = zip(X[::-1], self._right, strict=False)
            out[:, contact : contact + m] = sum(x.T @ right for x, right in pairs)
