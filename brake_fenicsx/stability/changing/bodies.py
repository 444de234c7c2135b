"""The bodies of a brake: without contact they are apart, and each has matrices of its own."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    dofs: Index
    elements: Index
    K: sp.csr_matrix
    M: sp.csr_matrix
    N: sp.csr_matrix
    T: sp.csr_matrix
    parts: tuple[tuple[int, sp.csr_matrix], ...]

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
) -> list[Body]:
    """Take a brake apart.

    Args:
        K: elastic stiffness, without contact [N/m], shape (dofs, dofs).
        M: mass [kg].
        N: gap operator, shape (elements, dofs).
        T: slip operator.
        loads: unit loads [N], shape (dofs, loads).
        parts: unit changes of the stiffness.

    Returns:
        Its bodies, in the order of their first dofs.
    """
    count, label = connected_components(K, directed=False)
    M = M.copy()
    M.eliminate_zeros()
    bodies = []
    for i in range(count):
        dofs = np.flatnonzero(label == i)
        gap, slip = N.tocsc()[:, dofs].tocsr(), T.tocsc()[:, dofs].tocsr()
        elements = np.flatnonzero(np.diff(gap.indptr) + np.diff(slip.indptr))
        inner = [(j, p.tocsr()[dofs][:, dofs]) for j, p in enumerate(parts)]
        moved = tuple((j, p) for j, p in inner if p.nnz and abs(p).max() > 0)
        bodies.append(
            Body(
                dofs, elements, K[dofs][:, dofs].tocsr(), M[dofs][:, dofs].tocsr(),
                gap[elements], sp.vstack([slip[elements], loads[dofs].T]).tocsr(), moved,
            )
        )  # fmt: skip
    return bodies
