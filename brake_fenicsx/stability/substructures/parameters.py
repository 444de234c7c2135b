"""Polynomial interpolation over a box of parameters, of a degree of its own in each of them.

A polynomial T_i(x_1) T_j(x_2) ... is one of them where i / n_1 + j / n_2 + ... is 1 at most: with
the same degree n in all parameters, all polynomials of total degree n. The anchors are discrete
Leja points: as many as there are polynomials, chosen among Chebyshev points by Gaussian elimination
with pivoting, so that the first of them are good anchors of the lower degrees (Bos, De Marchi,
Sommariva and Vianello, SIAM J. Numer. Anal. 48, 2010, doi:10.1137/090777372).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import ceil

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]

# A coefficient moves with a parameter if that changes it by more than this share of what another
# parameter does.
MOVES = 1e-12

# Of sums of shares of degrees.
ROUND_OFF = 1e-9

# Pivots that differ by less than this share are ties, which the order of the points decides,
# whatever round-off a processor makes.
TIE = 1e-9

# Coordinates of the points where an interpolation is checked: away from those of the anchors, where
# two blocks in rough and in perfect contact showed the errors that were hardest to foresee.
BETWEEN = (0.7, 0.3)


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters that all bodies of a brake depend on, scaled to the box [-1, 1]^d.

    Attributes:
        dimension: number of parameters d; 0 for materials that do not change.
        coefficients: of the changes of stiffness, damping and mass at a point of the box, shape
            (3, changes), in this order.
        softening: least r with K(p) >= r K(0) as quadratic forms, wherever in the box the
            parameters of ``shapes`` are the same.
        shapes: numbers of the parameters that change the shape or the mass of a body.
        sliding: numbers of those that move contact elements along their faces.
        contact: with such ones the rows "N", "T", "R" of all contact elements, shape (elements,
            dofs), and their areas [m^2] at a point of the box; None where these stay.
        names: what a user knows them by, shape (d,); none if nobody has to.
    """

    dimension: int
    coefficients: Callable[[Array], Array]
    softening: float = 1.0
    shapes: tuple[int, ...] = ()
    sliding: tuple[int, ...] = ()
    contact: Callable[[Array], tuple[dict[str, sp.csr_matrix], Array]] | None = None
    names: tuple[str, ...] = ()

    @property
    def centre(self) -> Array:
        """Coefficients at the centre of the box."""
        return self.coefficients(np.zeros(self.dimension))

    def corners(self, names: tuple[int, ...]) -> list[Array]:
        """The corners of the box of some parameters, all else at the centre; none of none."""
        points: list[Array] = []
        for ends in product((-1.0, 1.0), repeat=len(names)) if names else ():
            points.append(np.zeros(self.dimension))
            points[-1][list(names)] = ends
        return points

    def acting_on(self, changes: list[int], elements: int = 0) -> NDArray[np.intp]:
        """Numbers of the parameters that move a coefficient of some of the changes, or elements.

        Args:
            changes: of a body.
            elements: number of its contact elements that may slide.
        """
        base = self.centre
        steps = np.zeros((self.dimension, *base.shape))
        for step, axis in zip(steps, np.eye(self.dimension), strict=True):
            ends = [np.abs(self.coefficients(side * axis) - base) for side in (1.0, -1.0)]
            step[:] = np.max(ends, axis=0)
        moved = steps > MOVES * steps.max(axis=0, initial=0.0)
        acts = moved[:, :, changes].any(axis=(1, 2))
        acts[list(self.sliding)] |= elements > 0
        return np.flatnonzero(acts)


CONSTANT = Parameters(0, lambda x: np.zeros((3, 0)))


class Interpolation:
    """Polynomials through discrete Leja points of [-1, 1]^d.

    Attributes:
        points: the anchors, shape (anchors, d); the first is the centre.
        degree: the largest of the degrees.
    """

    def __init__(self, degrees: Sequence[int]):
        """Place the anchors.

        Args:
            degrees: degree in each of the d parameters.
        """
        self._degrees = tuple(degrees)
        self.degree = max(self._degrees, default=0)
        levels = {i: self._level(i) for i in product(*(range(n + 1) for n in self._degrees))}
        kept = [i for i in levels if levels[i] <= self.degree]
        ordered = sorted(kept, key=lambda i: (levels[i], i))
        self._indices = np.array(ordered, dtype=int).reshape(len(ordered), len(self._degrees))
        self._levels = np.array([levels[i] for i in ordered])
        candidates = self._candidates()
        self.points: Array = candidates[_discrete_leja(self._polynomials(candidates))]

    def _level(self, index: tuple[int, ...]) -> int:
        """Degree that a polynomial counts with: of one parameter of the largest degree its own."""
        share = sum(i / n for i, n in zip(index, self._degrees, strict=True))
        return ceil(self.degree * share - ROUND_OFF)

    def count(self, degree: int) -> int:
        """Number of anchors up to a level; they come first."""
        return int(np.searchsorted(self._levels, degree, side="right"))

    def weights(self, x: Array, degree: int) -> Array:
        """Weights of the values at all anchors for the interpolant of a level, shape (anchors,).

        Args:
            x: a point, shape (d,).
            degree: the level, at most the largest degree.
        """
        n = self.count(degree)
        out = np.zeros(len(self.points))
        matrix = self._polynomials(self.points[:n])[:, :n]
        out[:n] = np.linalg.solve(matrix.T, self._polynomials(x[None])[0, :n])
        return out

    @property
    def checks(self) -> Array:
        """Two opposite points between the anchors, shape (2, d)."""
        return np.outer([1.0, -1.0], np.resize(BETWEEN, self.points.shape[1]))

    def growth(self, x: Array) -> float:
        """How much larger than in the box an error may be at a point: 1 inside.

        The polynomials of one degree more, which the interpolation lacks, grow no faster outside
        than Chebyshev's.
        """
        each = zip(self._degrees, np.maximum(1.0, np.abs(x)), strict=True)
        return float(max((special.eval_chebyt(n + 1, size) for n, size in each), default=1.0))

    def _polynomials(self, x: Array) -> Array:
        """Products of Chebyshev polynomials, shape (points, anchors)."""
        each = special.eval_chebyt(np.arange(self.degree + 1), x[..., None])
        out = np.ones((len(x), len(self._indices)))
        for j in range(x.shape[1]):
            out *= each[:, j, self._indices[:, j]]
        return out

    def _candidates(self) -> Array:
        """Chebyshev points with as many coordinates off the centre as a polynomial couples."""
        off = []
        for n in self._degrees:
            line = np.sin(np.pi / 2 * np.linspace(-1, 1, 2 * (n // 2) + 5))
            off.append([x for x in line if x])
        dimension = len(self._degrees)
        points = [np.zeros(dimension)]
        for many in range(1, dimension + 1):
            for axes in combinations(range(dimension), many):
                if self._level(tuple(int(j in axes) for j in range(dimension))) > self.degree:
                    continue
                for values in product(*(off[j] for j in axes)):
                    point = np.zeros(dimension)
                    point[list(axes)] = values
                    points.append(point)
        return np.array(points)


def _discrete_leja(V: Array) -> NDArray[np.intp]:
    """Rows that Gaussian elimination with row pivoting takes, the first row first."""
    rows = np.arange(len(V))
    A = V.copy()
    for k in range(V.shape[1]):
        size = np.abs(A[k:, k])
        p = k + int(np.flatnonzero(size >= (1 - TIE) * size.max())[0]) if k else 0
        A[[k, p]], rows[[k, p]] = A[[p, k]], rows[[p, k]]
        A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
    return rows[: V.shape[1]]
