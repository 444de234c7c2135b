"""Polynomial interpolation of total degree over a box of parameters.

The anchors are nested Leja points in each coordinate over a lower set of indices: as many as there
are polynomials up to the degree, and the first of them are the anchors of the lower degrees
(Chkifa, Cohen and Schwab, Found. Comput. Math. 14, 2014, doi:10.1007/s10208-013-9154-z).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]

# A coefficient moves with a parameter if it changes by more than this share of the largest change.
MOVES = 1e-12


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters that all bodies of a brake depend on, scaled to the box [-1, 1]^d.

    Attributes:
        dimension: number of parameters d; 0 for materials that do not change.
        coefficients: of the unit changes of the stiffness at a point of the box, shape (changes,).
        softening: least r with K(p) >= r K(0) throughout the box, as a quadratic form.
    """

    dimension: int
    coefficients: Callable[[Array], Array]
    softening: float = 1.0

    def acting_on(self, changes: list[int]) -> NDArray[np.intp]:
        """Numbers of the parameters that move some of the unit changes."""
        base = self.coefficients(np.zeros(self.dimension))
        moved = []
        for i in range(self.dimension):
            ends = [np.eye(self.dimension)[i] * side for side in (1.0, -1.0)]
            step = np.max([np.abs(self.coefficients(x) - base) for x in ends], axis=0)
            largest = step.max(initial=0.0)
            if largest > 0 and np.any(step[changes] > MOVES * largest):
                moved.append(i)
        return np.array(moved, dtype=np.intp)


CONSTANT = Parameters(0, lambda x: np.zeros(0))


class Interpolation:
    """Polynomials of total degree through nested Leja points of [-1, 1]^d.

    Attributes:
        points: the anchors, shape (anchors, d); the first is the centre.
        degree: total degree.
    """

    def __init__(self, dimension: int, degree: int):
        """Place the anchors.

        Args:
            dimension: number of parameters d.
            degree: total degree of the polynomials.
        """
        indices = [i for i in product(range(degree + 1), repeat=dimension) if sum(i) <= degree]
        ordered = sorted(indices, key=lambda i: (sum(i), i))
        self._indices = np.array(ordered, dtype=int).reshape(len(ordered), dimension)
        self.points: Array = _leja(degree + 1)[self._indices]
        self.degree = degree

    def count(self, degree: int) -> int:
        """Number of anchors of a degree; they come first."""
        return comb(degree + self.points.shape[1], degree)

    def weights(self, x: Array, degree: int) -> Array:
        """Weights of the values at all anchors for the interpolant of a degree, shape (anchors,).

        Args:
            x: a point, shape (d,).
            degree: total degree, at most that of the anchors.
        """
        n = self.count(degree)
        out = np.zeros(len(self.points))
        matrix = self._polynomials(self.points[:n])[:, :n]
        out[:n] = np.linalg.solve(matrix.T, self._polynomials(x[None])[0, :n])
        return out

    def _polynomials(self, x: Array) -> Array:
        """Products of Chebyshev polynomials, shape (points, anchors)."""
        each = special.eval_chebyt(np.arange(self.degree + 1), x[..., None])
        out = np.ones((len(x), len(self._indices)))
        for j in range(x.shape[1]):
            out *= each[:, j, self._indices[:, j]]
        return out


def _leja(count: int) -> Array:
    """0, 1, -1, ...: each next point where the product of distances to all before is largest."""
    grid = np.cos(np.pi * np.arange(4001) / 4000)
    points = [0.0]
    while len(points) < count:
        points.append(float(grid[np.argmax(np.prod(np.abs(grid[:, None] - points), axis=1))]))
    return np.array(points)
