"""Bodies that are images of one another, such as two pads on both sides of a disc.

The displacements of an image are those of the original in another order and with other signs. Both
are found from the matrices alone: the dofs by what each of them sees of its neighbours, the signs
along the strongest couplings. Only what then agrees entry by entry is an image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from .bodies import Body

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# How often a dof looks at its neighbours.
SWEEPS = 4

# Relative difference of marks, and of matrix entries, that is round-off.
SAME_MARK, ROUND_OFF = 1e-9, 1e-12


@dataclass(frozen=True, slots=True)
class Image:
    """A body that is the image of another one.

    Attributes:
        body: the body, its dofs and elements in the order of the original; without matrices.
        signs: its displacements over those of the original, 1 or -1, shape (dofs,).
    """

    body: Body
    signs: Array


def image_of(original: Body, other: Body) -> Image | None:
    """Another body as the image of a first one; None where it is none, or that cannot be shown.

    Args:
        original: the first body.
        other: the other one; all its matrices must agree to round-off.
    """
    if _counts(original) != _counts(other):
        return None
    dofs = _matched(_marks(original), _marks(other))
    if dofs is None:
        return None
    K = other.K[dofs][:, dofs]
    signs = _signs(original.K, K)
    N, T = other.N[:, dofs], other.T[:, dofs]
    elements = _matched(_rows(original.N, original.T), _rows(N, T))
    if signs is None or elements is None:
        return None
    turn, scale = sp.diags(signs), sp.diags(1 / np.sqrt(original.K.diagonal()))
    rows = np.r_[elements, np.arange(elements.size, T.shape[0])]
    N, T, R = N[elements] @ turn, T[rows] @ turn, other.R[:, dofs]
    R = R[elements] @ turn if R.shape[0] else R
    # The whole body may be upside down: only its gaps tell.
    upright = 1.0 if original.N.multiply(N).sum() >= 0 else -1.0
    square = [(original.K, K), (original.M, other.M[dofs][:, dofs])]
    parts = zip(original.parts, other.parts, strict=True)
    square += [(a, b[dofs][:, dofs]) for (_, a), (_, b) in parts]
    pairs = [(scale @ a @ scale, scale @ turn @ b @ turn @ scale) for a, b in square]
    damped = scale @ original.C @ scale, scale @ turn @ other.C[dofs][:, dofs] @ turn @ scale
    rows_of = [(original.N, N), (original.T, T), (original.R, R)]
    pairs += [damped, *((a, upright * b) for a, b in rows_of)]
    if not all(_largest(a - b) <= ROUND_OFF * _largest(a) for a, b in pairs):
        return None
    none = sp.csr_matrix((0, 0))
    body = replace(
        other, dofs=other.dofs[dofs], elements=other.elements[elements], K=none, M=none, parts=(),
        C=none, R=none,
    )  # fmt: skip
    return Image(body, upright * signs)


def _counts(body: Body) -> tuple[object, ...]:
    """What two bodies must have in common before anything is compared."""
    numbers = (number for number, _ in body.parts)
    return (*body.N.shape, *body.T.shape, *body.R.shape, *numbers)


def _marks(body: Body) -> Array:
    """A positive number for each dof, by its place among the others and no sign."""
    scale = sp.diags(1 / np.sqrt(body.K.diagonal()))
    coupling = abs(scale @ body.K @ scale).power(2).tocsr()
    mass = body.M.diagonal()
    mark = mass / mass.mean()
    for _ in range(SWEEPS):
        mark = coupling @ mark**2
        mark /= mark.mean()
    return np.asarray(mark)


def _rows(N: sp.csr_matrix, T: sp.csr_matrix) -> Array:
    """A positive number for each contact element, by the dofs it sees."""
    count = N.shape[0]
    weights = 1 + np.random.default_rng(0).random((N.shape[1], 2))
    return np.asarray(abs(N) @ weights[:, 0] + abs(T[:count]) @ weights[:, 1])


def _matched(marks: Array, others: Array) -> Index | None:
    """For each mark the place of its like among others."""
    order, other = np.argsort(marks, kind="stable"), np.argsort(others, kind="stable")
    if not np.allclose(marks[order], others[other], rtol=SAME_MARK, atol=0):
        return None
    places = np.empty_like(order)
    places[order] = other
    return places


def _signs(A: sp.csr_matrix, B: sp.csr_matrix) -> Array | None:
    """Signs s with B_ij = s_i A_ij s_j along the strongest couplings; None if A is not one body."""
    scale = sp.diags(1 / np.sqrt(A.diagonal()))
    length = (scale @ A @ scale).tocsr()
    length.eliminate_zeros()
    length.data = 1 / np.abs(length.data)
    order, before = breadth_first_order(minimum_spanning_tree(length), 0, directed=False)
    if order.size < A.shape[0]:
        return None
    step = np.ones(A.shape[0])
    there = (order[1:], before[order[1:]])
    turned = np.asarray(A[there]).ravel() * np.asarray(B[there]).ravel() < 0
    step[order[1:]] = np.where(turned, -1.0, 1.0)
    signs = np.ones(A.shape[0])
    for i in order[1:]:
        signs[i] = step[i] * signs[before[i]]
    return signs


def _largest(A: sp.csr_matrix) -> float:
    return float(np.abs(A.data).max(initial=0.0))
