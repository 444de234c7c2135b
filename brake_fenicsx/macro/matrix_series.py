"""Chebyshev series of a sparse matrix over some variables in [-1, 1].

Each variable alone tells the degree that it needs; of several the series is one of products up to a
total share of these degrees, through points that elimination with pivoting chooses (Sommariva and
Vianello, Comput. Math. Appl. 57, 1324, 2009: approximate Fekete points). The error of an entry is
measured between the points, and products that matter for no entry are left out: variables that meet
in no entry cost no more than each by itself.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy import special

from brake_fenicsx.arguments import Array, Index

# Number of a function of some variables, one of each.
Power = tuple[int, ...]

# Error of an entry over the largest ones of its row and column that is accepted, degrees that are
# tried for each variable, and halves of these for several together.
ERROR, DEGREES, TOGETHER = 1e-10, (2, 4, 8, 16), (2, 3, 4)
# Share of the error below which a term is left out.
DROPPED = 0.1
# Least entries of a row that count, over those of all rows.
SMALL = 1e-4


def matrix_series(
    at: Callable[[Array], sp.csr_matrix], variables: int
) -> dict[Power, sp.csr_matrix] | None:
    """Matrices by which products of Chebyshev polynomials come in a matrix; None of too many.

    Args:
        at: the matrix at a point of [-1, 1]^variables, of one pattern always.
        variables: their number.
    """
    known: dict[tuple[float, ...], sp.csr_matrix] = {}

    def value(x: Array) -> Array:
        place = tuple(float(v) for v in np.round(x, 12))
        if place not in known:
            known[place] = at(np.array(place))
        return np.asarray(known[place].data)

    def series(degrees: Index) -> tuple[Index, Array, Callable[[Array], float]]:
        indices = _indices(degrees)
        points = _spread(indices, [_line(degree) for degree in degrees])
        A: Array = np.linalg.inv(products(points, indices)) @ [value(x) for x in points]
        return indices, A, _shares(next(iter(known.values())), A)

    def holds(degrees: Index) -> bool:
        indices, A, share = series(degrees)
        wrong = (value(x) - (products(x[None], indices) @ A)[0] for x in _between(degrees))
        return all(share(data) <= ERROR for data in wrong)

    # Points of one degree are among those of twice the degree.
    axes = np.eye(variables, dtype=np.intp)
    alone = [next((d for d in DEGREES if holds(d * axis)), None) for axis in axes]
    if None in alone:
        return None
    trials = [np.array(alone) * n // 2 for n in (TOGETHER if variables > 1 else (2,))]
    degrees = next((d for d in trials if variables == 1 or holds(d)), None)
    if degrees is None:
        return None
    (indices, A, share), pattern = series(degrees), next(iter(known.values()))
    return {
        tuple(map(int, index)): sp.csr_matrix(
            (data, pattern.indices, pattern.indptr), pattern.shape
        )
        for index, data in zip(indices, A, strict=True)
        if not index.any() or share(data) > DROPPED * ERROR
    }


def products(x: Array, indices: Index) -> Array:
    """Products of Chebyshev polynomials at some points, shape (points, products).

    Args:
        x: shape (points, variables).
        indices: degrees of the factors, shape (products, variables).
    """
    return np.asarray(special.eval_chebyt(indices, x[:, None]).prod(axis=2))


def _indices(degrees: Index) -> Index:
    """Degrees of the factors of products up to a total share of some degrees."""
    every = np.array([*np.ndindex(*(degrees + 1))])
    return every[np.sum(every / np.maximum(degrees, 1), axis=1) <= 1 + 1e-9]


def _line(degree: int) -> Array:
    """Extreme points of a Chebyshev polynomial; the centre for a constant."""
    return np.cos(np.pi * np.arange(degree + 1) / degree) if degree else np.zeros(1)


def _spread(indices: Index, lines: list[Array]) -> Array:
    """As many points of a grid as there are products."""
    grid = np.array([*product(*lines)])
    _, order = la.qr(products(grid, indices).T, mode="r", pivoting=True)
    return np.asarray(grid[order[: len(indices)]])


def _between(degrees: Index) -> Array:
    """Points between those of some degrees, near the ends and in the middle."""
    at = (np.array([0 * degrees, degrees // 2]) + 0.5) / np.maximum(degrees, 1)
    end, middle = np.cos(np.pi * at) * (degrees > 0)
    if np.count_nonzero(degrees) == 1:
        return np.array([end, middle])
    other = (-1.0) ** np.arange(len(degrees))
    mixed = np.where(other > 0, end, middle)
    return np.array([end, middle, other * end, mixed, other * mixed])


def _shares(pattern: sp.csr_matrix, A: Array) -> Callable[[Array], float]:
    """Largest entry of data on a pattern over the largest ones of its row and column in some."""
    size = np.abs(A).max(axis=0)
    rows = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    most = np.zeros(pattern.shape[0])
    np.maximum.at(most, rows, size)
    # Where the entries of a row cancel there is round-off alone.
    most = np.maximum(most, SMALL * most.max())
    scale = np.sqrt(most[rows] * most[pattern.indices])
    return lambda data: float((np.abs(data) / scale).max())
