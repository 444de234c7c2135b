"""The bodies of a brake: without contact they are apart, and each has matrices of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Body:
    """One body and the contact elements that lie on it.

    Attributes:
        dofs: its places among all free dofs.
        elements: its contact elements among all.
        K: elastic stiffness [N/m].
        M: mass [kg].
        N: its part in the gaps, shape (its elements, its dofs).
        T: its part in the slips, and one more row for each load, shape (elements + loads, dofs).
        parts: unit changes of its stiffness, those that are not zero: (number, matrix).
        C: damping in the scene [N s/m]; without entries where there is none.
        R: its part in the slips across; without rows where nothing is asked of them.
    """

    dofs: Index
    elements: Index
    K: sp.csr_matrix
    M: sp.csr_matrix
    N: sp.csr_matrix
    T: sp.csr_matrix
    parts: tuple[tuple[int, sp.csr_matrix], ...]
    C: sp.csr_matrix
    R: sp.csr_matrix

    def change(self, coefficients: Array) -> sp.csr_matrix:
        """Change of the stiffness [N/m] under some coefficients of all unit changes."""
        total = sp.csr_matrix(self.K.shape)
        for number, part in self.parts:
            total = total + coefficients[number] * part
        return total


def split_bodies(
    K: sp.csr_matrix,
    M: sp.csr_matrix,
    N: sp.csr_matrix,
    T: sp.csr_matrix,
    loads: Array,
    parts: list[sp.csr_matrix],
    C: sp.csr_matrix | None = None,
    R: sp.csr_matrix | None = None,
) -> list[Body]:
    """Take a brake apart.

    Args:
        K: elastic stiffness, without contact [N/m], shape (dofs, dofs).
        M: mass [kg].
        N: gap operator, shape (elements, dofs).
        T: slip operator.
        loads: unit loads [N], shape (dofs, loads).
        parts: unit changes of the stiffness.
        C: damping of the bodies [N s/m]; None where they have none.
        R: slip operator across the sliding direction; None where it is not looked at.

    Returns:
        Its bodies, in the order of their first dofs.
    """
    count, label = connected_components(K, directed=False)
    M = M.copy()
    M.eliminate_zeros()
    C = sp.csr_matrix(K.shape) if C is None else C
    across = sp.csr_matrix((0, K.shape[0])) if R is None else R
    bodies = []
    for i in range(count):
        dofs = np.flatnonzero(label == i)
        gap, slip = N.tocsc()[:, dofs].tocsr(), T.tocsc()[:, dofs].tocsr()
        elements = np.flatnonzero(np.diff(gap.indptr) + np.diff(slip.indptr))
        inner = [(j, p.tocsr()[dofs][:, dofs]) for j, p in enumerate(parts)]
        moved = tuple((j, p) for j, p in inner if p.nnz and abs(p).max() > 0)
        turned = across.tocsc()[:, dofs].tocsr()
        bodies.append(
            Body(
                dofs, elements, K[dofs][:, dofs].tocsr(), M[dofs][:, dofs].tocsr(),
                gap[elements], sp.vstack([slip[elements], loads[dofs].T]).tocsr(), moved,
                C[dofs][:, dofs].tocsr(), turned if R is None else turned[elements],
            )
        )  # fmt: skip
    return bodies


def looked_at(body: Body, names: str) -> Body:
    """A body of whose interface more is looked at than its gaps.

    Args:
        body: the body.
        names: blocks of rows that forces follow: "N", then "T" and "R" where they are among them.

    Returns:
        The body with these blocks in N, in their order, and the slips along in T only where N has
        them not; the loads are the last rows of T as before.
    """
    n = body.N.shape[0]
    rows = {"N": body.N, "T": body.T[:n], "R": body.R}
    others = body.T[n:] if "T" in names else body.T
    return replace(body, N=sp.vstack([rows[name] for name in names]).tocsr(), T=others)


def places_of(names: str, wanted: str, n: int, loads: int = 0) -> slice | Index:
    """Places of some blocks among the columns of such a body: first those of N, then those of T.

    Args:
        names: rows that are looked at.
        wanted: blocks, in the order that is wanted.
        n: number of elements of the body.
        loads: how many loads follow, if they are wanted too.
    """
    order = names if "T" in names else names + "T"
    places = [np.arange(n) + n * order.index(name) for name in wanted]
    return compact(np.concatenate([*places, n * len(order) + np.arange(loads)]))


def compact(places: Index) -> slice | Index:
    """Places as a slice where they stand side by side."""
    if places.size and np.array_equal(places, np.arange(places[0], places[0] + places.size)):
        return slice(int(places[0]), int(places[0]) + places.size)
    return places
