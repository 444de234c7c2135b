"""Polynomial interpolation of total degree between a few anchors in a box of parameters.

The anchors are nested Leja points, one coordinate each, over a lower set of indices: as many as
there are polynomials up to the degree, and the first of them are the anchors of lower degrees.
"""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]


class Anchors:
    """Anchors in [-1, 1]^d and the weights of their values anywhere in it.

    Attributes:
        points: shape (anchors, d); the first is the centre.
        degree: total degree of the polynomials.
    """

    def __init__(self, dimension: int, degree: int):
        """Place the anchors.

        Args:
            dimension: number of parameters d.
            degree: total degree of the polynomials.
        """
        indices = [i for i in product(range(degree + 1), repeat=dimension) if sum(i) <= degree]
        self._indices = np.array(sorted(indices, key=lambda i: (sum(i), i)))
        self.points: Array = _leja(degree + 1)[self._indices]
        self.degree = degree
        self._inverse = [
            np.linalg.inv(self._polynomials(self.points[:n])[:, :n])
            for n in (self.count(d) for d in range(degree + 1))
        ]

    def count(self, degree: int) -> int:
        """Number of anchors of a degree; they come first."""
        return comb(degree + self.points.shape[1], degree)

    def weights(self, x: Array, degree: int) -> Array:
        """Weights of the values at the first anchors, shape (count(degree),).

        Args:
            x: a point, shape (d,).
            degree: total degree, at most that of the anchors.
        """
        n = self.count(degree)
        return np.asarray(self._polynomials(x[None])[0, :n] @ self._inverse[degree])

    def series(self, x: Array, degree: int) -> Array:
        """Weights of each power of the last coordinate, shape (degree + 1, count(degree)).

        Args:
            x: the other coordinates of a point, shape (d - 1,).
            degree: total degree, at most that of the anchors.
        """
        n = self.count(degree)
        others = special.eval_chebyt(np.arange(self.degree + 1), x[:, None])
        index = self._indices[:n]
        value = np.prod([others[i, index[:, i]] for i in range(x.size)], axis=0) * np.ones(n)
        powers = np.zeros((degree + 1, n))
        for k in range(degree + 1):
            chosen = index[:, -1] == k
            series = special.chebyt(k).coef[::-1]
            powers[: series.size, chosen] = series[:, None] * value[chosen]
        return np.asarray(powers @ self._inverse[degree])

    def _polynomials(self, x: Array) -> Array:
        """Products of Chebyshev polynomials, shape (points, anchors)."""
        # Samples a little beyond the box are taken: polynomials go on there.
        each = special.eval_chebyt(np.arange(self.degree + 1), x[..., None])
        chosen = [each[:, j, self._indices[:, j]] for j in range(x.shape[1])]
        return np.asarray(np.prod(chosen, axis=0))


def _leja(count: int) -> Array:
    """0, 1, -1, ...: each next point where the product of distances to all before is largest."""
    grid = np.cos(np.pi * np.arange(4001) / 4000)
    points = [0.0]
    while len(points) < count:
        points.append(float(grid[np.argmax(np.prod(np.abs(grid[:, None] - points), axis=1))]))
    return np.array(points)
